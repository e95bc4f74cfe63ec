//! Benches of the stages of a bake.

use crate::fixture::Fixture;
use criterion::{BatchSize, Criterion, Throughput};
use glam::{Vec2, Vec3, Vec3A};
use meshless_gi::internals::samples::{gather_direction, tangents};
use meshless_gi::internals::transport::bounded_truncation::{CutScratch, cut_row};
use meshless_gi::internals::transport::{
    Gathered, PackSettings, SenderForm, assign_tiers, gather, pack,
};
use meshless_gi::{BakedScene, Geometry, Limits, Ray};
use std::hint::black_box;

/// Number of points that rays start at.
const RAY_ORIGINS: usize = 64;
/// Number of rays from each of them.
const RAYS_PER_ORIGIN: u32 = 64;
/// Number of positions of a look-up.
const POSITIONS: usize = 1024;
/// Number of rows that are truncated in turn.
const ROWS: usize = 16;

/// Runs all benches of this module.
pub fn bench(criterion: &mut Criterion, fixture: &Fixture) {
    cast(criterion, fixture);
    look_up(criterion, fixture);
    gather_and_cut(criterion, fixture);
    pack_and_read(criterion, fixture);
}

/// Returns indices of `count` evenly spaced points of the finest level.
fn finest_points(fixture: &Fixture, count: usize) -> impl Iterator<Item = usize> {
    let level = fixture.hierarchy.level(fixture.hierarchy.levels.len() - 1);
    let step = (level.len() / count).max(1);
    level.step_by(step).take(count)
}

fn cast(criterion: &mut Criterion, fixture: &Fixture) {
    let mesh = &fixture.mesh;
    let rays: Vec<Ray> = finest_points(fixture, RAY_ORIGINS)
        .flat_map(|i| {
            let surface = &fixture.hierarchy.surfaces[i];
            let (x, n) = (surface.position, surface.normal);
            let (t, b) = tangents(n);
            let start = x + n * mesh.ray_offset(x);
            (0..RAYS_PER_ORIGIN).map(move |k| {
                let (d, _) = gather_direction(k, RAYS_PER_ORIGIN, Vec2::ZERO);
                Ray::new(start, (t * d.x + b * d.y + n * d.z).normalize())
            })
        })
        .collect();
    let mut group = criterion.benchmark_group("bake");
    group.throughput(Throughput::Elements(rays.len() as u64));
    group.bench_function("bvh_cast", |b| {
        b.iter(|| rays.iter().filter(|r| mesh.cast(r).is_some()).count());
    });
    let bvh = &fixture.scene.data().bvh;
    group.bench_function("bvh_transmittance", |b| {
        b.iter(|| rays.iter().map(|r| bvh.transmittance(r)).sum::<f32>());
    });
}

fn look_up(criterion: &mut Criterion, fixture: &Fixture) {
    let finest = fixture.hierarchy.senders.len() - 1;
    let basis = &fixture.hierarchy.senders[finest];
    let positions: Vec<(Vec3, Vec3)> = finest_points(fixture, POSITIONS)
        .map(|i| &fixture.hierarchy.surfaces[i])
        .map(|s| (s.position, s.normal))
        .collect();
    let mut group = criterion.benchmark_group("bake");
    group.throughput(Throughput::Elements(positions.len() as u64));
    group.bench_function("grid_look_up", |b| {
        b.iter(|| {
            let lists = positions.iter().map(|&(x, _)| basis.grid.indices_near(x));
            lists.map(<[u32]>::len).sum::<usize>()
        });
    });
    let mut found = Vec::new();
    group.bench_function("basis_look_up", |b| {
        b.iter(|| {
            let covered = |&&(x, n): &&(Vec3, Vec3)| basis.weights(x, n, &mut found);
            positions.iter().filter(covered).count()
        });
    });
}

/// Sums of a gathered row. Truncation moves them, so every run starts from a copy.
struct GatheredRow {
    normal: Vec3A,
    sums: Vec<(u32, [Vec3A; 2])>,
}

impl GatheredRow {
    fn new(normal: Vec3A, gathered: &Gathered) -> Self {
        let touched = gathered.touched.iter();
        let sums = touched.map(|&j| (j, gathered.sums[j as usize])).collect();
        Self { normal, sums }
    }

    fn copy(&self, senders: usize) -> Gathered {
        let mut gathered = Gathered::new(senders);
        for &(j, [even, odd]) in &self.sums {
            gathered.deposit(j, 0, even);
            gathered.deposit(j, 1, odd);
        }
        gathered
    }
}

fn gather_and_cut(criterion: &mut Criterion, fixture: &Fixture) {
    let scene = fixture.gather_scene();
    let senders = fixture.senders();
    let mut gathered = Gathered::new(senders);
    let receivers: Vec<usize> = finest_points(fixture, ROWS).collect();
    let mut group = criterion.benchmark_group("bake");
    group.throughput(Throughput::Elements(u64::from(scene.rays)));
    let mut next = receivers.iter().cycle();
    group.bench_function("gather_point", |b| {
        b.iter(|| {
            let &i = next.next().expect("a cycle");
            gather(&scene, i, &mut gathered);
            gathered.sky
        });
    });
    let copy = |&i: &usize| {
        gather(&scene, i, &mut gathered);
        GatheredRow::new(fixture.normal(i), &gathered)
    };
    let rows: Vec<GatheredRow> = receivers.iter().map(copy).collect();
    let links: usize = rows.iter().map(|row| row.sums.len()).sum();
    let mut next = rows.iter().cycle();
    let mut scratch = CutScratch::default();
    let measure = fixture.measure();
    group.throughput(Throughput::Elements((links / rows.len()) as u64));
    group.bench_function("cut_row", |b| {
        b.iter_batched_ref(
            || {
                let row = next.next().expect("a cycle");
                (row.normal, row.copy(senders))
            },
            |(n, gathered)| cut_row(gathered, &fixture.tree, *n, &measure, &mut scratch),
            BatchSize::SmallInput,
        );
    });
}

fn pack_and_read(criterion: &mut Criterion, fixture: &Fixture) {
    let (rows, sky) = (&fixture.rows, &fixture.sky);
    let (form, starts) = (SenderForm::Averages, &fixture.hierarchy.level_starts);
    let tiers = assign_tiers(rows, starts, &fixture.parents, form);
    let links: usize = rows.iter().map(|row| row.links.len()).sum();
    let settings = PackSettings {
        form,
        senders: fixture.senders(),
        points: &fixture.scene.data().points,
        link_step: 0.0005,
        precision: &fixture.scene.data().operator.precision,
    };
    let mut group = criterion.benchmark_group("bake");
    group.throughput(Throughput::Elements(links as u64));
    group.bench_function("pack", |b| {
        b.iter_with_large_drop(|| pack(rows, &tiers, sky, &[], &settings));
    });
    let bytes = fixture.scene.to_bytes().expect("a valid scene");
    // The bytes of the decoded links. Most of the time of a read decodes links.
    let links = &fixture.scene.data().operator.links;
    group.throughput(Throughput::Bytes(size_of_val(&links[..]) as u64));
    group.bench_function("read_bake", |b| {
        b.iter_with_large_drop(|| BakedScene::from_bytes(black_box(&bytes), &Limits::default()));
    });
}

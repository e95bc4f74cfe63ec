//! Benches of the stages of a frame, by the CPU twins of the kernels.

use crate::fixture::{Fixture, light};
use criterion::{Criterion, Throughput};
use glam::{Mat4, Vec3};
use meshless_gi::internals::frame::{
    GridShape, SceneDimensions, SplatParams, VectorIrradiance, apply, flatten, project, splat,
};
use meshless_gi::{CpuFrame, FrameSettings};
use meshless_gi_lab::accuracy::RaycastView;

/// Size of the view, in pixels.
const VIEW: [u32; 2] = [64, 48];
/// Tier of bench `flatten`. The lowest tier has the most points without a row.
const FLATTEN_TIER: u32 = 1;

/// Runs all benches of this module.
pub fn bench(criterion: &mut Criterion, fixture: &Fixture) {
    let scene = &fixture.scene;
    let settings = FrameSettings::default();
    let mut frame = CpuFrame::new(scene);
    frame.set_lights(scene, &[light(0)]);
    frame.solve(scene, &settings);
    project(criterion, fixture);
    apply(criterion, fixture, &frame);
    flatten(criterion, fixture, frame.vector_irradiance());
    splat(criterion, fixture, frame.vector_irradiance());
}

fn project(criterion: &mut Criterion, fixture: &Fixture) {
    let scene = &fixture.scene;
    let (extent, spacing) = (
        project::extent(scene.data()),
        project::sample_spacing(scene.data()),
    );
    let light = light(0);
    let mut out = vec![0.0; scene.data().senders()];
    let mut group = criterion.benchmark_group("frame");
    group.throughput(Throughput::Elements(scene.data().rays_per_slot()));
    group.bench_function("project", |b| {
        b.iter(|| {
            project::project(
                scene.data(),
                &scene.data().bvh,
                extent,
                spacing,
                &light,
                &mut out,
            )
        });
    });
}

fn apply(criterion: &mut Criterion, fixture: &Fixture, frame: &CpuFrame) {
    let scene = &fixture.scene;
    let params = frame.params(scene, &FrameSettings::default());
    let (rows, links) = (&scene.data().operator.rows, &scene.data().operator.links);
    let points = 0..scene.data().points.len();
    let mut out = vec![VectorIrradiance::default(); points.len()];
    let mut group = criterion.benchmark_group("frame");
    group.throughput(Throughput::Elements(links.len() as u64));
    group.bench_function("apply", |b| {
        b.iter(|| {
            let coefficients = frame.senders();
            apply::apply(&params, rows, links, points.clone(), coefficients, &mut out);
        });
    });
}

fn flatten(criterion: &mut Criterion, fixture: &Fixture, values: &[VectorIrradiance]) {
    let scene = &fixture.scene;
    let dimensions = SceneDimensions::new(scene.data());
    let settings = FrameSettings {
        tier: FLATTEN_TIER,
        ..FrameSettings::default()
    };
    let params = dimensions.params(&settings, 1);
    let rows = &scene.data().operator.rows;
    let mut values = values.to_vec();
    let count = rows.iter().filter(|row| !row.used(params.tier)).count();
    let mut group = criterion.benchmark_group("frame");
    group.throughput(Throughput::Elements(count as u64));
    group.bench_function("flatten", |b| {
        b.iter(|| {
            for level in (1..dimensions.levels()).map(|l| dimensions.level(l)) {
                flatten::averages(&params, rows, &scene.data().parents, level, &mut values);
            }
        });
    });
}

fn splat(criterion: &mut Criterion, fixture: &Fixture, values: &[VectorIrradiance]) {
    let scene = &fixture.scene;
    let (eye, target) = (Vec3::new(0.0, 1.0, 3.0), Vec3::new(0.0, 1.0, 0.0));
    let clip_from_world = RaycastView::perspective(eye, target, Vec3::Y, 0.9, VIEW, 0.1);
    let view = RaycastView::new(&fixture.mesh, clip_from_world, VIEW);
    let grid = &scene.data().display.grid;
    let [width, height] = VIEW.map(|edge| edge as f32);
    let params = SplatParams::new(
        view.world_from_clip,
        Mat4::IDENTITY,
        [0.0, 0.0, width, height],
        VIEW,
        1.0,
        GridShape {
            slot_mask: grid.slots.len() as u32 - 1,
            cell_size: grid.cell_size,
        },
    );
    let mut group = criterion.benchmark_group("frame");
    group.throughput(Throughput::Elements(view.depth.len() as u64));
    group.bench_function("splat_pixel", |b| {
        b.iter(|| {
            let pixels = view.depth.iter().zip(&view.gbuffer).enumerate();
            let texels = pixels.map(|(i, (&depth, &texel))| {
                let pixel = [i as u32 % VIEW[0], i as u32 / VIEW[0]];
                splat::splat_pixel(&params, scene.data(), values, pixel, depth, texel)
            });
            texels.map(|[red, ..]| red).sum::<f32>()
        });
    });
}

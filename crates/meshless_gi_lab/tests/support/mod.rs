//! Small synthetic scenes that pass validation and use every part of the format.
#![allow(dead_code, reason = "each program uses its part")]

use meshless_gi_lab::fixtures::by_hand;

use by_hand::operator;
use glam::Vec3;
use meshless_gi::internals::asset::{
    DynamicMaterials, FlatBasis, LightSamples, MaterialCoverage, Occluders, PointSurface,
    SceneData, SkyVisibility,
};
use meshless_gi::internals::basis::{WeightEntry, Weights, support_bounds};
use meshless_gi::internals::samples::{HashedGrid, LightSample, Point};
use meshless_gi::internals::scene::{BvhNode, BvhTriangle};
use meshless_gi::internals::transport::fmm::{Fmm, FmmOperator, FmmPoint, FmmSettings};
use meshless_gi::internals::transport::pca::{
    Column, Compression, Visibility, VisibilityRecipe, VisibilitySettings, bake_visibility,
};
use meshless_gi::internals::transport::{
    BounceLink, BounceOperator, Link, Operator, PackedLinkTerm, Row, RowQuantizer, SenderForm,
    link_of_parts,
};
use meshless_gi::{BakeInfo, BakedScene, Bvh, Material, MaterialFactors, TierInfo, TriangleMesh};

/// Counted random numbers (SplitMix64).
pub struct Random(pub u64);

impl Random {
    pub fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// Returns a number below `n`. Returns 0 for n = 0.
    pub fn below(&mut self, n: usize) -> usize {
        if n == 0 {
            0
        } else {
            (self.next() % n as u64) as usize
        }
    }

    /// Returns a number in [0, 1).
    pub fn unit(&mut self) -> f32 {
        (self.next() >> 40) as f32 / (1u64 << 24) as f32
    }

    fn signed(&mut self) -> Vec3 {
        Vec3::new(self.unit(), self.unit(), self.unit()) * 2.0 - 1.0
    }
}

/// Content of a synthetic scene.
#[derive(Clone, Copy)]
pub struct SceneOptions {
    pub seed: u64,
    pub levels: &'static [u32],
    pub sender_levels: u32,
    pub form: SenderForm,
    pub bounces: bool,
    /// Cells larger than the bake makes them, so that the grid has to be stored.
    pub own_grid: bool,
    pub triangles: usize,
    /// Octree, in addition to links or instead of them.
    pub octree: Option<bool>,
    /// Links to the terms of a sky that varies.
    pub sky: bool,
    /// Materials that change.
    pub has_dynamic_materials: bool,
    /// `true` if the scene has occluders.
    pub occluded: bool,
    /// `true` if points have visibility data.
    pub has_visibility: bool,
    /// `true` if links are quantized.
    pub quantized: bool,
}

/// Returns one scene of each sort.
pub fn makes() -> Vec<SceneOptions> {
    let plain = SceneOptions {
        seed: 1,
        levels: &[3, 5, 9],
        sender_levels: 2,
        form: SenderForm::Averages,
        bounces: false,
        own_grid: false,
        triangles: 3,
        octree: None,
        sky: false,
        has_dynamic_materials: false,
        occluded: false,
        has_visibility: false,
        quantized: false,
    };
    vec![
        plain,
        SceneOptions {
            seed: 2,
            bounces: true,
            own_grid: true,
            ..plain
        },
        SceneOptions {
            seed: 3,
            levels: &[2, 4, 3, 6],
            sender_levels: 3,
            form: SenderForm::Differences,
            quantized: true,
            ..plain
        },
        SceneOptions {
            seed: 4,
            levels: &[1],
            sender_levels: 1,
            triangles: 0,
            ..plain
        },
        SceneOptions {
            seed: 5,
            levels: &[4, 7],
            sender_levels: 2,
            bounces: true,
            triangles: 8,
            ..plain
        },
        SceneOptions {
            seed: 6,
            form: SenderForm::Components,
            ..plain
        },
        SceneOptions {
            seed: 7,
            levels: &[2, 24, 40],
            octree: Some(false),
            ..plain
        },
        SceneOptions {
            seed: 8,
            octree: Some(true),
            ..plain
        },
        SceneOptions {
            seed: 9,
            sky: true,
            ..plain
        },
        SceneOptions {
            seed: 10,
            has_dynamic_materials: true,
            ..plain
        },
        SceneOptions {
            seed: 11,
            occluded: true,
            sky: true,
            ..plain
        },
        SceneOptions {
            seed: 12,
            has_visibility: true,
            ..plain
        },
        SceneOptions {
            seed: 20,
            levels: &[3, 5, 40],
            quantized: true,
            ..plain
        },
    ]
}

/// Returns facts about a bake of `triangles` triangles.
fn info(triangles: u64) -> BakeInfo {
    let mut info = BakeInfo::default();
    info.version = "0.0.0".into();
    info.fingerprint = "00".repeat(32);
    info.recipe = "()".into();
    info.triangles = triangles;
    info.bounds = [[-1.0; 3], [1.0; 3]];
    info.viewpoints = vec![[0.1, 0.2, 0.3]];
    info.bounces = 3;
    info
}

/// Three materials, and none to two shares of them a sender.
fn materials(r: &mut Random, senders: u32) -> DynamicMaterials {
    let mut dynamic = DynamicMaterials {
        names: ["wall", "", "sign"].map(String::from).to_vec(),
        factors: (0..3)
            .map(|_| MaterialFactors {
                base_color: [r.unit(); 3],
                emissive: [3.0 * r.unit(); 3],
            })
            .collect(),
        starts: vec![0],
        shares: Vec::new(),
    };
    for j in 0..senders {
        for k in 0..j % 3 {
            dynamic.shares.push(MaterialCoverage {
                material: (j + k) % 3,
                albedo: [0.5 * r.unit(); 3],
                emission: [0.5 * r.unit(); 3],
            });
        }
        dynamic.starts.push(dynamic.shares.len() as u32);
    }
    dynamic
}

fn row(random: &mut Random, range: std::ops::Range<u32>, max: usize) -> Vec<WeightEntry> {
    let mut picked: Vec<u32> = range
        .filter(|_| random.next().is_multiple_of(2))
        .take(max)
        .collect();
    picked.sort_unstable();
    let weights: Vec<f32> = picked.iter().map(|_| 0.1 + random.unit()).collect();
    let sum: f32 = weights.iter().sum();
    picked
        .into_iter()
        .zip(weights)
        .map(|(index, w)| WeightEntry {
            index,
            weight: w / sum,
        })
        .collect()
}

pub fn build(make: &SceneOptions) -> BakedScene {
    let r = &mut Random(make.seed.wrapping_mul(0x1234_5678_9abc_def1));
    let mut starts = vec![0u32];
    for n in make.levels {
        starts.push(starts.last().unwrap() + n);
    }
    let count = *starts.last().unwrap() as usize;
    let senders = starts[make.sender_levels as usize];
    let radius = 0.7;
    let planes: Vec<[f32; 4]> = (0..4)
        .map(|_| r.signed().normalize().extend(r.unit()).to_array())
        .collect();
    let points: Vec<Point> = (0..count)
        .map(|i| Point {
            planes: (i as u32 % 4) | ((i as u32 % 2) << 24),
            ..Point::new(
                r.signed(),
                (r.signed() + Vec3::splat(1.5)).normalize(),
                radius,
            )
        })
        .collect();
    let surfaces = (0..count)
        .map(|i| PointSurface {
            albedo: [0.7, r.unit(), 0.3],
            emission: if i % 5 == 0 {
                [1.0, 2.0, r.unit()]
            } else {
                [0.0; 3]
            },
            sky: (r.signed() * 0.4).to_array(),
            ..PointSurface::default()
        })
        .collect();
    let last = make.levels.len() - 1;
    let mut pull = Vec::new();
    let mut parents = Vec::new();
    for l in 0..make.levels.len() {
        for _ in 0..make.levels[l] {
            if l < make.sender_levels as usize {
                pull.push(if l < last && l + 1 < make.sender_levels as usize {
                    row(r, starts[l + 1]..starts[l + 2], 4)
                } else {
                    Vec::new()
                });
            }
            parents.push(match make.form {
                SenderForm::Averages | SenderForm::Components if l > 0 => {
                    row(r, starts[l - 1]..starts[l], 4)
                }
                SenderForm::Averages | SenderForm::Components => Vec::new(),
                SenderForm::Differences => (0..l)
                    .flat_map(|k| row(r, starts[k]..starts[k + 1], 3))
                    .collect(),
            });
        }
    }
    let finest = senders - starts[make.sender_levels as usize - 1];
    let samples = LightSamples {
        per_sender: 2,
        list: (0..2 * finest)
            .map(|_| LightSample::new(r.signed(), r.signed().normalize()))
            .collect(),
    };
    let compression = (make.form == SenderForm::Components).then(|| {
        let own = (0..senders).filter(|&k| pull[k as usize].is_empty());
        columns(own.collect(), senders)
    });
    let coefficients = (compression.as_ref()).map_or(senders, |c| c.components() as u32);
    let mut links = Vec::new();
    let rows = (0..count)
        .map(|i| {
            let start = links.len() as u32;
            let active = i % 3 != 2;
            let optional = make.form.has_independent_rows() && !parents[i].is_empty();
            if active {
                let max = coefficients + if make.sky { 8 } else { 0 };
                for s in (0..=max)
                    .filter(|s| !(s + i as u32).is_multiple_of(3))
                    .skip(if make.sky { i % 7 } else { 0 })
                    .take(6)
                {
                    links.push(Link::pack(r.signed() * 0.05, 0.05, s as u16));
                }
            }
            Row {
                start,
                count: links.len() as u32 - start,
                scale: if active { 0.05 } else { 0.0 },
                tier: match (active, optional) {
                    (false, _) => 0,
                    (true, false) => 1,
                    (true, true) => 1 + i as u32 % 2,
                },
            }
        })
        .collect();
    let bounces = make.bounces.then(|| {
        let coarsest = make.levels[0];
        BounceOperator {
            starts: (0..=coarsest).map(|k| 2 * k).collect(),
            links: (0..2 * coarsest)
                .map(|k| BounceLink {
                    gain: [r.unit() * 0.1; 3],
                    sender: k % senders,
                })
                .collect(),
            bounces: 3,
        }
    });
    let cell = if make.own_grid { 1.5 } else { radius };
    let grid = HashedGrid::build(count, cell, |i| {
        let mut b = support_bounds(&points[i]);
        if make.own_grid {
            b.max += 0.4;
        }
        b
    });
    let triangles: Vec<BvhTriangle> = (0..make.triangles)
        .map(|_| BvhTriangle {
            a: r.signed().to_array(),
            b: r.signed().to_array(),
            c: r.signed().to_array(),
            ..BvhTriangle::default()
        })
        .collect();
    let operator = Operator {
        compression,
        ..operator(make.form, rows, &links)
    };
    let info = info(make.triangles as u64);
    let data = SceneData {
        visibility: None,
        probes: None,
        occluders: None,
        fmm: None,
        illumination: Vec::new(),
        materials: make.has_dynamic_materials.then(|| materials(r, senders)),
        sky: make.sky.then(|| SkyVisibility {
            senders: (0..senders)
                .map(|_| std::array::from_fn(|_| r.signed().x))
                .collect(),
        }),
        bvh: Bvh {
            nodes: chain(triangles.len()),
            triangles,
        },
        points,
        surfaces,
        level_starts: starts,
        sender_levels: make.sender_levels,
        light_samples: samples,
        pull: Weights::from_rows(pull),
        parents: Weights::from_rows(parents),
        bounces,
        bounds: info.bounds,
        operator,
        display: FlatBasis {
            radius,
            planes,
            grid,
        },
    };
    let mut scene = BakedScene::new(data, info);
    if let Some(linked) = make.octree {
        scene.data_mut().fmm = Some(octree(&scene));
        scene.data_mut().illumination = scene
            .data()
            .points
            .iter()
            .map(|p| p.position.map(f32::abs))
            .collect();
        if !linked {
            scene.data_mut().operator.rows.fill(Row::default());
            scene.data_mut().operator.links.clear();
        }
    }
    if make.quantized {
        quantize(scene.data_mut());
    }
    if make.occluded {
        add_occluders(&mut scene);
    }
    if make.has_visibility {
        let known = scene.data().level_starts[make.sender_levels as usize] as usize;
        let mut points = scene.data().points[..known].iter();
        let mut triangle = || [0; 3].map(|_| points.next().map_or(Vec3::Y, |p| p.x() + 0.1));
        let mesh = TriangleMesh::new(
            vec![triangle(), triangle()],
            vec![0; 2],
            vec![Material::default()],
        );
        scene.data_mut().visibility =
            Some(compute_visibility(&scene.data().points[..known], &mesh));
    }
    scene.info_mut().tiers = TierInfo::from_scene(scene.data());
    scene
}

/// Visibility of points in a mesh, in several clusters of several components.
fn compute_visibility(points: &[Point], mesh: &TriangleMesh) -> Visibility {
    let points: Vec<_> = points.iter().map(|p| (p.x(), p.n())).collect();
    let settings = VisibilitySettings {
        recipe: VisibilityRecipe {
            directions: 16,
            coefficients: 5,
            cluster_size: 4,
            ..VisibilityRecipe::default()
        },
        ..VisibilitySettings::default()
    };
    bake_visibility(mesh, &points, &settings, &|_| true)
        .expect("little enough")
        .0
}

/// Adds two occluders of one triangle each. Half of every third link passes the first occluder, and
/// in one way or another the second.
fn add_occluders(scene: &mut BakedScene) {
    let count = scene.data().bvh.triangles.len();
    for (k, triangle) in scene.data_mut().bvh.triangles[count - 2..]
        .iter_mut()
        .enumerate()
    {
        (triangle.occluder, triangle.transmittance) = (k as u32 + 1, 1.0);
    }
    let mut terms = Vec::new();
    for (at, link) in scene
        .data_mut()
        .operator
        .links
        .iter_mut()
        .enumerate()
        .step_by(3)
    {
        for set in [at as u16 % 2, 2] {
            let half = Link::pack(0.5 * link.vector(), 1.0, set);
            terms.push(PackedLinkTerm {
                link: at as u32,
                xy: half.xy,
                z_set: half.z_sender,
            });
        }
        let parts = terms[terms.len() - 2..].iter();
        *link = link_of_parts(parts.map(|p| p.vector()), link.sender());
    }
    scene.data_mut().occluders = Some(Occluders {
        names: vec!["door".into(), "lift \"1\"".into()],
        sets: vec![0, 1, 3],
        links: terms,
        probes: Vec::new(),
    });
}

/// Quantizes the links of two of three rows.
fn quantize(scene: &mut SceneData) {
    let senders = scene.senders();
    let operator = &mut scene.operator;
    operator.steps = vec![0; operator.rows.len()];
    operator.precision = (0..=senders).map(|j| (j % 4 * 12) as u8).collect();
    for (i, row) in operator.rows.iter().enumerate() {
        let code = if row.tier > 0 { [24, 0, 40][i % 3] } else { 0 };
        let point = &scene.points[i];
        let Some(quantizer) =
            RowQuantizer::new(code, point, &scene.points[..senders], &operator.precision)
        else {
            continue;
        };
        operator.steps[i] = code;
        for link in &mut operator.links[row.start as usize..][..row.count as usize] {
            *link = quantizer.quantize(0.98 * link.vector(), link.sender());
        }
    }
}

/// Returns an octree with entries in all four lists, over positions unrelated to the scene: two
/// walls that face each other, and a floor.
fn octree(scene: &BakedScene) -> FmmOperator {
    let r = &mut Random(99);
    let (finest, senders) = (scene.data().finest_senders(), scene.data().senders());
    let mut of = Vec::new();
    let mut points = Vec::new();
    let mut add = |i: usize, weight: f32| {
        let (u, v) = (2.0 * r.unit() - 1.0, r.unit());
        let (position, normal) = match i % 3 {
            0 => (Vec3::new(-1.0, v, u), Vec3::X),
            1 => (Vec3::new(1.0, v, u), Vec3::NEG_X),
            _ => (Vec3::new(2.0 * v - 1.0, -0.1, u), Vec3::Y),
        };
        of.push(i as u32);
        points.push(FmmPoint {
            position,
            normal,
            weight,
            receives: weight == 0.0,
        });
    };
    for i in finest.clone().chain(finest.clone()).chain(finest) {
        add(i, 0.05);
    }
    (0..senders).for_each(|i| add(i, 0.0));
    let settings = FmmSettings {
        order: 1,
        leaf: 2,
        separation: 0.8,
        slack: 1.0,
        ..FmmSettings::default()
    };
    let fmm = Fmm::new(&points, &settings, None).unwrap();
    let mut operator = fmm.operator(|at| of[at as usize]);
    for point in operator.points.iter_mut().filter(|p| p.share == 0.0) {
        point.sky = scene.data().surfaces[point.point as usize].sky;
        point.factor = 0.9;
    }
    operator
}

/// Returns clusters of three senders and a cluster of the remaining ones. Each has the constant
/// vector and one more of length one. The sky's column follows them.
fn columns(own: Vec<u32>, senders: u32) -> Compression {
    let mut out = Compression::default();
    let mut push = |member: usize, halves: &[u32], scale: f32| {
        out.columns.push(Column {
            member: member as u32,
            count: halves.len() as u32,
            value: out.values.len() as u32,
            scale,
        });
        let word = |w: &[u32]| w[0] | w.get(1).copied().unwrap_or(0) << 16;
        out.values.extend(halves.chunks(2).map(word));
    };
    // Halves: one, and minus one.
    const ONE: u32 = 0x3c00;
    const LESS: u32 = 0xbc00;
    let mut member = 0;
    for cluster in own.chunks(3) {
        let n = cluster.len();
        push(member, &vec![ONE; n], 1.0 / (n as f32).sqrt());
        if n > 1 {
            let mut up = vec![0; n];
            (up[0], up[n - 1]) = (ONE, LESS);
            push(member, &up, 0.5f32.sqrt());
        }
        member += n;
    }
    push(member, &[ONE], 1.0);
    out.members = own;
    out.members.push(senders);
    out
}

/// Returns a tree that splits off one triangle per tree depth.
fn chain(triangles: usize) -> Vec<BvhNode> {
    let node = |first: u32, count: u32| BvhNode {
        min: [-1.1; 3],
        first,
        max: [1.1; 3],
        count,
    };
    let mut nodes = Vec::new();
    match triangles {
        0 => {}
        1 => nodes.push(node(0, 1)),
        n => {
            nodes.push(node(1, 0));
            for i in 0..n - 1 {
                nodes.push(node(i as u32, 1));
                nodes.push(if i + 2 == n {
                    node(i as u32 + 1, 1)
                } else {
                    node(2 * i as u32 + 3, 0)
                });
            }
        }
    }
    nodes
}

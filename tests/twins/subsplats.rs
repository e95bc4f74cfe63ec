//! Comparison of the kernels of subsplats with their twins, on a view of the Cornell box. Tests
//! `pyramid`, `refine`, `splat` (nodes) and `upsample`, alone and together.

#[path = "volume.rs"]
mod volume;

use super::compare::{self, HALF, Scale, reported};
use super::depth::depth_texture;
use super::picture::wide;
use super::{baked, cpu, harness, settings, solve_from_projection};
use bevy_meshless_gi::gpu::{GpuFrame, HeadlessDevice, KernelPipelines};
use bevy_meshless_gi::internals::gpu::{
    EntryPoint, SplatTargets, SubsplatBuffers, SubsplatTargets, ViewBuffers,
};
use glam::{Mat4, Vec3};
use half::f16;
use meshless_gi::internals::frame::pyramid::{CellRange, GbufferView, pyramid};
use meshless_gi::internals::frame::{
    CompositeParams, SplatParams, SubsplatParams, Subsplats, VectorIrradiance, probe, splat,
    subsplats,
};
use meshless_gi::{
    BakedScene, BounceMode, CpuFrame, DepthTest, Material, NormalTest, ProbeSettings, Recipe,
    SubsplatSettings, TransportMethod, TriangleMesh, load_gltf,
};
use meshless_gi_lab::accuracy::RaycastView;
use std::collections::BTreeSet;
use std::f32::consts::{PI, TAU};
use wgpu::{TextureFormat, TextureUsages, TextureViewDescriptor};

/// Size of the picture in pixels, not a multiple of any workgroup size.
const SIZE: [u32; 2] = [163, 121];
const SCALE: f32 = 0.3;

/// View of the box, which is rotated and moved in world space.
struct Scene {
    view: RaycastView,
    scene: BakedScene,
    twin: CpuFrame,
    view_from_world: Mat4,
    view_from_clip: Mat4,
}

/// Returns the box without dynamic objects.
fn box_mesh() -> TriangleMesh {
    let path = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/tests/data/cornell/cornell.glb"
    );
    load_gltf(path).unwrap().mesh
}

/// Returns a ball of flat triangles.
fn ball(center: Vec3, radius: f32) -> TriangleMesh {
    let at = |i: u32, j: u32| {
        let (a, b) = (TAU * i as f32 / 24.0, PI * j as f32 / 12.0);
        center + radius * Vec3::new(b.sin() * a.cos(), b.cos(), b.sin() * a.sin())
    };
    let faces = (0..24).flat_map(|i| (0..12).map(move |j| (i, j)));
    let triangles: Vec<_> = faces
        .flat_map(|(i, j)| {
            let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
            [[a, b, c], [a, c, d]]
        })
        .collect();
    let count = triangles.len();
    TriangleMesh::new(
        triangles,
        vec![0; count],
        vec![Material::diffuse(Vec3::ONE)],
    )
}

impl Scene {
    fn new() -> Self {
        Self::with_geometry(
            baked::cornell(TransportMethod::Bounded, BounceMode::Runtime),
            &box_mesh(),
        )
    }

    /// Adds a floating dynamic ball, which probes light.
    fn with_ball() -> Self {
        let mut scene = baked::bake_box(&Recipe {
            probes: Some(ProbeSettings {
                spacing: Some(0.8),
                rays_per_probe: None,
            }),
            ..baked::recipe(TransportMethod::Bounded, BounceMode::Runtime)
        });
        let probes = scene.data_mut().probes.as_mut().unwrap();
        assert!(probes.points.len() > 100 && !probes.planes.is_empty());
        // Some planes are tilted, like those of occluders.
        let tilted_planes = probes.planes.iter_mut().step_by(2);
        tilted_planes.for_each(|p| *p = p.map(|c| 1.1 * c));
        let drawn = TriangleMesh::joined(vec![box_mesh(), ball(Vec3::new(2.2, 2.4, 1.2), 0.9)]);
        Self::with_geometry(scene, &drawn)
    }

    fn with_geometry(scene: BakedScene, drawn: &TriangleMesh) -> Self {
        let twin = cpu(&scene, &baked::lights(), &settings(2, false));
        let aspect = SIZE[0] as f32 / SIZE[1] as f32;
        let clip_from_view = Mat4::perspective_infinite_reverse_rh(0.9, aspect, 0.1);
        let view_from_world =
            Mat4::look_at_rh(Vec3::new(3.4, 2.9, -6.5), Vec3::new(2.6, 2.4, 2.8), Vec3::Y);
        let mut view = RaycastView::new(drawn, clip_from_view * view_from_world, SIZE);
        // A hole in the picture, and an area without light.
        for y in 50..60 {
            for x in 40..70 {
                view.depth[y * SIZE[0] as usize + x] = 0.0;
                view.gbuffer[(y + 30) * SIZE[0] as usize + x][3] |= 1 << 24;
            }
        }
        Self {
            view,
            scene,
            twin,
            view_from_world,
            view_from_clip: clip_from_view.inverse(),
        }
    }

    fn picture(&self) -> GbufferView<'_> {
        GbufferView {
            depth: &self.view.depth,
            gbuffer: &self.view.gbuffer,
        }
    }

    fn params(&self, settings: &SubsplatSettings) -> SubsplatParams {
        let viewport = [0.0, 0.0, SIZE[0] as f32, SIZE[1] as f32];
        SubsplatParams::new(
            settings,
            self.view_from_clip,
            self.view_from_world,
            viewport,
            SIZE,
        )
    }

    fn splat_params(&self) -> SplatParams {
        let params = SplatParams::new(
            self.view.world_from_clip,
            Mat4::IDENTITY,
            [0.0, 0.0, SIZE[0] as f32, SIZE[1] as f32],
            SIZE,
            SCALE,
            (&self.scene.data().display.grid).into(),
        );
        SplatParams {
            // A wide seam, so that surfaces and probes share many pixels of the baked scene itself.
            seam: self.scene.data().probes.as_ref().map_or(0.0, |_| 1.2),
            ..params
        }
    }

    fn on_cpu(&self, settings: &SubsplatSettings, scene: &BakedScene) -> Subsplats {
        let params = self.splat_params();
        subsplats(&self.params(settings), &self.picture(), &|pixel, node| {
            let i = (pixel[1] * SIZE[0] + pixel[0]) as usize;
            let (depth, texel) = (self.view.depth[i], self.view.gbuffer[i]);
            let values = self.twin.vector_irradiance();
            splat::splat_node(&params, scene.data(), values, pixel, depth, texel, node);
            if let Some(probes) = &scene.data().probes {
                let params = params.with_grid((&probes.grid).into());
                let values = self.twin.probes();
                probe::probe_node(&params, probes, values, pixel, depth, texel, node);
            }
        })
    }
}

/// Results of the device.
struct OnGpu {
    cells: Vec<CellRange>,
    /// Cells listed per level, and number of cells that were divided to list them.
    lists: Vec<(BTreeSet<u32>, u32)>,
    texels: Vec<[f32; 4]>,
}

fn on_gpu(harness: &HeadlessDevice, of: &Scene, settings: &SubsplatSettings) -> OnGpu {
    let kernels = KernelPipelines::new(&harness.device).unwrap();
    let frame = GpuFrame::new(
        &kernels,
        &harness.queue,
        &of.scene,
        of.twin.lights().len() as u32,
    )
    .unwrap();
    let frame = solve_from_projection(
        harness,
        &kernels,
        frame,
        &of.twin,
        &super::settings(2, false),
    );
    let depth = depth_texture(harness, SIZE, &of.view.depth);
    let gbuffer = harness.texture(
        SIZE,
        TextureFormat::Rgba32Uint,
        TextureUsages::TEXTURE_BINDING,
        Some(&of.view.gbuffer),
    );
    let output = harness.texture::<[f16; 4]>(
        SIZE,
        TextureFormat::Rgba16Float,
        TextureUsages::STORAGE_BINDING | TextureUsages::COPY_SRC,
        None,
    );
    let view = |t: &wgpu::Texture| t.create_view(&TextureViewDescriptor::default());
    let (depth, gbuffer, target) = (view(&depth), view(&gbuffer), view(&output));
    let params = of.params(settings);
    let levels = params.levels();
    let mut buffers = SubsplatBuffers::new(&harness.device, &harness.queue, levels).unwrap();
    let mut splat = ViewBuffers::new(&harness.device);
    splat.write(
        &harness.queue,
        &of.splat_params(),
        &CompositeParams::default(),
    );
    let probe_params = frame.probe_params(&of.splat_params());
    splat.write_probes(&harness.device, &harness.queue, probe_params.as_ref());
    // Run twice, because the second frame starts from the results of the first.
    for _ in 0..2 {
        buffers.write(&harness.queue, &params);
        harness
            .run(|encoder| {
                buffers.record(
                    &kernels,
                    encoder,
                    &SubsplatTargets {
                        depth: &depth,
                        gbuffer: &gbuffer,
                        output: &target,
                    },
                    &[(frame.buffers(), &splat)],
                    None,
                );
            })
            .unwrap();
    }
    let counters = buffers.counters();
    assert_eq!(counters.dispatches_of(EntryPoint::PyramidBase), 2);
    assert_eq!(counters.dispatches_of(EntryPoint::Fill), 2);
    let nodes = [EntryPoint::SplatNodes, EntryPoint::ProbeNodes].map(|p| counters.dispatches_of(p));
    assert_eq!(nodes[1], if frame.has_probes() { nodes[0] } else { 0 });
    let all: Vec<u32> = harness
        .read(buffers.lists(), levels.total() as usize)
        .unwrap();
    let lists = (0..=levels.coarsest_level)
        .map(|k| {
            let count: Vec<u32> = harness.read(buffers.count_of(k), 8).unwrap();
            let start = levels.starts[k as usize] as usize;
            let items = count[3].min(levels.cells(k)) as usize;
            let set: BTreeSet<u32> = all[start..start + items].iter().copied().collect();
            assert_eq!(set.len(), items, "level {k} lists a cell twice");
            (set, count[4])
        })
        .collect();
    OnGpu {
        cells: harness
            .read(buffers.cells(), levels.starts[0] as usize)
            .unwrap(),
        lists,
        texels: wide(&harness.read_texture::<[f16; 4]>(&output).unwrap()),
    }
}

/// Counts texels that differ by more than the error of half floats and of sums in another order.
fn differing(gpu: &[[f32; 4]], cpu: &[[f32; 4]]) -> usize {
    compare::differing(gpu, cpu, 4, 4.0 * HALF, Scale::Float).len()
}

/// Returns the cells that are on only one of the two lists.
fn cells_in_one_list(gpu: &BTreeSet<u32>, cpu: &BTreeSet<u32>) -> Vec<u32> {
    gpu.symmetric_difference(cpu).copied().collect()
}

fn compare(settings: &SubsplatSettings) {
    let harness = harness();
    let of = Scene::new();
    let gpu = on_gpu(&harness, &of, settings);
    let cpu = of.on_cpu(settings, &of.scene);
    let params = of.params(settings);

    // pyramid. The bytes of a normal may round either way.
    let cells = pyramid(&params, &of.picture());
    let close = |a: f32, b: f32| (a - b).abs() <= 1e-4 * a.abs().max(b.abs()).max(0.1);
    let byte = |a: u32, b: u32| {
        a.to_le_bytes()
            .iter()
            .zip(b.to_le_bytes())
            .all(|(a, b)| (*a as i8 - b as i8).abs() <= 1)
    };
    let bits = |a: u32, b: u32| match settings.normal {
        NormalTest::MinMax(_) => byte(a, b),
        _ => (f32::from_bits(a) - f32::from_bits(b)).abs() < 2e-3 || a == b,
    };
    let wrong = |cells: &[CellRange]| -> Vec<usize> {
        let same = |g: &CellRange, c: &CellRange| {
            close(g.near, c.near)
                && close(g.far, c.far)
                && bits(g.low, c.low)
                && bits(g.high, c.high)
        };
        (0..cells.len())
            .filter(|&i| !same(&gpu.cells[i], &cells[i]))
            .collect()
    };
    // Perturbs each number of a cell alone.
    let perturb_bits: fn(u32) -> u32 = match settings.normal {
        NormalTest::MinMax(_) => |word| word ^ 0x10,
        _ => |word| (f32::from_bits(word) + 1e-2).to_bits(),
    };
    let perturbations: [&dyn Fn(&mut CellRange); 4] = [
        &|c| c.near += 1e-3 * c.near.abs().max(0.1),
        &|c| c.far += 1e-3 * c.far.abs().max(0.1),
        &|c| c.low = perturb_bits(c.low),
        &|c| c.high = perturb_bits(c.high),
    ];
    for perturb in perturbations {
        reported(cells.len(), |item| {
            let mut cells = cells.clone();
            if let Some(item) = item {
                perturb(&mut cells[item]);
            }
            wrong(&cells)
        });
    }
    let found = wrong(&cells);
    if let Some(&i) = found.first() {
        let (of, gpu, cpu) = (found.len(), gpu.cells[i], cells[i]);
        panic!("{of} cells differ, the first is {i}: GPU {gpu:?}, CPU {cpu:?}");
    }
    let mut perturbed = of.view.depth.clone();
    perturbed[14_750] *= 1.1;
    let picture = GbufferView {
        depth: &perturbed,
        ..of.picture()
    };
    assert!(
        !wrong(&pyramid(&params, &picture)).is_empty(),
        "a changed depth is not detected"
    );

    // refine. A node within rounding of a threshold may be on either side of it.
    let mut listed = 0;
    for (k, (set, divided)) in gpu.lists.iter().enumerate() {
        let twin: BTreeSet<u32> = cpu.lists[k].iter().copied().collect();
        listed += twin.len();
        let apart = cells_in_one_list(set, &twin).len();
        // A missing cell, and a surplus cell.
        if let Some(cell) = set.intersection(&twin).next() {
            let mut fewer = twin.clone();
            fewer.remove(cell);
            assert_eq!(cells_in_one_list(set, &fewer).len(), apart + 1);
            fewer.insert(u32::MAX);
            assert_eq!(cells_in_one_list(set, &fewer).len(), apart + 2);
        }
        println!(
            "level {k}: {} listed, {} by the twin, {divided} divided",
            set.len(),
            twin.len()
        );
        assert!(
            apart * 200 <= twin.len() + 200,
            "level {k}: {apart} of {} cells",
            twin.len()
        );
    }
    assert!(listed > 500, "{listed}");

    // All kernels.
    let found = differing(&gpu.texels, &cpu.texels);
    println!("{found} of {} pixels differ", cpu.texels.len());
    assert!(
        found * 500 <= cpu.texels.len(),
        "{found} of {} pixels",
        cpu.texels.len()
    );
    let mut wrong = of.scene.clone();
    wrong
        .data_mut()
        .points
        .iter_mut()
        .for_each(|p| p.position[1] += 0.05);
    let perturbed = of.on_cpu(settings, &wrong);
    let noticed = differing(&gpu.texels, &perturbed.texels);
    let lit = cpu.texels.iter().filter(|t| t[3] == 1.0).count();
    println!("{noticed} of {lit} lit pixels differ from points that were moved");
    assert!(lit * 2 > cpu.texels.len() && noticed * 20 > lit);
}

#[test]
fn subsplats_by_plane_and_normal_match_twin() {
    compare(&SubsplatSettings::default());
}

#[test]
fn subsplats_by_extrema_match_twin() {
    compare(&SubsplatSettings {
        coarsest_level: 6,
        finest_level: 2,
        depth: DepthTest::MinMax(0.05),
        normal: NormalTest::MinMax(0.5),
        radiance_threshold: 1e30,
        detail: 0.5,
        ..SubsplatSettings::default()
    });
}

#[test]
fn subsplats_by_derivatives_and_curvature_match_twin() {
    compare(&SubsplatSettings {
        coarsest_level: 5,
        depth: DepthTest::Derivative(0.05),
        normal: NormalTest::Curvature(0.3),
        diagonal: false,
        ..SubsplatSettings::default()
    });
}

#[test]
fn probe_nodes_match_twin() {
    let harness = harness();
    let of = Scene::with_ball();
    let settings = SubsplatSettings::default();
    let gpu = on_gpu(&harness, &of, &settings);
    let cpu = of.on_cpu(&settings, &of.scene);
    let found = differing(&gpu.texels, &cpu.texels);
    println!("{found} of {} pixels differ", cpu.texels.len());
    assert!(found * 500 <= cpu.texels.len(), "{found} pixels differ");
    // Probes alone light the ball, and they light only the ball.
    let mut without = of.scene.clone();
    without.data_mut().probes = None;
    let dark = of.on_cpu(&settings, &without).texels;
    let lit = |texels: &[[f32; 4]]| texels.iter().filter(|t| t[3] == 1.0).count();
    let ball = lit(&cpu.texels) - lit(&dark);
    println!("{ball} pixels are lit by probes");
    assert!(ball > 500, "{ball}");
    for (what, perturb) in [
        (
            "positions",
            (|p| p.points.iter_mut().for_each(|p| p.position[1] += 0.1)) as Perturb,
        ),
        ("radii", |p| {
            p.points.iter_mut().for_each(|p| p.radius *= 0.9)
        }),
    ] {
        let mut wrong = of.scene.clone();
        perturb(wrong.data_mut().probes.as_mut().unwrap());
        let noticed = differing(&gpu.texels, &of.on_cpu(&settings, &wrong).texels);
        assert!(noticed * 10 > ball, "{what} are not detected: {noticed}");
    }
}

type Perturb = fn(&mut meshless_gi::internals::asset::Probes);

#[test]
fn probe_kernel_matches_twin() {
    let harness = harness();
    let of = Scene::with_ball();
    let kernels = KernelPipelines::new(&harness.device).unwrap();
    let lights = of.twin.lights().len() as u32;
    let frame = GpuFrame::new(&kernels, &harness.queue, &of.scene, lights).unwrap();
    let mut frame = solve_from_projection(
        &harness,
        &kernels,
        frame,
        &of.twin,
        &super::settings(2, false),
    );

    // apply, over the rows of the probes.
    let probes = of.scene.data().probes.as_ref().unwrap();
    let values: Vec<VectorIrradiance> = harness
        .read(
            frame.buffers().output(EntryPoint::ProbeOver).unwrap(),
            probes.rows.len(),
        )
        .unwrap();
    let off = |values: &[VectorIrradiance]| {
        super::differing(
            &super::flat(values),
            &super::flat(of.twin.probes()),
            12,
            super::SINGLE,
            super::Scale::Rms,
        )
        .len()
    };
    assert_eq!(off(&values), 0);
    let mut moved = values.clone();
    moved.swap(3, 4);
    assert!(off(&moved) > 0, "swapped rows are not detected");

    // probe_over, from the device's own values.
    let read = TextureUsages::TEXTURE_BINDING | TextureUsages::COPY_SRC;
    let depth = depth_texture(&harness, SIZE, &of.view.depth);
    let gbuffer = harness.texture(
        SIZE,
        TextureFormat::Rgba32Uint,
        read,
        Some(&of.view.gbuffer),
    );
    let half4 = TextureFormat::Rgba16Float;
    let [earlier, output] = [0; 2].map(|_| {
        harness.texture::<[f16; 4]>(SIZE, half4, read | TextureUsages::STORAGE_BINDING, None)
    });
    let view_of = |t: &wgpu::Texture| t.create_view(&TextureViewDescriptor::default());
    let [depth, gbuffer, before, after] = [&depth, &gbuffer, &earlier, &output].map(view_of);
    let params = of.splat_params();
    let probe_params = frame.probe_params(&params).unwrap();
    let mut view = ViewBuffers::new(&harness.device);
    view.write(&harness.queue, &params, &CompositeParams::default());
    view.write_probes(&harness.device, &harness.queue, Some(&probe_params));
    harness
        .run(|encoder| {
            let targets = |earlier, output| SplatTargets {
                depth: &depth,
                gbuffer: &gbuffer,
                earlier,
                output,
            };
            frame.splat(&kernels, encoder, &view, &targets(None, &before));
            frame.probe(&kernels, encoder, &view, &targets(Some(&before), &after));
        })
        .unwrap();
    assert_eq!(frame.counters().dispatches_of(EntryPoint::ProbeOver), 1);
    let before = wide(&harness.read_texture::<[f16; 4]>(&earlier).unwrap());
    let gpu = wide(&harness.read_texture::<[f16; 4]>(&output).unwrap());
    let picture_of_probes =
        |probes, values: &[VectorIrradiance], params: &SplatParams| -> Vec<[f32; 4]> {
            (0..gpu.len())
                .map(|i| {
                    let pixel = [i as u32 % SIZE[0], i as u32 / SIZE[0]];
                    let (depth, texel) = (of.view.depth[i], of.view.gbuffer[i]);
                    probe::probe_pixel(params, probes, values, pixel, depth, texel, before[i])
                })
                .collect()
        };
    let expected = |values: &[VectorIrradiance], params: &SplatParams| {
        picture_of_probes(probes, values, params)
    };
    let twin = expected(&values, &probe_params);
    // A position within rounding of a clip plane may be on either side of it.
    assert!(differing(&gpu, &twin) <= 2, "{}", differing(&gpu, &twin));
    let lit = (0..gpu.len()).filter(|&i| before[i][3] == 0.0 && gpu[i][3] == 1.0);
    assert!(lit.count() > 500);
    // Pixels shared by surfaces and probes.
    let mixed = (0..gpu.len()).filter(|&i| before[i][3] > 0.0 && before[i][3] < 1.0);
    assert!(mixed.count() > 100);
    let count_wrong_shares = |seam: f32| {
        let params = SplatParams { seam, ..params };
        let values = of.twin.vector_irradiance();
        (0..gpu.len())
            .filter(|&i| {
                let pixel = [i as u32 % SIZE[0], i as u32 / SIZE[0]];
                let (depth, texel) = (of.view.depth[i], of.view.gbuffer[i]);
                let twin =
                    splat::splat_pixel(&params, of.scene.data(), values, pixel, depth, texel);
                (twin[3] - before[i][3]).abs() > 2e-3
            })
            .count()
    };
    assert!(
        count_wrong_shares(params.seam) <= 2,
        "{}",
        count_wrong_shares(params.seam)
    );
    assert!(count_wrong_shares(1.02 * params.seam) > 100);
    let mut moved = values.clone();
    moved.rotate_left(3);
    assert!(differing(&gpu, &expected(&moved, &probe_params)) > 200);
    let brighter = SplatParams {
        scale: 1.01 * SCALE,
        ..probe_params
    };
    assert!(differing(&gpu, &expected(&values, &brighter)) > 400);
    let mut upright = probes.clone();
    let tilted_planes = upright.planes.iter_mut().step_by(2);
    tilted_planes.for_each(|p| *p = p.map(|c| c / 1.1));
    let found = differing(&gpu, &picture_of_probes(&upright, &values, &probe_params));
    assert!(found > 20, "tilted planes are not detected: {found}");
}

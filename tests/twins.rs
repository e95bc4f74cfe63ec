//! Comparison of every kernel with its CPU twin, on any adapter (a software one is enough). Without
//! an adapter the tests fail. Each comparison is repeated with a wrong input and with one wrong
//! item, and must fail.

#[path = "twins/baked.rs"]
mod baked;
#[path = "twins/channels.rs"]
mod channels;
#[path = "twins/compare.rs"]
mod compare;
#[path = "twins/depth.rs"]
mod depth;
#[path = "twins/fmm.rs"]
mod fmm;
#[path = "twins/fog.rs"]
mod fog;
#[path = "twins/vpl_specular.rs"]
mod vpl_specular;
use meshless_gi_lab::fixtures::gloss as gloss_support;
#[path = "twins/occlude.rs"]
mod occlude;
#[path = "twins/picture.rs"]
mod picture;
#[path = "twins/rsm.rs"]
mod rsm;
#[path = "twins/screen.rs"]
mod screen;
#[path = "twins/soft_shadow.rs"]
mod soft_shadow;
#[path = "twins/subsplats.rs"]
mod subsplats;
#[path = "twins/subtract_shadow.rs"]
mod subtract_shadow;
use meshless_gi_lab::fixtures::synthetic;
#[path = "twins/volume_sample.rs"]
mod volume_sample;

use bevy_meshless_gi::gpu::{GpuError, GpuFrame, HeadlessDevice, KernelPipelines, SceneBuffers};
use bevy_meshless_gi::internals::gpu::EntryPoint;
use compare::{SINGLE, Scale, differing, same};
use glam::Vec3;
use meshless_gi::internals::asset::SkyVisibility;
use meshless_gi::internals::frame::project;
use meshless_gi::internals::transport::pca::Column;
use meshless_gi::internals::transport::{Link, Row, SenderForm};
use meshless_gi::{BakedScene, CpuFrame, FrameLight, FrameSettings, SkyRadiance};

/// Opens a device without a surface. Panics if there is no adapter.
fn harness() -> HeadlessDevice {
    let harness = HeadlessDevice::new()
        .unwrap_or_else(|error| panic!("{error}; install a driver (Mesa's llvmpipe is enough)"));
    eprintln!("compared on {}", harness.adapter);
    harness
}

fn settings(sweeps: u32, baked_bounces: bool) -> FrameSettings {
    FrameSettings {
        sweeps,
        baked_bounces,
        sky: Vec3::new(0.2, 0.3, 0.5).into(),
        emission: 0.8,
        tier: FrameSettings::ALL_TIERS,
        ..FrameSettings::default()
    }
}

fn cpu(scene: &BakedScene, lights: &[FrameLight], settings: &FrameSettings) -> CpuFrame {
    let mut frame = CpuFrame::new(scene);
    frame.set_lights(scene, lights);
    assert!(frame.solve(scene, settings));
    frame
}

/// Solves a frame on the device from the CPU's projection. A shadow ray that grazes an edge does
/// not affect the kernels after `project`.
fn solve_from_projection(
    harness: &HeadlessDevice,
    kernels: &KernelPipelines,
    frame: GpuFrame,
    twin: &CpuFrame,
    settings: &FrameSettings,
) -> GpuFrame {
    let mut frame = frame;
    let lights = twin.lights();
    frame.set_lights(kernels, &harness.queue, lights).unwrap();
    let projected: Vec<f32> = (0..lights.len())
        .flat_map(|s| twin.projected(s).to_vec())
        .collect();
    let buffer = frame.buffers().output(EntryPoint::Project).unwrap();
    harness
        .queue
        .write_buffer(buffer, 0, bytemuck::cast_slice(&projected));
    harness
        .run(|encoder| frame.solve(kernels, &harness.queue, encoder, settings))
        .unwrap();
    frame
}

fn output<T: bytemuck::AnyBitPattern + bytemuck::NoUninit>(
    harness: &HeadlessDevice,
    frame: &GpuFrame,
    entry_point: EntryPoint,
    count: usize,
) -> Vec<T> {
    harness
        .read(frame.buffers().output(entry_point).unwrap(), count)
        .unwrap()
}

/// Returns the items of the projection that differ, and the number of shadow rays among them on the
/// other side of an edge.
fn projection_problems(
    scene: &BakedScene,
    lights: &[FrameLight],
    gpu: &[f32],
    cpu: &CpuFrame,
) -> (usize, usize) {
    let twin: Vec<f32> = (0..lights.len())
        .flat_map(|s| cpu.projected(s).to_vec())
        .collect();
    let senders = scene.data().senders();
    let finest = scene.data().finest_senders().start;
    let found = differing(gpu, &twin, 1, SINGLE, Scale::Item);
    let flips = found.iter().filter(|&&i| {
        // The difference equals the contribution of one of the sender's samples.
        let (light, j) = (&lights[i / senders], i % senders);
        let count = scene.data().light_samples.per_sender as usize;
        let difference = (gpu[i] - twin[i]).abs();
        let is = |whole: f32| {
            (difference - whole).abs() <= SINGLE * whole + SINGLE * gpu[i].max(twin[i])
        };
        if j < finest || count == 0 {
            let point = &scene.data().points[j];
            return is(project::unshadowed(light, point.x(), point.n()));
        }
        let own = &scene.data().light_samples.list[(j - finest) * count..(j - finest + 1) * count];
        let mut positions = project::samples_for_light(light, own);
        let used = positions.len() as f32;
        let (extent, apart) = (
            project::extent(scene.data()),
            project::sample_spacing(scene.data()),
        );
        positions.any(|p| is(project::unshadowed_within(light, p.x(), p.n(), extent, apart) / used))
    });
    (found.len(), flips.count())
}

#[test]
fn project_kernel_matches_twin() {
    let harness = harness();
    let kernels = KernelPipelines::new(&harness.device).unwrap();
    let scene = synthetic::scene(SenderForm::Averages);
    let lights = synthetic::lights();
    let twin = cpu(&scene, &lights, &settings(0, false));
    let shadowed = (0..lights.len()).any(|s| {
        // The coarser senders, which are lit at their own positions.
        let own = &scene.data().points[..scene.data().finest_senders().start];
        let pairs = twin.projected(s).iter().zip(own);
        pairs
            .into_iter()
            .any(|(&g, p)| g == 0.0 && project::unshadowed(&lights[s], p.x(), p.n()) > 0.0)
    });
    assert!(shadowed, "the scene has no shadows");

    // The capacity is three slots at first. When it grows, the existing projection stays.
    let mut frame = GpuFrame::new(&kernels, &harness.queue, &scene, 3).unwrap();
    frame
        .set_lights(&kernels, &harness.queue, &lights[..3])
        .unwrap();
    harness
        .run(|e| frame.project(&kernels, &harness.queue, e, &[0, 2, 1]))
        .unwrap();
    frame.set_lights(&kernels, &harness.queue, &lights).unwrap();
    let rest: Vec<u32> = (3..lights.len() as u32).collect();
    harness
        .run(|e| frame.project(&kernels, &harness.queue, e, &rest))
        .unwrap();
    assert_eq!(frame.counters().dispatches_of(EntryPoint::Project), 2);
    assert_eq!(frame.counters().projected, lights.len() as u64);

    let count = lights.len() * scene.data().senders();
    let gpu: Vec<f32> = output(&harness, &frame, EntryPoint::Project, count);
    // Only tolerance: a ray that passes an edge within rounding may be on either side of it. At
    // most two of 2970 rays differ.
    let (differing, flips) = projection_problems(&scene, &lights, &gpu, &twin);
    assert!(
        differing == flips && flips <= 2,
        "{differing} of {count} differ, {flips} of them by visibility"
    );

    let mut moved = lights.clone();
    moved[0].position[0] += 1e-3;
    let (differing, flips) = projection_problems(
        &scene,
        &moved,
        &gpu,
        &cpu(&scene, &moved, &settings(0, false)),
    );
    assert!(differing > flips, "a moved light is not detected");
    let mut bright = scene.clone();
    bright.data_mut().bvh.nodes.clear();
    let (differing, _) = projection_problems(
        &bright,
        &lights,
        &gpu,
        &cpu(&bright, &lights, &settings(0, false)),
    );
    assert!(
        differing > 100,
        "missing shadows are not detected: {differing}"
    );
    let mut elsewhere = scene.clone();
    elsewhere.data_mut().light_samples.list[5].position[1] += 0.01;
    let twin = cpu(&elsewhere, &lights, &settings(0, false));
    let (differing, flips) = projection_problems(&scene, &lights, &gpu, &twin);
    assert!(differing > flips, "a moved sample is not detected");
}

/// Projects more slots than one dispatch holds, from rectangles with many patches and many lights.
#[test]
fn project_above_dispatch_limit_matches_twin() {
    let harness = harness();
    let kernels = KernelPipelines::new(&harness.device).unwrap();
    let scene = synthetic::scene(SenderForm::Averages);
    let few = synthetic::lights();
    // Lights at the beginning, and around the start of the second dispatch.
    let mut lights = vec![FrameLight::default(); 70_000];
    let starts = [0, 65_472 - 5, 69_900];
    for start in starts {
        lights[start..start + few.len()].copy_from_slice(&few);
    }
    let mut frame = GpuFrame::new(&kernels, &harness.queue, &scene, 1).unwrap();
    frame.set_lights(&kernels, &harness.queue, &lights).unwrap();
    let all: Vec<u32> = (0..lights.len() as u32).collect();
    harness
        .run(|e| frame.project(&kernels, &harness.queue, e, &all))
        .unwrap();
    let counters = frame.counters();
    assert_eq!(
        (
            counters.dispatches_of(EntryPoint::Project),
            counters.projected
        ),
        (2, 70_000)
    );
    let lit = scene.data().senders();
    let gpu: Vec<f32> = output(&harness, &frame, EntryPoint::Project, lights.len() * lit);
    let of = |start: usize| &gpu[start * lit..(start + few.len()) * lit];
    assert!(of(0).iter().any(|g| *g > 0.0));
    for start in starts {
        assert_eq!(of(start), of(0), "from slot {start}");
    }
    let shining = starts.map(|s| s..s + few.len());
    let dark = |slot: &usize| !shining.iter().any(|s| s.contains(slot));
    for slot in (0..lights.len()).filter(dark) {
        assert!(gpu[slot * lit..(slot + 1) * lit].iter().all(|g| *g == 0.0));
    }
}

/// Checked result of a solve: kernel, GPU data, twin data, floats per item, scale.
type Checked = (
    &'static str,
    EntryPoint,
    fn(&CpuFrame) -> Vec<f32>,
    usize,
    Scale,
);

fn flat<T: bytemuck::NoUninit>(items: &[T]) -> Vec<f32> {
    bytemuck::cast_slice(items).to_vec()
}

/// Change that makes an input wrong.
type Perturb = fn(&mut BakedScene);

/// Solves on GPU and CPU, compares, and compares again with each of the `perturbations`.
fn assert_solve_matches_twin(
    form: SenderForm,
    settings: &FrameSettings,
    checked: &[(Checked, Perturb)],
) {
    assert_scene_matches_twin(&synthetic::scene(form), settings, checked);
}

fn assert_scene_matches_twin(
    scene: &BakedScene,
    settings: &FrameSettings,
    checked: &[(Checked, Perturb)],
) {
    let harness = harness();
    let kernels = KernelPipelines::new(&harness.device).unwrap();
    let form = scene.data().operator.form;
    let lights = synthetic::lights();
    let twin = cpu(scene, &lights, settings);
    let frame = GpuFrame::new(&kernels, &harness.queue, scene, lights.len() as u32).unwrap();
    let frame = solve_from_projection(&harness, &kernels, frame, &twin, settings);
    for (i, &((name, entry_point, take, width, scale), perturb)) in checked.iter().enumerate() {
        let expected = take(&twin);
        let gpu: Vec<f32> = output(&harness, &frame, entry_point, expected.len());
        let mut wrong = scene.clone();
        perturb(&mut wrong);
        let perturbed = take(&cpu(&wrong, &lights, settings));
        same(
            &format!("{name}, {form:?}, perturb {i}"),
            &gpu,
            &expected,
            &perturbed,
            width,
            scale,
        );
    }
}

/// Output of `radiosity` on the finest sender level, where `pull` does not replace it.
const SENDERS: Checked = (
    "senders",
    EntryPoint::Pull,
    |f| flat(f.senders()),
    4,
    Scale::Item,
);
/// Same as [`SENDERS`], for values with E⃗·n, a sum that may cancel.
const BOUNCED: Checked = (
    "senders",
    EntryPoint::Sweep,
    |f| flat(f.senders()),
    4,
    Scale::Rms,
);
const VALUES: Checked = (
    "values",
    EntryPoint::Averages,
    |f| flat(f.vector_irradiance()),
    12,
    Scale::Rms,
);

/// Adds one percent to the weight of entry `at`.
fn increase_weight(weights: &mut meshless_gi::internals::basis::Weights, at: usize) {
    weights.entries[at].weight *= 1.01;
}

/// Reverses a few links, from link `at` on. Several are needed because some senders are black.
fn reverse_links(scene: &mut BakedScene, at: usize) {
    for link in scene.data_mut().operator.links[at..].iter_mut().take(5) {
        *link = Link::pack(-link.vector(), 1.0, link.sender() as u16);
    }
}

#[test]
fn frame_of_averages_matches_twin() {
    assert_solve_matches_twin(
        SenderForm::Averages,
        &settings(0, false),
        &[
            (SENDERS, |s| s.data_mut().surfaces[97].albedo[1] += 0.001),
            (SENDERS, |s| s.data_mut().surfaces[95].emission[2] += 0.001),
            (SENDERS, |s| {
                s.data_mut().surfaces[90..100]
                    .iter_mut()
                    .for_each(|s| s.sky[0] += 0.1)
            }),
            (SENDERS, |s| increase_weight(&mut s.data_mut().pull, 12)),
            (VALUES, |s| reverse_links(s, 99)),
            (VALUES, |s| s.data_mut().operator.rows[20].scale *= 1.001),
            (VALUES, |s| {
                // The last point without its own row.
                let inactive = (0..s.data().points.len())
                    .rev()
                    .find(|&i| s.data().operator.rows[i].tier == 0);
                let at = s.data().parents.starts[inactive.unwrap()] as usize;
                increase_weight(&mut s.data_mut().parents, at);
            }),
        ],
    );
}

#[test]
fn frame_of_differences_matches_twin() {
    const PUSHED: Checked = (
        "push",
        EntryPoint::Push,
        |f| flat(f.differences()),
        4,
        Scale::Rms,
    );
    const APPLIED: Checked = (
        "apply",
        EntryPoint::Apply,
        |f| flat(f.applied_irradiance()),
        12,
        Scale::Rms,
    );
    const FLAT: Checked = (
        "flatten",
        EntryPoint::Differences,
        |f| flat(f.vector_irradiance()),
        12,
        Scale::Rms,
    );
    assert_solve_matches_twin(
        SenderForm::Differences,
        &settings(0, false),
        &[
            (PUSHED, |s| {
                (20..40).for_each(|at| increase_weight(&mut s.data_mut().parents, at))
            }),
            (APPLIED, |s| reverse_links(s, 1000)),
            (FLAT, |s| {
                // A parent on the coarsest level, where all rows are active.
                let first = s.data().parents.starts[s.data().points.len() - 1];
                increase_weight(&mut s.data_mut().parents, first as usize);
            }),
        ],
    );
}

#[test]
fn frame_of_components_matches_twin() {
    const COMPRESSED: Checked = (
        "compress",
        EntryPoint::Compress,
        |f| flat(f.components()),
        4,
        Scale::Rms,
    );
    const COLUMN: fn(&mut BakedScene) -> &mut Column = |s| {
        let compression = s.data_mut().operator.compression.as_mut().unwrap();
        &mut compression.columns[22]
    };
    for sweeps in [0, 2] {
        assert_solve_matches_twin(
            SenderForm::Components,
            &settings(sweeps, false),
            &[
                (COMPRESSED, |s| COLUMN(s).scale *= 1.002),
                (COMPRESSED, |s| COLUMN(s).member -= 1),
                (COMPRESSED, |s| COLUMN(s).count -= 1),
                (COMPRESSED, |s| {
                    let values = &mut s.data_mut().operator.compression.as_mut().unwrap().values;
                    values[20..60].iter_mut().for_each(|v| *v ^= 0x8000);
                }),
                (VALUES, |s| reverse_links(s, 99)),
                (VALUES, |s| COLUMN(s).scale *= 1.1),
            ],
        );
    }
}

#[test]
fn runtime_bounces_match_twin() {
    const FURTHER: Perturb = |s| {
        s.data_mut().surfaces[60..150]
            .iter_mut()
            .for_each(|m| m.albedo[0] *= 1.01)
    };
    for form in [SenderForm::Averages, SenderForm::Differences] {
        let both: [(Checked, Perturb); 4] = [
            (BOUNCED, FURTHER),
            (BOUNCED, |s| reverse_links(s, 40)),
            (BOUNCED, |s| {
                s.data_mut().points[60..150]
                    .iter_mut()
                    .for_each(|p| p.normal = [0.6, 0.8, 0.0])
            }),
            (VALUES, FURTHER),
        ];
        assert_solve_matches_twin(form, &settings(3, false), &both);
    }
}

/// Returns the scene with averages under a directional sky. Some links refer to the terms of the
/// sky.
fn scene_with_directional_sky() -> BakedScene {
    let mut scene = synthetic::scene(SenderForm::Averages);
    let mut random = synthetic::HashRandom::new(7);
    let senders = scene.data().senders();
    for (k, link) in scene
        .data_mut()
        .operator
        .links
        .iter_mut()
        .enumerate()
        .step_by(19)
    {
        let term = senders + 1 + k % 8;
        *link = Link::pack(link.vector(), 1.0, term as u16);
    }
    scene.data_mut().sky = Some(SkyVisibility {
        senders: (0..senders)
            .map(|_| std::array::from_fn(|_| random.signed()))
            .collect(),
    });
    scene
}

#[test]
fn directional_sky_matches_twin() {
    let sky = SkyRadiance::gradient(
        Vec3::new(0.2, 0.4, 1.0),
        Vec3::new(0.9, 0.7, 0.5),
        Vec3::new(0.1, 0.2, 0.1),
    );
    let aside = SkyRadiance {
        terms: std::array::from_fn(|k| Vec3::new(0.3, -0.2, 0.1) * (k as f32 - 3.0)),
        ..SkyRadiance::BLACK
    };
    for sweeps in [0, 2] {
        let settings = FrameSettings {
            sky: sky + aside,
            ..settings(sweeps, false)
        };
        assert_scene_matches_twin(
            &scene_with_directional_sky(),
            &settings,
            &[
                (BOUNCED, |s| {
                    let seen = &mut s.data_mut().sky.as_mut().unwrap().senders;
                    seen[80..120].iter_mut().for_each(|t| t[4] += 0.05);
                }),
                (VALUES, |s| {
                    let first = s.data().senders() as u32 + 1;
                    let links = s.data_mut().operator.links.iter_mut();
                    let terms = links.filter(|l| l.sender() > first);
                    terms.for_each(|l| *l = Link::pack(l.vector(), 1.0, l.sender() as u16 - 1));
                }),
            ],
        );
    }
}

/// Removes the rows of some points of tier 1, of senders if `senders`. These points then inherit.
fn remove_rows(scene: &mut BakedScene, senders: bool) {
    let (first, count) = (
        scene.data().level_starts[1] as usize,
        scene.data().senders(),
    );
    let range = if senders {
        first..count
    } else {
        count..scene.data().points.len()
    };
    let rows = scene.data_mut().operator.rows[range].iter_mut();
    let mut taken = 0;
    for row in rows.filter(|row| row.tier == 1).take(5) {
        row.tier = 0;
        taken += 1;
    }
    assert_eq!(taken, 5);
}

#[test]
fn tiers_match_twin() {
    for tier in 1..=4 {
        let settings = FrameSettings {
            tier,
            ..settings(2, false)
        };
        assert_solve_matches_twin(
            SenderForm::Averages,
            &settings,
            &[
                (VALUES, |s| reverse_links(s, 99)),
                (VALUES, |s| remove_rows(s, false)),
                (BOUNCED, |s| remove_rows(s, true)),
                (BOUNCED, |s| reverse_links(s, 40)),
            ],
        );
    }
}

#[test]
fn baked_bounces_match_twin() {
    const FURTHER: Checked = (
        "further",
        EntryPoint::Gather,
        |f| flat(f.multibounce_radiosity()),
        4,
        Scale::Item,
    );
    for form in [SenderForm::Averages, SenderForm::Differences] {
        assert_solve_matches_twin(
            form,
            &settings(3, true),
            &[
                (FURTHER, |s| {
                    s.data_mut().bounces.as_mut().unwrap().links[40].gain[1] *= 1.01
                }),
                // A parent on the coarsest level, of a sender on the next.
                (FURTHER, |s| {
                    let first = s.data().parents.starts[s.data().level_starts[1] as usize + 2];
                    increase_weight(&mut s.data_mut().parents, first as usize);
                }),
                (SENDERS, |s| {
                    s.data_mut().bounces.as_mut().unwrap().links[40].gain[1] *= 1.01
                }),
                (VALUES, |s| reverse_links(s, 77)),
            ],
        );
    }
}

#[test]
fn links_above_binding_limit_are_split() {
    let harness = harness();
    let kernels = KernelPipelines::new(&harness.device).unwrap();
    let scene = synthetic::scene(SenderForm::Averages);
    let lights = synthetic::lights();
    let settings = settings(2, false);
    let limit = size_of_val(scene.data().operator.links.as_slice()) as u64 / 3;
    let make = |limit| {
        SceneBuffers::with_limit(
            &harness.device,
            &harness.queue,
            &scene,
            lights.len() as u32,
            limit,
        )
    };
    for tier in [1, 2, 4] {
        let settings = FrameSettings { tier, ..settings };
        let twin = cpu(&scene, &lights, &settings);
        let frame = GpuFrame::with_buffers(&harness.queue, make(limit).unwrap());
        let frame = solve_from_projection(&harness, &kernels, frame, &twin, &settings);
        let parts = frame.counters().dispatches_of(EntryPoint::Apply);
        if tier == 4 {
            assert!(
                parts >= 4 + 2,
                "the last apply takes four parts, those of the sweeps one or more: {parts}"
            );
        }
        let gpu: Vec<f32> = output(
            &harness,
            &frame,
            EntryPoint::Averages,
            12 * scene.data().points.len(),
        );
        let mut wrong = scene.clone();
        // Links of the last part that this tier uses.
        let sizes = scene.data().operator.tier_sizes();
        reverse_links(&mut wrong, sizes[tier as usize - 1].1 as usize - 5);
        let perturbed = cpu(&wrong, &lights, &settings);
        same(
            &format!("parts, tier {tier}"),
            &gpu,
            &flat(twin.vector_irradiance()),
            &flat(perturbed.vector_irradiance()),
            12,
            Scale::Rms,
        );
    }

    let error = make(4096).unwrap_err();
    assert!(
        matches!(error, GpuError::TooLarge { bytes, limit: 4096, .. } if bytes > 4096),
        "{error}"
    );
}

/// Compares the whole frame of real bakes, from lights to vector irradiance, with the projection.
#[test]
fn cornell_box_bakes_match_twin() {
    use meshless_gi::{BounceMode, TransportMethod};
    let harness = harness();
    let kernels = KernelPipelines::new(&harness.device).unwrap();
    for (rule, mode) in [
        (TransportMethod::Bounded, BounceMode::Runtime),
        (TransportMethod::Bounded, BounceMode::Baked),
        (TransportMethod::L08, BounceMode::Runtime),
        (TransportMethod::pca(), BounceMode::Runtime),
        (TransportMethod::fmm(), BounceMode::Runtime),
    ] {
        let scene = baked::cornell(rule, mode);
        eprintln!(
            "{rule:?}, {mode:?}: {} points, {} links",
            scene.data().points.len(),
            scene.data().operator.links.len()
        );
        let lights = baked::lights();
        let settings = FrameSettings::bounces(3);
        let twin = cpu(&scene, &lights, &settings);
        let mut frame =
            GpuFrame::new(&kernels, &harness.queue, &scene, lights.len() as u32).unwrap();
        frame.set_lights(&kernels, &harness.queue, &lights).unwrap();
        let all: Vec<u32> = (0..lights.len() as u32).collect();
        harness
            .run(|e| frame.project(&kernels, &harness.queue, e, &all))
            .unwrap();
        let count = lights.len() * scene.data().senders();
        let gpu: Vec<f32> = output(&harness, &frame, EntryPoint::Project, count);
        // As in `project`, a ray within rounding of an edge may be on either side of it. At most
        // one in 10 000.
        let (differing, flips) = projection_problems(&scene, &lights, &gpu, &twin);
        assert!(
            differing == flips && flips <= count / 10_000,
            "{rule:?}: {differing} of {count} differ, {flips} by visibility"
        );

        let mut wrong = lights.clone();
        wrong[0].color[1] *= 1.001;
        // One frame for all tiers, so no data of one may remain in the next.
        for tier in (1..=scene.data().tiers()).rev() {
            let settings = FrameSettings { tier, ..settings };
            let twin = cpu(&scene, &lights, &settings);
            frame = solve_from_projection(&harness, &kernels, frame, &twin, &settings);
            let expected = flat(twin.vector_irradiance());
            let gpu: Vec<f32> = output(&harness, &frame, EntryPoint::Averages, expected.len());
            let perturbed = flat(cpu(&scene, &wrong, &settings).vector_irradiance());
            same(
                &format!("{rule:?}, {mode:?}, tier {tier}"),
                &gpu,
                &expected,
                &perturbed,
                12,
                Scale::Rms,
            );
        }
    }
}

/// Tests the fallback of an octree, which transports all light without links. If the octree exceeds
/// a device limit, links on the same points replace it. Without such links, the frame is not
/// created.
#[test]
fn octree_above_limit_falls_back_to_links() {
    use bevy_meshless_gi::internals::plan::{FmmLimit, fmm_fallback_reason};
    use meshless_gi::{BounceMode, TransportMethod};
    let harness = harness();
    let kernels = KernelPipelines::new(&harness.device).unwrap();
    let mut scene = baked::cornell(TransportMethod::fmm(), BounceMode::Runtime);
    let run = |scene: &BakedScene| {
        let mut frame = GpuFrame::new(&kernels, &harness.queue, scene, 8).unwrap();
        harness
            .run(|e| frame.solve(&kernels, &harness.queue, e, &FrameSettings::bounces(3)))
            .unwrap();
        let passes = [
            EntryPoint::Pull,
            EntryPoint::Apply,
            EntryPoint::FmmUp,
            EntryPoint::FmmEvaluate,
        ];
        passes.map(|p| frame.counters().dispatches_of(p))
    };
    let levels = scene.data().fmm.as_ref().unwrap().levels() as u64;
    assert_eq!(run(&scene), [0, 0, 3 * levels, 3]);
    assert_eq!(fmm_fallback_reason(&scene, 128 << 20), None);
    let reason = fmm_fallback_reason(&scene, 1 << 16);
    assert!(
        matches!(reason, Some(FmmLimit::TooLarge { has: 65536, .. })),
        "{reason:?}"
    );
    // An order that is too large for a workgroup.
    scene.data_mut().fmm.as_mut().unwrap().order = 7;
    let reason = fmm_fallback_reason(&scene, 128 << 20);
    assert_eq!(reason, Some(FmmLimit::Order { have: 6, need: 7 }));
    let [pulled, applied, up, evaluated] = run(&scene);
    assert!(pulled > 0 && applied > 0 && up == 0 && evaluated == 0);
    // Without links, no fallback exists.
    scene.data_mut().operator.rows.fill(Row::default());
    scene.data_mut().operator.links.clear();
    let error = GpuFrame::new(&kernels, &harness.queue, &scene, 8).unwrap_err();
    assert!(
        matches!(
            error,
            GpuError::Limit {
                have: 6,
                need: 7,
                ..
            }
        ),
        "{error}"
    );
}

#[test]
fn only_components_are_compressed() {
    let harness = harness();
    let kernels = KernelPipelines::new(&harness.device).unwrap();
    let scene = synthetic::scene(SenderForm::Components);
    let mut frame = GpuFrame::new(&kernels, &harness.queue, &scene, 8).unwrap();
    let other = synthetic::scene(SenderForm::Averages);
    let other = GpuFrame::new(&kernels, &harness.queue, &other, 8).unwrap();
    // The matrix has three arrays, and its product with the senders is the fourth.
    assert_eq!(frame.buffers().count(), other.buffers().count() + 4);
    harness
        .run(|e| frame.solve(&kernels, &harness.queue, e, &settings(2, false)))
        .unwrap();
    let created: Vec<EntryPoint> = EntryPoint::ALL
        .into_iter()
        .filter(|&p| kernels.is_created(p))
        .collect();
    assert_eq!(
        created,
        [
            EntryPoint::Radiosity,
            EntryPoint::Compress,
            EntryPoint::Apply,
            EntryPoint::Sweep,
            EntryPoint::Averages
        ]
    );
    // The compression runs before each use of the operator only.
    let counters = frame.counters();
    assert_eq!(counters.dispatches_of(EntryPoint::Compress), 3);
    assert_eq!(counters.dispatches_of(EntryPoint::Apply), 3);
    assert_eq!(counters.dispatches_of(EntryPoint::Pull), 0);
}

#[test]
fn unused_buffers_are_not_created() {
    let harness = harness();
    let kernels = KernelPipelines::new(&harness.device).unwrap();
    let scene = synthetic::scene(SenderForm::Averages);
    let mut frame = GpuFrame::new(&kernels, &harness.queue, &scene, 8).unwrap();
    assert_eq!(kernels.pipeline_count(), 0);
    frame
        .set_lights(&kernels, &harness.queue, &synthetic::lights())
        .unwrap();
    harness
        .run(|e| {
            frame.project(&kernels, &harness.queue, e, &[]);
            frame.project(&kernels, &harness.queue, e, &[99]);
        })
        .unwrap();
    assert_eq!(
        (kernels.pipeline_count(), frame.counters().total()),
        (0, 0),
        "no slot moved"
    );
    let bytes = frame.buffers().bytes();
    harness
        .run(|e| frame.solve(&kernels, &harness.queue, e, &settings(0, false)))
        .unwrap();
    let created: Vec<EntryPoint> = EntryPoint::ALL
        .into_iter()
        .filter(|&p| kernels.is_created(p))
        .collect();
    assert_eq!(
        created,
        [
            EntryPoint::Radiosity,
            EntryPoint::Pull,
            EntryPoint::Apply,
            EntryPoint::Averages
        ]
    );
    assert_eq!(kernels.pipeline_count(), 4);
    assert_eq!(
        frame.buffers().bytes(),
        bytes,
        "one bounce keeps no direct coefficients"
    );
    harness
        .run(|e| frame.solve(&kernels, &harness.queue, e, &settings(2, false)))
        .unwrap();
    assert_eq!(kernels.pipeline_count(), 5);
    assert!(kernels.is_created(EntryPoint::Sweep) && frame.buffers().bytes() > bytes);
    let counters = frame.counters();
    assert_eq!(counters.solves, 2);
    assert_eq!(counters.dispatches_of(EntryPoint::Sweep), 2);
    assert_eq!(counters.dispatches_of(EntryPoint::Apply), 1 + 3);
    assert_eq!(
        counters.dispatches_of(EntryPoint::Pull),
        2 + (2 + 2 * 2),
        "two levels at first, and in each sweep"
    );
    assert_eq!(
        counters.dispatches_of(EntryPoint::Averages),
        5 + (2 * 3 + 5)
    );
}

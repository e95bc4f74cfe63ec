//! `apply_one` against its twin, for every form of coefficients, with sweeps and without, and at
//! probes. Also against `apply`, where one channel is exact.

use crate::baked::{bake_box, lights, recipe};
use crate::compare::{SINGLE, Scale, differing};
use crate::{
    VALUES, assert_solve_matches_twin, cpu, harness, output, reverse_links, settings,
    solve_from_projection, synthetic,
};
use bevy_meshless_gi::gpu::{GpuFrame, KernelPipelines};
use bevy_meshless_gi::internals::gpu::EntryPoint;
use glam::Vec3;
use meshless_gi::internals::frame::VectorIrradiance;
use meshless_gi::internals::transport::SenderForm;
use meshless_gi::{BakedScene, Channels, CpuFrame, FrameLight, FrameSettings, SkyRadiance};

const HUE: Vec3 = Vec3::new(0.4, 1.0, 0.7);
const FORMS: [SenderForm; 3] = [
    SenderForm::Averages,
    SenderForm::Differences,
    SenderForm::Components,
];

fn one(sweeps: u32) -> FrameSettings {
    FrameSettings {
        channels: Channels::One(HUE),
        ..settings(sweeps, false)
    }
}

#[test]
fn monochrome_frame_matches_twin() {
    for form in FORMS {
        for sweeps in [0, 2] {
            assert_solve_matches_twin(
                form,
                &one(sweeps),
                &[
                    (VALUES, |s| reverse_links(s, 99)),
                    (VALUES, |s| {
                        (s.data_mut().operator.rows.iter_mut()).for_each(|r| r.scale *= 1.001);
                    }),
                    (VALUES, |s| {
                        (s.data_mut().surfaces.iter_mut()).for_each(|s| s.albedo[1] *= 1.01);
                    }),
                ],
            );
        }
    }
}

/// Returns a scene of gray surfaces and its lights. All light has the color `HUE`.
fn gray(form: SenderForm) -> (BakedScene, Vec<FrameLight>) {
    let mut scene = synthetic::scene(form);
    for surface in &mut scene.data_mut().surfaces {
        surface.albedo = [surface.albedo[1]; 3];
        surface.emission = (surface.emission[1] * HUE).to_array();
    }
    let mut lights = synthetic::lights();
    for light in &mut lights {
        light.color = (light.color[1] * HUE).to_array();
    }
    (scene, lights)
}

fn at(channels: Channels) -> FrameSettings {
    FrameSettings {
        channels,
        sky: SkyRadiance::from(0.3 * HUE),
        ..settings(2, false)
    }
}

/// Returns the number of values that differ from `right` in one channel of `hue`, on the CPU.
fn count_differing(
    scene: &BakedScene,
    lights: &[FrameLight],
    right: &CpuFrame,
    hue: Vec3,
) -> usize {
    let found = cpu(scene, lights, &at(Channels::One(hue)));
    differing(
        found.vector_irradiance(),
        right.vector_irradiance(),
        12,
        SINGLE,
        Scale::Rms,
    )
    .len()
}

#[test]
fn monochrome_of_gray_scene_equals_rgb() {
    let harness = harness();
    let kernels = KernelPipelines::new(&harness.device).unwrap();
    for form in FORMS {
        let (scene, mut lights) = gray(form);
        let right = cpu(&scene, &lights, &at(Channels::Three));
        assert_eq!(count_differing(&scene, &lights, &right, HUE), 0, "{form:?}");
        // A large intensity.
        assert_eq!(
            count_differing(&scene, &lights, &right, 30.0 * HUE),
            0,
            "{form:?}"
        );

        let frame = GpuFrame::new(&kernels, &harness.queue, &scene, lights.len() as u32).unwrap();
        let frame =
            solve_from_projection(&harness, &kernels, frame, &right, &at(Channels::One(HUE)));
        let values: Vec<VectorIrradiance> = output(
            &harness,
            &frame,
            EntryPoint::Averages,
            scene.data().points.len(),
        );
        let found = differing(
            &values,
            right.vector_irradiance(),
            12,
            2.0 * SINGLE,
            Scale::Rms,
        );
        assert!(found.is_empty(), "{form:?}: {} differ", found.len());
        let counters = frame.counters();
        assert_eq!(counters.dispatches_of(EntryPoint::Apply), 0);
        assert!(counters.dispatches_of(EntryPoint::ApplyOne) >= 3);

        // With another color of a light or a wall, the frame is not gray.
        assert!(
            count_differing(&scene, &lights, &right, Vec3::ONE) > 100,
            "{form:?}"
        );
        lights[0].color = [9.0, 1.0, 1.0];
        let three = cpu(&scene, &lights, &at(Channels::Three));
        assert!(
            count_differing(&scene, &lights, &three, HUE) > 100,
            "{form:?}"
        );
    }
}

#[test]
fn monochrome_probes_match_twin() {
    use meshless_gi::{BounceMode, ProbeSettings, Recipe, TransportMethod};
    let harness = harness();
    let kernels = KernelPipelines::new(&harness.device).unwrap();
    let scene = bake_box(&Recipe {
        probes: Some(ProbeSettings {
            spacing: Some(0.8),
            ..ProbeSettings::default()
        }),
        ..recipe(TransportMethod::Bounded, BounceMode::Runtime)
    });
    let (lights, settings) = (lights(), one(2));
    let twin = cpu(&scene, &lights, &settings);
    let frame = GpuFrame::new(&kernels, &harness.queue, &scene, lights.len() as u32).unwrap();
    let frame = solve_from_projection(&harness, &kernels, frame, &twin, &settings);
    let rows = scene.data().probes.as_ref().unwrap().rows.len();
    let found: Vec<VectorIrradiance> = output(&harness, &frame, EntryPoint::Volume, rows);
    let wrong = |twin: &CpuFrame| differing(&found, twin.probes(), 12, SINGLE, Scale::Rms).len();
    assert_eq!(wrong(&twin), 0);
    let mut perturbed = scene.clone();
    for row in &mut perturbed.data_mut().probes.as_mut().unwrap().rows {
        row.scale *= 1.001;
    }
    assert!(wrong(&cpu(&perturbed, &lights, &settings)) > rows / 2);
}

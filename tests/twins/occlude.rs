//! Comparison of `occlude` with its twin, and of a whole frame with shutters: links, shadows, sky
//! and probes, while the shutters close and open.

use crate::baked::{bake_box, lights, recipe};
use crate::compare::{HALF, Scale, differing};
use crate::{harness, output, projection_problems};
use bevy_meshless_gi::gpu::{GpuFrame, KernelPipelines, SceneBuffers};
use bevy_meshless_gi::internals::gpu::EntryPoint;
use glam::Vec3;
use meshless_gi::internals::frame::VectorIrradiance;
use meshless_gi::internals::transport::Link;
use meshless_gi::{
    BakedScene, BounceMode, CpuFrame, FrameSettings, OccluderBox, OccluderDesc, ProbeSettings,
    Recipe, SkyModel, SkyRadiance, TransportMethod,
};

/// Returns the Cornell box with a shutter across its middle and one in its opening.
fn scene() -> BakedScene {
    let shutter = |name: &str, z: f32| OccluderDesc {
        name: name.into(),
        boxes: vec![OccluderBox {
            center: [2.78, 2.74, z],
            half_edges: [1.9, 2.74, 0.02],
        }],
    };
    // 32 further occluders between the shutters in the list, so that sets need more than 32 bits.
    // They are behind the box, where no light reaches them.
    let aside = (0..32).map(|k| OccluderDesc {
        name: format!("aside {k}"),
        boxes: vec![OccluderBox {
            center: [2.78, -20.0, 30.0],
            half_edges: [0.1; 3],
        }],
    });
    let mut occluders = vec![shutter("middle", 2.5)];
    occluders.extend(aside);
    occluders.push(shutter("front", 0.2));
    let scene = bake_box(&Recipe {
        sky: SkyModel::Harmonics,
        dynamic_materials: true,
        probes: Some(ProbeSettings {
            spacing: Some(0.8),
            ..ProbeSettings::default()
        }),
        occluders,
        ..recipe(TransportMethod::Bounded, BounceMode::Runtime)
    });
    let sets = &scene.data().occluders.as_ref().unwrap().sets;
    assert_eq!(*sets, [0, 1, 1 << 33, 1 << 33 | 1]);
    scene
}

/// Returns the transmittances of all occluders from those of the two shutters.
fn transmittances([middle, front]: [f32; 2]) -> Vec<f32> {
    let mut all = vec![1.0; 34];
    (all[0], all[33]) = (middle, front);
    all
}

fn settings() -> FrameSettings {
    let mut sky = SkyRadiance::from(Vec3::new(0.2, 0.3, 0.5));
    sky.terms[2] = Vec3::new(0.1, -0.05, 0.02);
    FrameSettings {
        sky,
        ..FrameSettings::bounces(3)
    }
}

fn twin(scene: &BakedScene, transmittances: &[f32]) -> CpuFrame {
    let mut frame = CpuFrame::new(scene);
    frame.set_lights(scene, &lights());
    frame.set_occluders(scene, transmittances);
    frame.solve(scene, &settings());
    frame
}

/// Returns the vectors of links.
fn vectors(links: &[Link]) -> Vec<[f32; 3]> {
    links.iter().map(|l| l.vector().to_array()).collect()
}

#[test]
fn occluders_closed_and_open_match_twin() {
    let harness = harness();
    let kernels = KernelPipelines::new(&harness.device).unwrap();
    let scene = scene();
    let lights = lights();
    let slots: Vec<u32> = (0..lights.len() as u32).collect();
    let probes = scene.data().probes.as_ref().unwrap();
    let mut frame = GpuFrame::new(&kernels, &harness.queue, &scene, 1).unwrap();
    let mut set = |transmittances: &[f32]| {
        frame.set_lights(&kernels, &harness.queue, &lights).unwrap();
        let mut dispatched = 0;
        harness
            .run(|e| {
                let (k, q) = (&kernels, &harness.queue);
                dispatched = frame.set_occluders(k, q, e, &scene, transmittances);
                frame.project(k, q, e, &slots);
                frame.solve(k, q, e, &settings());
            })
            .unwrap();
        // One dispatch for the operator, one for the probes.
        assert_eq!(dispatched, 2);
        let count = lights.len() * scene.data().senders();
        let links: Vec<Link> = output(
            &harness,
            &frame,
            EntryPoint::Occlude,
            scene.data().operator.links.len(),
        );
        let projected: Vec<f32> = output(&harness, &frame, EntryPoint::Project, count);
        let values: Vec<VectorIrradiance> = output(
            &harness,
            &frame,
            EntryPoint::Averages,
            scene.data().points.len(),
        );
        let space: Vec<VectorIrradiance> =
            output(&harness, &frame, EntryPoint::Volume, probes.rows.len());
        (links, projected, values, space)
    };
    let compare = |transmittances: &[f32],
                   found: &(Vec<Link>, Vec<f32>, Vec<VectorIrradiance>, Vec<_>)| {
        let right = twin(&scene, transmittances);
        let (links, projected, values, space) = found;
        let senders = links.iter().zip(right.links(&scene)[0]);
        assert!(senders.into_iter().all(|(a, b)| a.sender() == b.sender()));
        let [a, b] = [&links[..], right.links(&scene)[0]].map(vectors);
        // A shadow ray that grazes an edge may be on either side.
        let (off, _) = projection_problems(&scene, &lights, projected, &right);
        [
            differing(&a, &b, 3, HALF, Scale::Rms).len(),
            off.saturating_sub(8),
            differing(
                values,
                right.vector_irradiance(),
                12,
                2.0 * HALF,
                Scale::Rms,
            )
            .len(),
            differing(space, right.probes(), 12, 2.0 * HALF, Scale::Rms).len(),
        ]
    };
    for two in [[0.0, 1.0], [0.35, 0.8], [1.0, 0.0], [1.0, 1.0]] {
        let found = set(&transmittances(two));
        assert_eq!(compare(&transmittances(two), &found), [0; 4], "{two:?}");
        // A shutter that is slightly more open has another transmittance.
        let wider = two.map(|g| if g > 0.5 { g - 0.1 } else { g + 0.1 });
        let wrong = compare(&transmittances(wider), &found);
        assert!(wrong.iter().all(|&n| n > 20), "{two:?}: {wrong:?}");
    }
    let open = vectors(&set(&[]).0);
    let found = differing(
        &open,
        &vectors(&scene.data().operator.links),
        3,
        HALF,
        Scale::Rms,
    );
    assert!(found.is_empty(), "open again");
}

#[test]
fn occluded_link_chunks_match_twin() {
    let harness = harness();
    let kernels = KernelPipelines::new(&harness.device).unwrap();
    let scene = scene();
    let (device, queue) = (&harness.device, &harness.queue);
    // Smallest limit that all other arrays fit.
    let limit = 3 * std::mem::size_of_val(scene.data().operator.links.as_slice()) as u64 / 4;
    let buffers = SceneBuffers::with_limit(device, queue, &scene, 1, limit).unwrap();
    let mut frame = GpuFrame::with_buffers(queue, buffers);
    let transmittances = transmittances([0.3, 0.6]);
    frame.set_lights(&kernels, queue, &lights()).unwrap();
    let slots: Vec<u32> = (0..lights().len() as u32).collect();
    let mut dispatched = 0;
    harness
        .run(|e| {
            dispatched = frame.set_occluders(&kernels, queue, e, &scene, &transmittances);
            frame.project(&kernels, queue, e, &slots);
            frame.solve(&kernels, queue, e, &settings());
        })
        .unwrap();
    assert!(dispatched >= 3, "{dispatched} dispatches");
    let values: Vec<VectorIrradiance> = output(
        &harness,
        &frame,
        EntryPoint::Averages,
        scene.data().points.len(),
    );
    let right = twin(&scene, &transmittances);
    let off = differing(
        &values,
        right.vector_irradiance(),
        12,
        2.0 * HALF,
        Scale::Rms,
    );
    assert!(off.is_empty(), "{} differ", off.len());
}

#[test]
fn scene_without_occluders_has_no_occluder_terms() {
    let harness = harness();
    let kernels = KernelPipelines::new(&harness.device).unwrap();
    let plain = bake_box(&recipe(TransportMethod::Bounded, BounceMode::Runtime));
    let mut frame = GpuFrame::new(&kernels, &harness.queue, &plain, 1).unwrap();
    let (count, bytes) = (frame.buffers().count(), frame.buffers().bytes());
    harness
        .run(|e| {
            let done = frame.set_occluders(&kernels, &harness.queue, e, &plain, &[0.0]);
            assert_eq!(done, 0);
        })
        .unwrap();
    assert_eq!(frame.counters().dispatches_of(EntryPoint::Occlude), 0);
    assert_eq!(
        (frame.buffers().count(), frame.buffers().bytes()),
        (count, bytes)
    );
    let more = GpuFrame::new(&kernels, &harness.queue, &scene(), 1).unwrap();
    assert!(more.buffers().count() > count);
}

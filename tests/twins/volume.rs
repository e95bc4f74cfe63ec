//! Comparison of `volume` with its twin, on the probes of the rotated Cornell box.

use super::Scene;
use crate::compare::{HALF, Scale, differing};
use crate::picture::wide;
use crate::{harness, settings, solve_from_projection};
use bevy_meshless_gi::gpu::{GpuFrame, KernelPipelines};
use bevy_meshless_gi::internals::gpu::{EntryPoint, VolumeBuffers};
use glam::{Mat4, Quat, UVec3, Vec3};
use half::f16;
use meshless_gi::internals::frame::volume::{STRAIGHT_STEP, volume_texels};
use meshless_gi::internals::frame::{
    VectorIrradiance, VolumeParams, VolumeValues, VoxelGrid, VoxelWeights,
};
use wgpu::{TextureUsages, TextureViewDescriptor};

#[test]
fn volumes_match_twin() {
    let harness = harness();
    let of = Scene::with_ball();
    let kernels = KernelPipelines::new(&harness.device).unwrap();
    let lights = of.twin.lights().len() as u32;
    let frame = GpuFrame::new(&kernels, &harness.queue, &of.scene, lights).unwrap();
    let mut frame = solve_from_projection(&harness, &kernels, frame, &of.twin, &settings(2, false));
    let probes = of.scene.data().probes.as_ref().unwrap();
    let read = |buffer, count| -> Vec<VectorIrradiance> { harness.read(buffer, count).unwrap() };
    let buffers = frame.buffers();
    let probe_values = read(
        buffers.output(EntryPoint::Volume).unwrap(),
        probes.rows.len(),
    );
    let point_values = read(
        buffers.output(EntryPoint::Averages).unwrap(),
        of.scene.data().points.len(),
    );
    let values = VolumeValues {
        points: &point_values,
        probes: &probe_values,
    };

    // The grid is larger than the box and reaches into walls. Its size is not a multiple of a
    // workgroup, and its axes are not those of the bake.
    let [low, high] = of.scene.info().bounds.map(Vec3::from_array);
    let turned = Mat4::from_quat(Quat::from_rotation_y(0.7) * Quat::from_rotation_x(-0.3));
    let size = UVec3::new(19, 17, 21);
    let shape = VoxelGrid::new([low - 0.3, high + 0.3], size).unwrap();
    let params = VolumeParams::new(&shape, &turned);
    let weights = VoxelWeights::from_scene(shape, of.scene.data());
    let texels = shape.texels();
    assert_eq!(texels, UVec3::new(19, 34, 63));
    let texture = harness.device.create_texture(&wgpu::TextureDescriptor {
        label: Some("voxels"),
        size: wgpu::Extent3d {
            width: texels.x,
            height: texels.y,
            depth_or_array_layers: texels.z,
        },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D3,
        format: wgpu::TextureFormat::Rgba16Float,
        usage: TextureUsages::STORAGE_BINDING | TextureUsages::COPY_SRC,
        view_formats: &[],
    });
    let view = texture.create_view(&TextureViewDescriptor::default());
    let buffers = VolumeBuffers::new(&harness.device, &harness.queue, &weights).unwrap();
    let shares = weights.weights().len() as u64;
    let faces = weights.wall_samples();
    let (found, face_weight_count) = (faces.wall_samples.len() as u64, faces.weights.len() as u64);
    let expected_bytes = 928 + 4 * (2 * (u64::from(shape.voxels()) + 1) + shares);
    let expected_bytes =
        expected_bytes + 16 * (found + 1) + 8 * (face_weight_count + u64::from(shape.voxels()));
    assert_eq!((buffers.count(), buffers.bytes()), (7, expected_bytes));
    harness
        .run(|encoder| {
            frame.volume(&kernels, &harness.queue, encoder, &buffers, &params, &view);
        })
        .unwrap();
    assert_eq!(frame.counters().dispatches_of(EntryPoint::Volume), 1);
    let gpu = wide(&harness.read_texture::<[f16; 4]>(&texture).unwrap());
    assert_eq!(gpu.len() as u32, texels.element_product());
    type Voxels<'a> = (VolumeParams, &'a VoxelWeights, VolumeValues<'a>);
    let expected = |(params, weights, values): Voxels<'_>| -> Vec<[f32; 4]> {
        volume_texels(&params, weights, values)
    };
    let off = |of: Voxels<'_>| differing(&gpu, &expected(of), 4, HALF, Scale::Rms).len();
    assert_eq!(off((params, &weights, values)), 0);
    let lit = gpu.iter().filter(|t| t[0] > 0.0).count();
    assert!(lit * 2 > gpu.len(), "{lit} of {}", gpu.len());
    // Must fail: other values, light brighter by 1 %, the bake's axes instead of the world's, other
    // voxels ahead, and voxels shifted by half a voxel.
    let (mut perturbed_probes, mut perturbed_points) = (probe_values.clone(), point_values.clone());
    perturbed_probes.rotate_left(3);
    perturbed_points.rotate_left(3);
    let moved = |points, probes| VolumeValues { points, probes };
    let changed = |change: &dyn Fn(&mut VolumeParams)| {
        let mut changed = params;
        change(&mut changed);
        changed
    };
    let corner = low - 0.3 + 0.5 * shape.voxel() * Vec3::X;
    let aside = VoxelGrid::new([corner, corner + (high - low + 0.6)], size).unwrap();
    let aside = VoxelWeights::from_scene(aside, of.scene.data());
    let perturbed: [(&str, Voxels<'_>); 6] = [
        (
            "values",
            (params, &weights, moved(&point_values, &perturbed_probes)),
        ),
        (
            "values on walls",
            (params, &weights, moved(&perturbed_points, &probe_values)),
        ),
        (
            "brighter",
            (changed(&|p| p.scale *= 1.01), &weights, values),
        ),
        (
            "axes",
            (changed(&|p| p.axes.rotate_left(1)), &weights, values),
        ),
        (
            "steps",
            (changed(&|p| p.steps.rotate_left(2)), &weights, values),
        ),
        ("aside", (params, &aside, values)),
    ];
    for (what, of) in perturbed {
        let found = off(of);
        // The sides on walls are fewer.
        let min = if what == "values on walls" { 8 } else { 4 };
        assert!(found * min > gpu.len(), "{what} is not detected: {found}");
    }
    // Sides without own light and without light ahead get the light of neighboring voxels. Without
    // those steps they are dark.
    let alone = changed(&|p| {
        for side in &mut p.steps {
            *side = [side[STRAIGHT_STEP]; 9];
        }
    });
    let found = off((alone, &weights, values));
    eprintln!("{found} of {} sides in edges", gpu.len());
    assert!(found > 20, "sides in edges are not detected: {found}");
}

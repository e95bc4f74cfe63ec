//! Comparison of `fog_inscatter` and `fog` with their twins, over a picture of fog in front of
//! walls at any distance. Some fog has a density texture, and some has another scene in front.

use super::compare::{HALF, Scale, differing};
use super::depth::depth_samples;
use super::harness;
use super::picture::wide;
use super::synthetic::HashRandom;
use super::volume_sample::{create_texture_3d, linear_sampler, random_volume_texels};
use bevy_meshless_gi::gpu::{HeadlessDevice, KernelPipelines};
use bevy_meshless_gi::internals::gpu::{EntryPoint, FogBuffers, FogTextures, draw_fog};
use glam::{Mat4, Quat, UVec3, Vec2, Vec3};
use half::f16;
use meshless_gi::internals::frame::fog_inscatter::fog_inscatter;
use meshless_gi::internals::frame::{Fog, FogInscatterParams, FogParams, FogView, VoxelGrid, fog};
use wgpu::{TextureFormat, TextureUsages, TextureViewDescriptor};

const SIZE: [u32; 2] = [72, 48];
/// Value of the picture before the fog.
const GRAY: f32 = 0.25;
/// Texels of the density texture along each edge.
const EDGE: u32 = 6;

struct Drawn {
    params: Vec<FogParams>,
    light: FogInscatterParams,
    voxels: Vec<[f16; 4]>,
    density: Vec<[f16; 4]>,
    depth: Vec<f32>,
}

impl Drawn {
    /// Creates a scene that is rotated and twice as large, in fog with another rotation. One fog
    /// has no density texture, one has one, and one is partly covered by another scene. The view
    /// does not fill its target.
    fn new() -> Self {
        let mut random = HashRandom::new(7);
        let size = UVec3::new(7, 5, 6);
        let shape = VoxelGrid::new([Vec3::splat(-1.0), Vec3::new(2.5, 1.5, 2.0)], size).unwrap();
        let root = Mat4::from_scale_rotation_translation(
            Vec3::splat(2.0),
            Quat::from_axis_angle(Vec3::new(0.6, 0.0, 0.8), 0.7),
            Vec3::new(2.0, 1.0, 1.0),
        );
        let middle = root.transform_point3(Vec3::new(0.75, 0.25, 0.5));
        let eye = middle + Vec3::new(1.0, 3.0, 9.0);
        let view = FogView {
            view_from_clip: Mat4::perspective_infinite_reverse_rh(0.9, 1.5, 0.1).inverse(),
            world_from_view: Mat4::look_at_rh(eye, middle, Vec3::Y).inverse(),
            viewport: [6.0, 0.0, 66.0, 44.0],
            exposure: 6.0,
            steps: 24,
        };
        let even = Fog {
            world_from_local: Mat4::from_scale_rotation_translation(
                Vec3::new(7.0, 6.0, 8.0),
                Quat::from_rotation_x(0.4),
                middle + 0.5,
            ),
            color: Vec3::new(0.9, 1.0, 0.6),
            density: 0.4,
            absorption: 0.1,
            scattering: 0.5,
            asymmetry: 0.4,
            texture: None,
        };
        let textured = Fog {
            texture: Some(Vec3::new(0.1, 0.0, -0.1)),
            density: 1.0,
            ..even
        };
        let other = Mat4::from_translation(middle) * Mat4::from_scale(Vec3::splat(3.0));
        // The outermost voxels extend half beyond it.
        let bounds = [Vec3::splat(-0.8), Vec3::new(2.3, 1.35, 1.9)];
        let near = FogView {
            exposure: 12.0,
            ..view
        };
        Self {
            light: FogInscatterParams::new(&view, 0.4, &shape, &root),
            params: vec![
                FogParams::new(&view, &even, &shape, bounds, &root, &[]),
                FogParams::new(&near, &textured, &shape, bounds, &root, &[]),
                FogParams::new(&view, &even, &shape, bounds, &root, &[other]),
            ],
            voxels: random_volume_texels(&mut random, size),
            density: (0..EDGE * EDGE * EDGE)
                .map(|_| [f16::from_f32(random.unit()); 4])
                .collect(),
            // Depths from far behind to in front of everything, and the sky.
            depth: (0..SIZE[0] * SIZE[1])
                .map(|i| {
                    if i % 5 == 0 {
                        0.0
                    } else {
                        0.1 / (4.0 + 12.0 * random.unit())
                    }
                })
                .collect(),
        }
    }

    /// Returns the light that each voxel scatters, by the twin.
    fn light(&self) -> Vec<[f32; 4]> {
        let (voxels, size) = (wide(&self.voxels), UVec3::from(self.light.size));
        (0..size.element_product())
            .map(|i| UVec3::new(i % size.x, i / size.x % size.y, i / (size.x * size.y)))
            .map(|voxel| fog_inscatter(&self.light, &voxels, voxel))
            .collect()
    }

    /// Returns the picture of the twin.
    fn run(&self, which: usize) -> Vec<[f32; 4]> {
        let voxels = wide(&self.voxels);
        let light = self.light();
        let density = wide(&self.density);
        let texture = |at: Vec3| trilinear(&density, at);
        let pixel = |i: u32| {
            let at = Vec2::new((i % SIZE[0]) as f32, (i / SIZE[0]) as f32) + 0.5;
            let params = &self.params[which];
            let added = fog::fog(
                params,
                &voxels,
                &light,
                &texture,
                at,
                self.depth[i as usize],
            );
            (added + GRAY).extend(GRAY).to_array()
        };
        (0..SIZE[0] * SIZE[1]).map(pixel).collect()
    }
}

/// Interpolates like a sampler with clamping.
fn trilinear(texels: &[[f32; 4]], at: Vec3) -> f32 {
    let at = at * EDGE as f32 - 0.5;
    let first = at.floor();
    (0..8u32)
        .map(|k| {
            let step = UVec3::new(k & 1, k >> 1 & 1, k >> 2).as_vec3();
            let corner = first + step;
            let weight = (1.0 - (at - corner).abs()).element_product();
            let t = corner
                .clamp(Vec3::ZERO, Vec3::splat(EDGE as f32 - 1.0))
                .as_uvec3();
            weight * texels[(t.x + EDGE * (t.y + EDGE * t.z)) as usize][0]
        })
        .sum()
}

/// Returns the picture of the device.
fn gpu_picture(
    harness: &HeadlessDevice,
    drawn: &Drawn,
    which: usize,
    samples: u32,
) -> Vec<[f32; 4]> {
    let (device, queue) = (&harness.device, &harness.queue);
    let kernels = KernelPipelines::new(device).unwrap();
    let mut buffers = FogBuffers::default();
    buffers.write(device, queue, &[drawn.light], &drawn.params);
    let bytes = 3 * 560 + 192 + 8 * drawn.light.size.iter().product::<u32>() as u64;
    assert_eq!((buffers.count(), buffers.bytes()), (4, bytes));
    let half4 = TextureFormat::Rgba16Float;
    let usage = TextureUsages::COPY_SRC | TextureUsages::RENDER_ATTACHMENT;
    let gray = vec![[f16::from_f32(GRAY); 4]; drawn.depth.len()];
    let picture = harness.texture(SIZE, half4, usage, Some(&gray));
    let depth = depth_samples(harness, SIZE, &drawn.depth, samples);
    let view_of = |t: &wgpu::Texture| t.create_view(&TextureViewDescriptor::default());
    let (canvas, depth) = (view_of(&picture), view_of(&depth));
    let texels = UVec3::from(drawn.params[0].size) * UVec3::new(1, 2, 3);
    let voxels = create_texture_3d(harness, texels, &drawn.voxels);
    let density = create_texture_3d(harness, UVec3::splat(EDGE), &drawn.density);
    let sampler = linear_sampler(harness);
    harness
        .run(|encoder| {
            let counted = buffers.record(&kernels, encoder, &[&voxels]);
            assert_eq!(counted.dispatches_of(EntryPoint::FogInscatter), 1);
            let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
                color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                    view: &canvas,
                    depth_slice: None,
                    resolve_target: None,
                    ops: wgpu::Operations {
                        load: wgpu::LoadOp::Load,
                        store: wgpu::StoreOp::Store,
                    },
                })],
                ..wgpu::RenderPassDescriptor::default()
            });
            let textures = FogTextures {
                depth: &depth,
                sampled: samples > 1,
                voxels: &voxels,
                between: &sampler,
                density: (&density, &sampler),
            };
            draw_fog(&kernels, &mut pass, half4, &buffers, which, 0, &textures);
        })
        .unwrap();
    assert_eq!(kernels.pipeline_count(), 2);
    wide(&harness.read_texture::<[f16; 4]>(&picture).unwrap())
}

/// Counts pixels that differ by more than the error of half floats and 8-bit filters.
fn count_differing(gpu: &[[f32; 4]], cpu: &[[f32; 4]]) -> usize {
    differing(gpu, cpu, 4, 4.0 * HALF, Scale::Rms).len()
}

#[test]
fn fog_picture_matches_twin() {
    let harness = harness();
    let drawn = Drawn::new();
    let count = drawn.depth.len();
    for which in 0..drawn.params.len() {
        let twin = drawn.run(which);
        let lit = twin.iter().filter(|p| p[0] > 1.2 * GRAY).count();
        assert!(
            lit > count / 6 && lit < count,
            "{which}: {lit} of {count} lit"
        );
        for samples in [1, 4] {
            let found = gpu_picture(&harness, &drawn, which, samples);
            let off = count_differing(&found, &twin);
            println!(
                "draw {which}, {samples} samples: {off} of {count} pixels differ, {lit} are lit"
            );
            // Rays within rounding of a voxel boundary may be on either side of it.
            assert!(off <= count / 500, "{which}, {samples} samples: {off}");
        }
    }
    // Must fail: fewer steps, other fog parameters, another eye, and another transform of the view.
    // Also other directions, viewport and bounds, missing walls, another density offset, and no
    // earlier scene.
    type Perturb = fn(&mut Drawn);
    let perturbations: [(&str, usize, Perturb); 12] = [
        ("steps", 1, |d| d.params[1].steps = 16),
        ("extinction", 0, |d| d.params[0].extinction *= 1.05),
        ("asymmetry", 0, |d| d.light.asymmetry += 0.05),
        ("eye", 0, |d| d.light.eye[0] += 40.0),
        ("radius", 0, |d| d.params[0].radius *= 1.05),
        ("view transform", 0, |d| {
            d.params[0].voxels_from_view[3][0] += 0.1
        }),
        ("directions", 0, |d| d.light.steps[0] = [0, 1, 0, 0]),
        ("viewport", 0, |d| d.params[0].viewport[0] += 1.0),
        ("bounds", 0, |d| d.params[0].high[0] -= 0.4),
        ("walls", 0, |d| {
            d.voxels.iter_mut().for_each(|v| v[3] = f16::ONE)
        }),
        ("offset", 1, |d| d.params[1].offset[0] += 0.05),
        ("earlier scenes", 2, |d| d.params[2].earlier_count = 0),
    ];
    for (name, which, perturb) in perturbations {
        let mut perturbed = Drawn::new();
        let found = gpu_picture(&harness, &perturbed, which, 1);
        perturb(&mut perturbed);
        let off = count_differing(&found, &perturbed.run(which));
        println!("{name}: {off} of {count} pixels differ");
        assert!(off > count / 50, "{name}: {off}");
    }
}

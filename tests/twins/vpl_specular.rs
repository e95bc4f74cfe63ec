//! Comparison of `vpl_specular` with its twin, on a room with a glossy floor. Compares nodes, mask
//! bits and pixels, also with shadows.

use super::compare::{self, HALF, Scale};
use super::depth::depth_texture;
use super::gloss_support::{Scene, room, virtual_lights};
use super::picture::wide;
use super::{harness, synthetic};
use bevy_meshless_gi::gpu::{GpuFrame, HeadlessDevice, KernelPipelines};
use bevy_meshless_gi::internals::gpu::{
    Draw, EntryPoint, NodeLights, RsmBuffers, SpecularBuffers, SubsplatTargets, ViewBuffers,
    VplShadows, draw_over,
};
use glam::{Mat4, Vec3};
use half::f16;
use meshless_gi::internals::frame::vpl_specular::SpecularImage;
use meshless_gi::internals::frame::{CompositeParams, SpecularNode, VplParams, composite, project};
use meshless_gi::internals::transport::SenderForm;
use meshless_gi::{BakedScene, SpecularSettings};
use wgpu::{BufferUsages, TextureFormat, TextureUsages, TextureViewDescriptor};

/// Size of the picture in pixels, not a multiple of any workgroup size.
const SIZE: [u32; 2] = [163, 97];

struct OnGpu {
    nodes: Vec<SpecularNode>,
    refine_masks: Vec<[u32; 4]>,
    texels: Vec<[f32; 4]>,
    /// Picture after the draw over gray.
    drawn: Vec<[f32; 4]>,
}

fn params() -> CompositeParams {
    CompositeParams {
        scale: 0.7,
        ..CompositeParams::default()
    }
}

const GRAY: f32 = 0.25;

fn run_on_gpu(
    harness: &HeadlessDevice,
    scene: &Scene,
    settings: &SpecularSettings,
    passes: &[u8],
    by: Option<&BakedScene>,
) -> OnGpu {
    let kernels = KernelPipelines::new(&harness.device).unwrap();
    let frame = by.map(|scene| GpuFrame::new(&kernels, &harness.queue, scene, 1).unwrap());
    let read = TextureUsages::TEXTURE_BINDING;
    let view_of = |t: &wgpu::Texture| t.create_view(&TextureViewDescriptor::default());
    let depth = view_of(&depth_texture(harness, SIZE, &scene.drawn.depth));
    let format = TextureFormat::Rgba32Uint;
    let gbuffer = view_of(&harness.texture(SIZE, format, read, Some(&scene.drawn.gbuffer)));
    let half4 = TextureFormat::Rgba16Float;
    let usage = read | TextureUsages::STORAGE_BINDING | TextureUsages::COPY_SRC;
    let output = harness.texture::<[f16; 4]>(SIZE, half4, usage, None);
    let target = view_of(&output);
    let maps = RsmBuffers::new(&harness.device, 1, scene.vpls.len() as u32).unwrap();
    let queue = &harness.queue;
    queue.write_buffer(maps.vpls(), 0, bytemuck::cast_slice(&scene.vpls));
    let uniform = |bytes: &[u8]| {
        let buffer = harness.device.create_buffer(&wgpu::BufferDescriptor {
            label: None,
            size: bytes.len() as u64,
            usage: BufferUsages::UNIFORM | BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        queue.write_buffer(&buffer, 0, bytes);
        buffer
    };
    let view = uniform(bytemuck::bytes_of(&scene.view));
    let lit = uniform(bytemuck::bytes_of(&scene.lit));
    let lights = NodeLights {
        maps: &maps,
        view: &view,
        lit: &lit,
        shadows: frame.as_ref().map(|frame| VplShadows {
            local_from_space: Mat4::from_cols_array_2d(&scene.lit.local_from_space),
            scene: frame.buffers(),
            dim: 0.0,
        }),
    };
    let (screen, specular_params) = scene.params(settings);
    let levels = screen.levels();
    let mut buffers = SpecularBuffers::new(&harness.device, queue, levels).unwrap();
    let targets = SubsplatTargets {
        depth: &depth,
        gbuffer: &gbuffer,
        output: &target,
    };
    // Two frames, because the second starts from the results of the first.
    for _ in 0..2 {
        buffers.write(queue, &screen, &specular_params);
        harness
            .run(|encoder| buffers.record(&kernels, encoder, &targets, &lights))
            .unwrap();
    }
    let counters = buffers.counters();
    assert_eq!(
        counters.dispatches_of(EntryPoint::VplSpecular),
        2 * u64::from(levels.coarsest_level)
    );
    assert_eq!(counters.dispatches_of(EntryPoint::VplSpecularPixels), 2);
    assert!(buffers.bytes() < 8 * u64::from(SIZE[0] * SIZE[1]) + 8000);
    assert_eq!(kernels.pipeline_count(), 2);

    // Draws onto a picture.
    let gray = vec![[f16::from_f32(GRAY); 4]; (SIZE[0] * SIZE[1]) as usize];
    let usage = TextureUsages::RENDER_ATTACHMENT | TextureUsages::COPY_SRC;
    let picture = harness.texture(SIZE, half4, usage | read, Some(&gray));
    let passes = view_of(&harness.texture(SIZE, TextureFormat::R8Uint, read, Some(passes)));
    let mut splat = ViewBuffers::new(&harness.device);
    splat.write(queue, &bytemuck::Zeroable::zeroed(), &params());
    let canvas = view_of(&picture);
    harness
        .run(|encoder| {
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
            draw_over(
                &kernels,
                &mut pass,
                half4,
                Draw::Specular,
                &splat,
                [&target, &gbuffer, &passes],
            );
        })
        .unwrap();
    // The same pipeline is not created again.
    let before = kernels.pipeline_count();
    kernels.render_kernel(half4, Draw::Specular);
    assert_eq!(kernels.pipeline_count(), before);
    OnGpu {
        nodes: harness
            .read(buffers.nodes(), levels.starts[0] as usize)
            .unwrap(),
        refine_masks: harness
            .read(
                buffers.refine_masks(),
                (levels.starts[0] - levels.starts[2]) as usize,
            )
            .unwrap(),
        texels: wide(&harness.read_texture::<[f16; 4]>(&output).unwrap()),
        drawn: wide(&harness.read_texture::<[f16; 4]>(&picture).unwrap()),
    }
}

/// Counts items of `N` floats that differ by more than the error of halves and of sums in another
/// order.
fn differing<const N: usize>(gpu: &[[f32; N]], cpu: &[[f32; N]]) -> usize {
    let [gpu, cpu] = [gpu, cpu].map(|items| items.as_flattened());
    compare::differing(gpu, cpu, N, 8.0 * HALF, Scale::Float).len()
}

fn node_values(nodes: &[SpecularNode]) -> Vec<[f32; 6]> {
    let numbers = |node: &SpecularNode| match node.light() {
        Some(light) => {
            let ([a, b, c], [d, e, f]) = (light.f0.to_array(), light.f90.to_array());
            [a, b, c, d, e, f]
        }
        None => [-1.0; 6],
    };
    nodes.iter().map(numbers).collect()
}

/// Counts bits that differ. Panics if one flipped bit is not counted.
fn flipped_bits(gpu: &[[u32; 4]], cpu: &[[u32; 4]]) -> u32 {
    assert_eq!(gpu.len(), cpu.len());
    let count = |cpu: &[[u32; 4]]| -> u32 {
        let words = gpu.iter().flatten().zip(cpu.iter().flatten());
        words.map(|(g, c)| (g ^ c).count_ones()).sum()
    };
    let found = count(cpu);
    for item in [0, cpu.len() / 2, cpu.len() - 1] {
        let mut perturbed = cpu.to_vec();
        perturbed[item][3] ^= 1;
        assert_eq!(count(&perturbed).abs_diff(found), 1, "mask {item}");
    }
    found
}

fn compare(scene: &Scene, settings: &SpecularSettings, by: Option<&BakedScene>) {
    let harness = harness();
    let passes: Vec<u8> = (0..SIZE[0] * SIZE[1])
        .map(|i| u8::from(i % 11 != 0))
        .collect();
    let gpu = run_on_gpu(&harness, scene, settings, &passes, by);
    let cpu = scene.run(settings);
    let count = cpu.texels.len();
    let glossy = cpu.texels.iter().filter(|t| t[3] == 1.0).count();
    assert!(glossy * 4 > count);
    assert!(gpu.texels.iter().flatten().all(|v| v.is_finite()));
    // A change within rounding of a threshold may fall on either side of it.
    let apart = |cpu: &SpecularImage| {
        [
            differing(&node_values(&gpu.nodes), &node_values(&cpu.nodes)),
            differing(&gpu.texels, &cpu.texels),
        ]
    };
    let bits = |s: &[[u32; 4]]| -> u32 { s.iter().flatten().map(|w| w.count_ones()).sum() };
    let flipped = flipped_bits(&gpu.refine_masks, &cpu.refine_masks);
    let found = apart(&cpu);
    println!(
        "{found:?} of {} nodes and {count} pixels differ, {flipped} of {} bits",
        gpu.nodes.len(),
        bits(&cpu.refine_masks)
    );
    assert!(bits(&cpu.refine_masks) > 100);
    assert!(flipped * 100 <= bits(&cpu.refine_masks) + 500);
    assert!(found[0] * 200 <= gpu.nodes.len() && found[1] * 200 <= count);

    // The picture after the draw.
    let drawn: Vec<[f32; 4]> = (0..count)
        .map(|i| {
            let texel = scene.drawn.gbuffer[i];
            let add = composite::composite_specular_pixel(
                &params(),
                gpu.texels[i],
                texel,
                passes[i].into(),
            );
            [add[0] + GRAY, add[1] + GRAY, add[2] + GRAY, GRAY]
        })
        .collect();
    assert_eq!(differing(&gpu.drawn, &drawn), 0);

    // Wrong inputs.
    let again = |change: &dyn Fn(&mut Scene)| {
        let mut other = Scene::new(SIZE, scene.vpls.clone(), ROUGHNESS);
        other.lit = scene.lit;
        other.view = scene.view;
        other.bvh = scene.bvh.clone();
        change(&mut other);
        apart(&other.run(settings))
    };
    assert_eq!(again(&|_| ()), found);
    let noticed = again(&|s| (s.vpls[5..15].iter_mut()).for_each(|v| v.flux[1] *= 0.5));
    assert!(noticed[1] > 10 * found[1] + 50, "lights: {noticed:?}");
    let noticed = again(&|s| s.view.space_from_clip[3][1] += 0.05);
    assert!(noticed[1] * 4 > glossy, "positions: {noticed:?}");
    let noticed = again(&|s| {
        for texel in &mut s.drawn.gbuffer {
            texel[0] ^= 8 << 24;
        }
    });
    assert!(noticed[1] * 4 > glossy, "roughness: {noticed:?}");
}

const ROUGHNESS: f32 = 0.25;

#[test]
fn specular_of_each_light_matches_twin() {
    let scene = Scene::new(SIZE, virtual_lights(&room(), 32, 40), ROUGHNESS);
    compare(&scene, &SpecularSettings::default(), None);
}

/// Tests with the shadows of a baked scene that is moved into the room.
#[test]
fn specular_in_moved_baked_scene_matches_twin() {
    let by = synthetic::scene(SenderForm::Averages);
    let mut scene = Scene::new(SIZE, virtual_lights(&room(), 32, 40), ROUGHNESS);
    let open = scene.full();
    scene.bvh = by.data().bvh.clone();
    let nodes = by.data().bvh.nodes.len() as u32;
    let shift = Mat4::from_translation(Vec3::new(-2.0, 0.0, -1.5));
    scene.lit = VplParams::shadowed(40, shift, nodes, project::extent(by.data()), 0.0);
    let full = scene.full();
    let hidden = open
        .iter()
        .zip(&full)
        .filter(|(a, b)| a[1] > 1.1 * b[1] + 1e-3);
    let hidden = hidden.count();
    assert!(hidden > 500, "{hidden}");
    compare(&scene, &SpecularSettings::default(), Some(&by));
}

/// Tests more lights than a refine mask has bits.
#[test]
fn specular_of_light_groups_matches_twin() {
    let scene = Scene::new(SIZE, virtual_lights(&room(), 32, 200), ROUGHNESS);
    compare(
        &scene,
        &SpecularSettings {
            coarsest_level: 5,
            finest_level: 2,
            radiance_threshold: 0.05,
            max_roughness: 0.5,
            together: false,
        },
        None,
    );
}

#[test]
fn specular_of_all_lights_matches_twin() {
    let scene = Scene::new(SIZE, virtual_lights(&room(), 32, 24), ROUGHNESS);
    let settings = SpecularSettings {
        together: true,
        ..SpecularSettings::default()
    };
    compare(&scene, &settings, None);
}

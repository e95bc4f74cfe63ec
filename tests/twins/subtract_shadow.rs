//! Comparison of `subtract_shadow` and its draw with their twins, on the baked box of `soft_shadow`
//! in a camera's view.

use super::depth::depth_texture;
use super::harness;
use super::picture::{pixels_differing, wide};
use super::screen::SIZE;
use super::soft_shadow::{baked, lights};
use bevy_meshless_gi::gpu::{HeadlessDevice, KernelPipelines, SceneBuffers};
use bevy_meshless_gi::internals::gpu::{
    Draw, EntryPoint, SoftShadowBuffers, SplatTargets, SubtractShadowBuffers, ViewBuffers,
    draw_over,
};
use glam::{Mat4, Vec3};
use half::f16;
use meshless_gi::internals::frame::subtract_shadow::{self, LtcTables, SubtractShadowParams};
use meshless_gi::internals::frame::{
    CompositeParams, SoftLight, SplatParams, VectorIrradiance, composite, gbuffer, soft_shadow,
};
use meshless_gi::{BakedScene, Quad, TriangleMesh};
use meshless_gi_lab::accuracy::RaycastView;
use wgpu::{TextureFormat, TextureUsages, TextureViewDescriptor};

/// Output of an earlier scene in every third pixel.
const EARLIER: f32 = 0.25;
/// Value of the picture before the draw.
const GRAY: f32 = 0.5;

/// Box, its picture, the shadowed irradiance of its points, and lights.
struct Shaded {
    scene: BakedScene,
    drawn: RaycastView,
    view: SplatParams,
    occluded_irradiances: Vec<VectorIrradiance>,
    lights: Vec<SoftLight>,
    tables: LtcTables,
}

/// Returns synthetic, smooth tables of five texels along an edge, which fit no real surface.
fn synthetic_tables() -> LtcTables {
    let size = 5;
    let texel = |i: u32, k: f32| {
        let (x, y) = ((i % size) as f32 / 4.0, (i / size) as f32 / 4.0);
        [
            1.2 - 0.5 * x + k * y,
            0.3 * y + 0.2 * k,
            -0.2 * x * y,
            0.8 + 0.3 * k * x,
        ]
    };
    LtcTables {
        size,
        layers: [0.0, 1.0].map(|k| (0..size * size).map(|i| texel(i, k)).collect()),
    }
}

impl Shaded {
    fn new() -> Self {
        let scene = baked();
        let mesh: TriangleMesh = TriangleMesh::from_quads(&Quad::cornell_box());
        let [width, height] = SIZE.map(|v| v as f32);
        // The root is rotated, moved and scaled by two.
        let turn = glam::Quat::from_axis_angle(Vec3::new(0.6, 0.0, 0.8), 0.7);
        let root =
            Mat4::from_scale_rotation_translation(Vec3::splat(2.0), turn, Vec3::new(2.0, 1.0, 1.0));
        let look = Mat4::look_at_rh(Vec3::new(0.3, 1.2, 3.4), Vec3::new(0.0, 0.9, 0.0), Vec3::Y);
        let clip = Mat4::perspective_infinite_reverse_rh(0.75, width / height, 0.1);
        let clip_from_local = clip * look;
        let mut drawn = RaycastView::new(&mesh, clip_from_local, SIZE);
        let (_, turned, _) = root.to_scale_rotation_translation();
        for (i, texel) in drawn.gbuffer.iter_mut().enumerate() {
            // The G-buffer stores normals in world space.
            let n = turned * gbuffer::normal(*texel);
            let flags = if i % 17 == 0 { gbuffer::UNLIT } else { 0 };
            let packed = gbuffer::pack(gbuffer::base(*texel), 0.1, 0.7, n, flags);
            *texel = gbuffer::with_roughness(packed, (i % 9) as f32 / 8.0, 0.5);
        }
        let lights = lights().to_vec();
        Self {
            view: SplatParams::new(
                root * clip_from_local.inverse(),
                root.inverse(),
                [0.0, 0.0, width, height],
                SIZE,
                2.0,
                (&scene.data().display.grid).into(),
            ),
            occluded_irradiances: soft_shadow::occluded_irradiances(scene.data(), &lights),
            scene,
            drawn,
            lights,
            tables: synthetic_tables(),
        }
    }

    /// Returns the output of the twins: of `subtract_shadow`, and of `next_scene` after the earlier
    /// scene.
    fn run(&self, gloss: bool) -> [Vec<[f32; 4]>; 2] {
        let params = SubtractShadowParams::new(self.scene.data(), self.lights.len());
        let tables = gloss.then_some(&self.tables);
        let pixel = |i: u32| {
            subtract_shadow::subtract_shadow_pixel(
                (&params, &self.view),
                self.scene.data(),
                &self.occluded_irradiances,
                (&self.lights, tables),
                [i % SIZE[0], i / SIZE[0]],
                self.drawn.depth[i as usize],
                self.drawn.gbuffer[i as usize],
            )
        };
        let alone: Vec<[f32; 4]> = (0..SIZE[0] * SIZE[1]).map(pixel).collect();
        let over = alone.iter().enumerate();
        let over = over.map(|(i, own)| if i % 3 == 0 { earlier(i) } else { *own });
        let over = over.collect();
        [alone, over]
    }
}

fn earlier(i: usize) -> [f32; 4] {
    match i % 3 {
        0 => [EARLIER, EARLIER, EARLIER, 1.0],
        _ => [0.0; 4],
    }
}

/// Returns the output of the device: of `subtract_shadow`, of `next_scene`, and the picture after
/// the draw of the first.
fn gpu_pictures(
    harness: &HeadlessDevice,
    shaded: &Shaded,
    passes: &[u8],
    gloss: bool,
) -> [Vec<[f32; 4]>; 3] {
    let Shaded { scene, drawn, .. } = shaded;
    let (device, queue) = (&harness.device, &harness.queue);
    let kernels = KernelPipelines::new(device).unwrap();
    let scene_buffers = SceneBuffers::new(device, queue, scene, 1).unwrap();
    let visibility = scene.data().visibility.as_ref().unwrap();
    let soft_buffers =
        SoftShadowBuffers::new(device, queue, &scene_buffers, visibility, 1).unwrap();
    // From the twin's values, so that `soft_shadow` does not affect the comparison.
    queue.write_buffer(
        soft_buffers.occluded_irradiances(),
        0,
        bytemuck::cast_slice(&shaded.occluded_irradiances),
    );
    let mut view = ViewBuffers::new(device);
    view.write(queue, &shaded.view, &CompositeParams::default());
    // Too little capacity, so the buffer grows.
    let mut buffers = SubtractShadowBuffers::new(device, 1).unwrap();
    buffers
        .write(&kernels, queue, &scene_buffers, &shaded.lights, gloss)
        .unwrap();
    assert_eq!(buffers.bytes(), 16 + 80 * shaded.lights.len() as u64);

    let tables = gloss.then(|| upload_tables(harness, &shaded.tables));
    let read = TextureUsages::TEXTURE_BINDING | TextureUsages::COPY_SRC;
    let half4 = TextureFormat::Rgba16Float;
    let halves = |v: [f32; 4]| v.map(f16::from_f32);
    let before: Vec<[f16; 4]> = (0..drawn.depth.len()).map(|i| halves(earlier(i))).collect();
    let gray = vec![halves([GRAY; 4]); drawn.depth.len()];
    let depth = depth_texture(harness, SIZE, &drawn.depth);
    let gbuffer = harness.texture(SIZE, TextureFormat::Rgba32Uint, read, Some(&drawn.gbuffer));
    let passes = harness.texture(SIZE, TextureFormat::R8Uint, read, Some(passes));
    let before = harness.texture(SIZE, half4, read, Some(&before));
    let storage = read | TextureUsages::STORAGE_BINDING;
    let out = [0; 2].map(|_| harness.texture::<[f16; 4]>(SIZE, half4, storage, None));
    let canvas = read | TextureUsages::RENDER_ATTACHMENT;
    let picture = harness.texture(SIZE, half4, canvas, Some(&gray));
    let look = |t: &wgpu::Texture| t.create_view(&TextureViewDescriptor::default());
    let (depth, gbuffer, passes, before) =
        (look(&depth), look(&gbuffer), look(&passes), look(&before));
    let (targets, canvas) = (out.each_ref().map(look), look(&picture));
    harness
        .run(|encoder| {
            for (output, earlier) in [(&targets[0], None), (&targets[1], Some(&before))] {
                let targets = SplatTargets {
                    depth: &depth,
                    gbuffer: &gbuffer,
                    earlier,
                    output,
                };
                buffers.record(
                    &kernels,
                    encoder,
                    (&scene_buffers, &soft_buffers),
                    &view,
                    &targets,
                    tables.as_ref(),
                );
            }
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
            let textures = [&targets[0], &gbuffer, &passes];
            draw_over(&kernels, &mut pass, half4, Draw::Shadow, &view, textures);
        })
        .unwrap();
    let counters = buffers.counters();
    assert_eq!(
        [EntryPoint::SubtractShadow, EntryPoint::SubtractShadowOver]
            .map(|p| counters.dispatches_of(p)),
        [1, 1]
    );
    [&out[0], &out[1], &picture].map(|t| wide(&harness.read_texture::<[f16; 4]>(t).unwrap()))
}

/// Uploads the tables to the device.
fn upload_tables(harness: &HeadlessDevice, tables: &LtcTables) -> wgpu::TextureView {
    let size = wgpu::Extent3d {
        width: tables.size,
        height: tables.size,
        depth_or_array_layers: 2,
    };
    let texture = harness.device.create_texture(&wgpu::TextureDescriptor {
        label: Some("tables"),
        size,
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format: TextureFormat::Rgba32Float,
        usage: TextureUsages::TEXTURE_BINDING | TextureUsages::COPY_DST,
        view_formats: &[],
    });
    harness.queue.write_texture(
        texture.as_image_copy(),
        bytemuck::cast_slice(&tables.layers.concat()),
        wgpu::TexelCopyBufferLayout {
            offset: 0,
            bytes_per_row: Some(16 * tables.size),
            rows_per_image: Some(tables.size),
        },
        size,
    );
    texture.create_view(&TextureViewDescriptor {
        dimension: Some(wgpu::TextureViewDimension::D2Array),
        ..TextureViewDescriptor::default()
    })
}

/// Counts pixels that differ by more than the error of half floats and of sums in another order, or
/// in their coverage.
fn count_differing(gpu: &[[f32; 4]], cpu: &[[f32; 4]]) -> usize {
    pixels_differing(gpu, cpu).len()
}

#[test]
fn subtract_shadow_matches_twin() {
    compare(false);
}

#[test]
fn subtract_shadow_with_gloss_matches_twin() {
    compare(true);
}

fn compare(gloss: bool) {
    let harness = harness();
    let mut shaded = Shaded::new();
    let count = shaded.drawn.depth.len();
    let passes: Vec<u8> = (0..count).map(|i| u8::from(i % 11 != 0)).collect();
    let [alone, over, picture] = gpu_pictures(&harness, &shaded, &passes, gloss);
    let [own, behind] = shaded.run(gloss);
    let covered = own.iter().filter(|t| t[3] == 1.0).count();
    let dark = own.iter().filter(|t| t[0] > 1e-3).count();
    assert!(
        covered > count / 2 && covered < count && dark > count / 10,
        "{covered} {dark} of {count}"
    );
    // Positions within rounding of a clip plane may be on either side of it.
    let found = [
        count_differing(&alone, &own),
        count_differing(&over, &behind),
    ];
    println!("{found:?} of {count} pixels differ, {covered} are covered, {dark} miss light");
    assert!(found[0] <= 4 && found[1] <= 4, "{found:?}");
    let expected: Vec<[f32; 4]> = alone
        .iter()
        .zip(&passes)
        .map(|(texel, &pass)| {
            let [r, g, b] = composite::composite_shadow_pixel(*texel, pass.into());
            [GRAY - r, GRAY - g, GRAY - b, GRAY]
        })
        .collect();
    assert_eq!(count_differing(&picture, &expected), 0);
    assert!(picture.iter().any(|p| p[0] < 0.9 * GRAY));

    // Must fail: another light, position or range, other surfaces and points, other occluded
    // irradiances, other unshadowed irradiances, and another exposure.
    type Perturb = fn(&mut Shaded);
    let perturbations: [(&str, Perturb); 8] = [
        ("color", |s| s.lights[0].color[1] *= 1.02),
        ("position", |s| s.lights[0].center[0] += 0.05),
        ("range", |s| s.lights[1] = s.lights[1].with_range(4.0)),
        ("roughness", |s| {
            for texel in &mut s.drawn.gbuffer {
                texel[0] ^= 32 << 24;
            }
        }),
        ("radius of points", |s| {
            s.scene
                .data_mut()
                .points
                .iter_mut()
                .for_each(|p| p.radius *= 0.97);
        }),
        ("occluded_irradiances", |s| {
            s.occluded_irradiances
                .iter_mut()
                .for_each(|d| d.y[0] *= 1.02)
        }),
        ("unshadowed", |s| {
            s.occluded_irradiances
                .iter_mut()
                .for_each(|d| d.y[3] *= 1.02)
        }),
        ("exposure", |s| s.view.scale *= 1.01),
    ];
    if gloss {
        let noticed = count_differing(&alone, &shaded.run(false)[0]);
        assert!(
            noticed > count / 10,
            "missing mirror images are not detected: {noticed}"
        );
        for layer in 0..2 {
            shaded.tables.layers[layer][7][layer] *= 1.2;
            let noticed = count_differing(&alone, &shaded.run(true)[0]);
            println!("table {layer}: {noticed}");
            assert!(noticed > found[0] + 20, "table {layer} is not detected");
            shaded.tables = synthetic_tables();
        }
    }
    for (what, perturb) in perturbations {
        let (lights, drawn, scene) = (
            shaded.lights.clone(),
            shaded.drawn.gbuffer.clone(),
            shaded.scene.data().points.clone(),
        );
        let (occluded_irradiances, scale) =
            (shaded.occluded_irradiances.clone(), shaded.view.scale);
        perturb(&mut shaded);
        let noticed = count_differing(&alone, &shaded.run(gloss)[0]);
        println!("{what}: {noticed}");
        assert!(noticed > found[0] + 20, "{what} is not detected: {noticed}");
        (
            shaded.lights,
            shaded.drawn.gbuffer,
            shaded.scene.data_mut().points,
        ) = (lights, drawn, scene);
        (shaded.occluded_irradiances, shaded.view.scale) = (occluded_irradiances, scale);
    }
}

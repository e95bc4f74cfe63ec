//! Comparison of `splat` and `composite` with their twins, over a picture.

use super::compare::{HALF, Scale, differing, reported};
use super::screen::{self, SIZE, Screen};
use super::{cpu, depth, harness, settings, synthetic};
use bevy_meshless_gi::gpu::{GpuFrame, HeadlessDevice, KernelPipelines};
use bevy_meshless_gi::internals::gpu::{EntryPoint, SplatTargets, ViewBuffers};
use half::f16;
use meshless_gi::internals::frame::splat::MIN_COVERED_FRACTION;
use meshless_gi::internals::frame::{
    CompositeParams, SplatParams, VectorIrradiance, composite, splat,
};
use meshless_gi::internals::transport::SenderForm;
use meshless_gi::{BakedScene, CpuFrame};
use wgpu::{TextureFormat, TextureUsages, TextureViewDescriptor};

/// Results of the kernels for a picture.
struct Pictures {
    frame: GpuFrame,
    irradiance: Vec<[f16; 4]>,
    over: Vec<[f16; 4]>,
    picture: Vec<[f16; 4]>,
}

fn draw(
    harness: &HeadlessDevice,
    scene: &BakedScene,
    twin: &CpuFrame,
    screen: &Screen,
    params: &SplatParams,
    (composite, replace): (&CompositeParams, bool),
) -> Pictures {
    let kernels = KernelPipelines::new(&harness.device).unwrap();
    let mut frame = GpuFrame::new(&kernels, &harness.queue, scene, 1).unwrap();
    let values = frame.buffers().output(EntryPoint::Averages).unwrap();
    harness
        .queue
        .write_buffer(values, 0, bytemuck::cast_slice(twin.vector_irradiance()));
    let mut view = ViewBuffers::new(&harness.device);
    view.write(&harness.queue, params, composite);

    let read = TextureUsages::TEXTURE_BINDING | TextureUsages::COPY_SRC;
    let half4 = TextureFormat::Rgba16Float;
    let depth = depth::depth_texture(harness, SIZE, &screen.depth);
    let gbuffer = harness.texture(SIZE, TextureFormat::Rgba32Uint, read, Some(&screen.gbuffer));
    let passes = harness.texture(SIZE, TextureFormat::R8Uint, read, Some(&screen.passes));
    let earlier = harness.texture(SIZE, half4, read, Some(&screen.earlier));
    let out = [0; 2].map(|_| {
        harness.texture::<[f16; 4]>(SIZE, half4, read | TextureUsages::STORAGE_BINDING, None)
    });
    let picture = harness.texture(
        SIZE,
        half4,
        read | TextureUsages::RENDER_ATTACHMENT,
        Some(&screen.lit),
    );
    let view_of = |t: &wgpu::Texture| t.create_view(&TextureViewDescriptor::default());
    let (depth_view, gbuffer_view) = (view_of(&depth), view_of(&gbuffer));
    let out_views = [view_of(&out[0]), view_of(&out[1])];
    let (earlier_view, passes_view, picture_view) =
        (view_of(&earlier), view_of(&passes), view_of(&picture));
    harness
        .run(|encoder| {
            for (output, earlier) in [(&out_views[0], None), (&out_views[1], Some(&earlier_view))] {
                let targets = SplatTargets {
                    depth: &depth_view,
                    gbuffer: &gbuffer_view,
                    earlier,
                    output,
                };
                frame.splat(&kernels, encoder, &view, &targets);
            }
            let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
                color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                    view: &picture_view,
                    depth_slice: None,
                    resolve_target: None,
                    ops: wgpu::Operations {
                        load: wgpu::LoadOp::Load,
                        store: wgpu::StoreOp::Store,
                    },
                })],
                ..wgpu::RenderPassDescriptor::default()
            });
            frame.composite(
                &kernels,
                &mut pass,
                half4,
                replace,
                &view,
                [&out_views[0], &gbuffer_view, &passes_view],
            );
        })
        .unwrap();
    Pictures {
        irradiance: harness.read_texture(&out[0]).unwrap(),
        over: harness.read_texture(&out[1]).unwrap(),
        picture: harness.read_texture(&picture).unwrap(),
        frame,
    }
}

pub fn wide(texels: &[[f16; 4]]) -> Vec<[f32; 4]> {
    texels.iter().map(|t| t.map(f16::to_f32)).collect()
}

/// Computes `splat` with the twin over the whole picture.
fn splat_all(
    scene: &BakedScene,
    values: &[VectorIrradiance],
    screen: &Screen,
    params: &SplatParams,
) -> Vec<[f32; 4]> {
    let pixels = (0..SIZE[1]).flat_map(|y| (0..SIZE[0]).map(move |x| [x, y]));
    let texels = pixels.zip(screen.depth.iter().zip(&screen.gbuffer));
    texels
        .map(|(pixel, (&depth, &texel))| {
            splat::splat_pixel(params, scene.data(), values, pixel, depth, texel)
        })
        .collect()
}

/// Returns the pixels that differ in irradiance by more than the error of halves, or in coverage.
pub fn pixels_differing(gpu: &[[f32; 4]], cpu: &[[f32; 4]]) -> Vec<usize> {
    let rgb = |texels: &[[f32; 4]]| {
        texels
            .iter()
            .map(|t| [t[0], t[1], t[2]])
            .collect::<Vec<_>>()
    };
    let mut found = differing(&rgb(gpu), &rgb(cpu), 3, HALF, Scale::Rms);
    found.extend(reported(gpu.len(), |wrong| {
        let coverage = |i: usize| cpu[i][3] + if wrong == Some(i) { 0.5 } else { 0.0 };
        (0..gpu.len())
            .filter(|&i| gpu[i][3] != coverage(i))
            .collect()
    }));
    found
}

#[test]
fn splat_and_composite_match_twin() {
    let harness = harness();
    let scene = synthetic::scene(SenderForm::Averages);
    let twin = cpu(&scene, &synthetic::lights(), &settings(1, false));
    let screen = Screen::new();
    let viewport = [3.0, 2.0, SIZE[0] as f32 - 5.0, SIZE[1] as f32 - 2.0];
    let params = |scale| {
        let (clip, root) = (screen::world_from_clip(), screen::local_from_world());
        SplatParams::new(
            clip,
            root,
            viewport,
            SIZE,
            scale,
            (&scene.data().display.grid).into(),
        )
    };
    let composite_params = CompositeParams {
        scale: 0.7,
        ..CompositeParams::default()
    };
    let drawn = draw(
        &harness,
        &scene,
        &twin,
        &screen,
        &params(0.5),
        (&composite_params, false),
    );
    assert_eq!(drawn.frame.counters().dispatches_of(EntryPoint::Splat), 1);
    assert_eq!(
        drawn.frame.counters().dispatches_of(EntryPoint::SplatOver),
        1
    );
    assert_eq!(drawn.frame.counters().composites, 1);

    // splat. Two tolerances: a position within rounding of a clip plane may be on either side of
    // it. A weight sum within rounding of NO_COVER may count or not. At most two of 2747 pixels
    // differ.
    let gpu = wide(&drawn.irradiance);
    let expected = splat_all(&scene, twin.vector_irradiance(), &screen, &params(0.5));
    let covered = expected.iter().filter(|e| e[3] == 1.0).count();
    let black = expected.iter().filter(|e| e[3] == 0.0).count();
    let is_estimate = |e: &[f32; 4]| e[3] == MIN_COVERED_FRACTION && e[..3] != [0.0; 3];
    let estimates = expected.iter().filter(|e| is_estimate(e)).count();
    assert!(
        covered > 500 && black > 100 && estimates > 100,
        "{covered} pixels are covered, {estimates} are estimates, {black} are neither"
    );
    let found = pixels_differing(&gpu, &expected);
    assert!(
        found.len() <= 2,
        "{} of {} pixels differ: {:?} {:?}",
        found.len(),
        gpu.len(),
        gpu[found[0]],
        expected[found[0]]
    );
    for perturb in [
        |s: &mut BakedScene| {
            s.data_mut()
                .display
                .planes
                .iter_mut()
                .for_each(|p| p[3] -= 0.05)
        },
        |s: &mut BakedScene| {
            let planes = s.data_mut().display.planes.iter_mut().step_by(3);
            planes.for_each(|p| *p = p.map(|c| 1.1 * c));
        },
        |s: &mut BakedScene| {
            s.data_mut()
                .points
                .iter_mut()
                .for_each(|p| p.radius *= 1.01)
        },
        |s: &mut BakedScene| {
            s.data_mut().points[..200]
                .iter_mut()
                .for_each(|p| p.position[1] += 0.01)
        },
    ] {
        let mut wrong = scene.clone();
        perturb(&mut wrong);
        let perturbed = splat_all(&wrong, twin.vector_irradiance(), &screen, &params(0.5));
        let found = pixels_differing(&gpu, &perturbed);
        let in_estimates = found.iter().filter(|&&i| is_estimate(&expected[i]));
        assert!(
            found.len() > 20 && in_estimates.count() > 0,
            "a wrong input is not detected"
        );
    }
    let perturbed = splat_all(&scene, twin.vector_irradiance(), &screen, &params(0.503));
    assert!(
        pixels_differing(&gpu, &perturbed).len() > 20,
        "a wrong scale is not detected"
    );

    // splat_over: covered pixels stay bit for bit, and so do estimates where this scene has no
    // cover. The others equal the output of `splat`.
    let mut replaced = 0;
    for (i, over) in drawn.over.iter().enumerate() {
        let [earlier, own] = [&screen.earlier, &drawn.irradiance].map(|t| t[i][3].to_f32());
        let has_cover = own > MIN_COVERED_FRACTION;
        let kept = earlier > MIN_COVERED_FRACTION || earlier > 0.0 && !has_cover;
        replaced += usize::from(earlier > 0.0 && !kept);
        let source = if kept {
            &screen.earlier[i]
        } else {
            &drawn.irradiance[i]
        };
        assert_eq!(over, source, "pixel {i}");
    }
    assert!(replaced > 100, "{replaced} estimates are replaced");

    // composite, from the same texels that the GPU read.
    let composited = |composite_params: &CompositeParams, passes: &[u8]| -> Vec<[f32; 3]> {
        let pixels = gpu.iter().zip(&screen.gbuffer).zip(passes);
        pixels
            .map(|((e, texel), &pass)| {
                composite::composite_pixel(composite_params, *e, *texel, u32::from(pass))
            })
            .collect()
    };
    // Alpha is not written.
    let alpha = |t: &[[f16; 4]]| t.iter().map(|t| t[3]).collect::<Vec<_>>();
    assert_eq!(alpha(&drawn.picture), alpha(&screen.lit));
    let rgb = |t: &[[f16; 4]]| -> Vec<[f32; 3]> {
        t.iter()
            .map(|t| [t[0], t[1], t[2]].map(f16::to_f32))
            .collect()
    };
    let added = |composite_params: &CompositeParams, passes: &[u8]| -> Vec<[f32; 3]> {
        let lit = rgb(&screen.lit)
            .into_iter()
            .zip(composited(composite_params, passes));
        lit.map(|(a, b)| [a[0] + b[0], a[1] + b[1], a[2] + b[2]])
            .collect()
    };
    let picture = rgb(&drawn.picture);
    let wrong = |expected: &[[f32; 3]]| differing(&picture, expected, 3, HALF, Scale::Item).len();
    assert_eq!(wrong(&added(&composite_params, &screen.passes)), 0);
    let brighter = CompositeParams {
        scale: 0.8,
        ..composite_params
    };
    assert!(wrong(&added(&brighter, &screen.passes)) > 20);
    assert!(wrong(&added(&composite_params, &vec![1; screen.passes.len()])) > 20);

    // The debug view: white, and replaces the picture.
    let white = CompositeParams {
        white: 1.0,
        ..composite_params
    };
    let drawn = draw(
        &harness,
        &scene,
        &twin,
        &screen,
        &params(0.5),
        (&white, true),
    );
    let picture = rgb(&drawn.picture);
    let wrong = |composite_params: &CompositeParams| {
        differing(
            &picture,
            &composited(composite_params, &screen.passes),
            3,
            HALF,
            Scale::Rms,
        )
        .len()
    };
    assert_eq!(wrong(&white), 0);
    assert!(wrong(&composite_params) > 20);
}

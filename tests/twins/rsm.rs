//! Comparison of the kernels of reflective shadow maps with their twins: `rsm` with its three entry
//! points, and `vpl`.

use super::compare::{HALF, SINGLE, Scale, differing, reported};
use super::depth::depth_texture;
use super::picture::wide;
use super::screen::{Screen, local_from_world};
use super::synthetic::{self, HashRandom};
use super::{cpu, harness, settings};
use bevy_meshless_gi::gpu::{GpuFrame, HeadlessDevice, KernelPipelines, SceneBuffers};
use bevy_meshless_gi::internals::gpu::{
    EntryPoint, RsmBuffers, RsmCapture, SplatTargets, VplShadows,
};
use glam::{Mat4, Vec3};
use half::f16;
use meshless_gi::internals::frame::rsm_layout::{
    light_in_space, local_from_space, space_from_clip,
};
use meshless_gi::internals::frame::{
    RsmParams, RsmSelectParams, RsmShadowParams, RsmTexel, Vpl, VplParams, VplViewParams, gbuffer,
    project, rsm, vpl,
};
use meshless_gi::internals::transport::SenderForm;
use meshless_gi::{BakedScene, FrameLight};
use wgpu::{TextureFormat, TextureUsages, TextureView, TextureViewDescriptor};

const SIDE: u32 = 32;
const VPLS: u32 = 48;

/// Map of random depths and normals, as in `Screen`.
struct Map {
    depth: Vec<f32>,
    gbuffer: Vec<[u32; 4]>,
    world_from_view: Mat4,
    clip_from_view: Mat4,
}

/// Origin of the lights' space.
const ORIGIN: Vec3 = Vec3::new(0.5, -1.0, 2.0);

impl Map {
    fn new(seed: i32, eye: Vec3, target: Vec3, parallel: bool) -> Self {
        let mut random = HashRandom::new(seed);
        let clip_from_view = match parallel {
            true => Mat4::orthographic_rh(-1.5, 1.5, -1.5, 1.5, 8.0, 0.1),
            false => Mat4::perspective_infinite_reverse_rh(1.1, 1.0, 0.1),
        };
        let toward = (eye - target).normalize();
        let mut out = Self {
            depth: Vec::new(),
            gbuffer: Vec::new(),
            world_from_view: Mat4::look_at_rh(eye, target, Vec3::Y).inverse(),
            clip_from_view,
        };
        for i in 0..SIDE * SIDE {
            let depth = match parallel {
                true => 0.2 + 0.7 * random.unit(),
                false => 0.1 / (0.5 + 2.5 * random.unit()),
            };
            out.depth.push(if i % 5 == 0 { 0.0 } else { depth });
            let flags = if i % 17 == 0 { gbuffer::UNLIT } else { 0 };
            let normal = (toward + 1.2 * random.vec()).normalize();
            let metal = 0.5 * random.unit();
            out.gbuffer
                .push(gbuffer::pack(random.color(), metal, 1.0, normal, flags));
        }
        out
    }

    fn params(&self, light: &FrameLight, first: u32) -> RsmParams {
        let m = space_from_clip(&self.world_from_view, &self.clip_from_view, ORIGIN);
        RsmParams::new(m, light, SIDE, first)
    }

    fn texels(&self, light: &FrameLight) -> Vec<RsmTexel> {
        rsm::texels(&self.params(light, 0), &self.depth, &self.gbuffer)
    }

    fn views(&self, harness: &HeadlessDevice) -> [TextureView; 2] {
        let read = TextureUsages::TEXTURE_BINDING;
        let depth = depth_texture(harness, [SIDE; 2], &self.depth);
        let format = TextureFormat::Rgba32Uint;
        let gbuffer = harness.texture([SIDE; 2], format, read, Some(&self.gbuffer));
        [depth, gbuffer].map(|t| t.create_view(&TextureViewDescriptor::default()))
    }
}

const EYE: Vec3 = Vec3::new(2.5, 1.5, 2.0);

/// Returns a light of each kind, with its maps.
fn light_sources() -> Vec<(FrameLight, Vec<Map>)> {
    let target = Vec3::new(0.5, 0.6, 0.4);
    let color = Vec3::new(9.0, 7.0, 5.0);
    let toward = (target - EYE).normalize();
    let maps = |parallel| vec![Map::new(21, EYE, target, parallel)];
    let two = vec![
        Map::new(22, EYE, target, false),
        Map::new(23, EYE, EYE + Vec3::X, false),
    ];
    [
        (FrameLight::point(EYE, color, 4.0), two),
        (
            FrameLight::spot(EYE, toward, color, 0.2, 0.5, f32::INFINITY),
            maps(false),
        ),
        (FrameLight::directional(toward, color), maps(true)),
        (FrameLight::patch(EYE, toward, color), maps(false)),
    ]
    .map(|(light, maps)| (light_in_space(&light, ORIGIN), maps))
    .into()
}

fn shadow_params(light: &FrameLight, scene: &BakedScene, texels: u32) -> RsmShadowParams {
    RsmShadowParams::new(
        local_from_space(&local_from_world(), ORIGIN),
        light,
        texels,
        scene.data().bvh.nodes.len() as u32,
        project::extent(scene.data()),
    )
}

/// Records the maps of a light and the choice of its virtual point lights.
fn record(
    buffers: &mut RsmBuffers,
    (kernels, queue, encoder): (&KernelPipelines, &wgpu::Queue, &mut wgpu::CommandEncoder),
    light: &FrameLight,
    maps: &[RsmCapture<'_>],
    scenes: &[(Mat4, &SceneBuffers)],
    vpls: u32,
) {
    for map in maps {
        buffers.map(kernels, queue, encoder, map);
    }
    buffers.select_vpls(kernels, queue, encoder, light, scenes, vpls);
}

fn selected_vpls(texels: &[RsmTexel]) -> Vec<Vpl> {
    let params = RsmSelectParams {
        texels: texels.len() as u32,
        vpls: VPLS,
        ..RsmSelectParams::default()
    };
    rsm::select_vpls(&params, texels)
}

/// Returns the texels that differ in position, normal, flux or spread. Each quantity is compared
/// separately, because units differ. At the edge of a cone the flux is a small difference, so the
/// scale is that of all texels.
fn texels_differing(gpu: &[RsmTexel], cpu: &[RsmTexel]) -> Vec<usize> {
    let parts: [fn(&RsmTexel) -> [f32; 3]; 4] = [
        |t| t.position,
        |t| t.normal,
        |t| t.flux,
        |t| [t.spread, 0.0, 0.0],
    ];
    let mut found: Vec<usize> = parts
        .iter()
        .flat_map(|part| {
            let of = |all: &[RsmTexel]| all.iter().map(part).collect::<Vec<_>>();
            differing(&of(gpu), &of(cpu), 3, 3.0 * SINGLE, Scale::Rms)
        })
        .collect();
    found.sort_unstable();
    found.dedup();
    found
}

/// Returns the number of virtual point lights that differ. Sums over texels in another order differ
/// by rounding: a position by a ten-thousandth of a meter. Panics if one wrong number of one light
/// is not reported.
fn vpls_differing(gpu: &[Vpl], cpu: &[Vpl]) -> usize {
    assert_eq!(gpu.len(), cpu.len());
    let near = |a: [f32; 3], b: [f32; 3], within: f32| {
        (Vec3::from_array(a) - Vec3::from_array(b))
            .abs()
            .max_element()
            <= within
    };
    let same = |a: &Vpl, b: &Vpl| {
        near(a.position, b.position, 1e-4)
            && near(a.normal, b.normal, 1e-4)
            && near(
                a.flux,
                b.flux,
                1e-4 * b.flux[0].max(b.flux[1]).max(b.flux[2]),
            )
            && (a.square - b.square).abs() <= 1e-4 * b.square.max(1.0)
    };
    let perturbations: [fn(&mut Vpl); 4] = [
        |v| v.position[2] += 1e-3,
        |v| v.normal[2] += 1e-3,
        |v| v.flux[2] += 1e-3 * v.flux[0].max(v.flux[1]).max(v.flux[2]) + 1e-6,
        |v| v.square += 1e-3 * v.square.max(1.0),
    ];
    let found = perturbations.map(|perturb| {
        reported(cpu.len(), |wrong| {
            let mut cpu = cpu.to_vec();
            if let Some(item) = wrong {
                perturb(&mut cpu[item]);
            }
            let pairs = gpu.iter().zip(&cpu).enumerate();
            pairs
                .filter(|(_, (g, c))| !same(g, c))
                .map(|(i, _)| i)
                .collect()
        })
    });
    found[0].len()
}

#[test]
fn rsm_matches_twin() {
    let harness = harness();
    let kernels = KernelPipelines::new(&harness.device).unwrap();
    let scene = synthetic::scene(SenderForm::Averages);
    let frame = GpuFrame::new(&kernels, &harness.queue, &scene, 1).unwrap();
    let light_sources = light_sources();
    let all = VPLS * light_sources.len() as u32;
    let room = 2 * SIDE * SIDE;
    let mut maps = RsmBuffers::new(&harness.device, 1, 1).unwrap();
    let local = local_from_space(&local_from_world(), ORIGIN);
    // Each light with and without a baked scene.
    for shadows in [false, true] {
        maps.begin(&harness.device, room, all).unwrap();
        let mut expected = Vec::new();
        for (light, own) in &light_sources {
            let views: Vec<_> = own.iter().map(|m| m.views(&harness)).collect();
            let drawn: Vec<_> = own
                .iter()
                .zip(&views)
                .map(|(map, [depth, gbuffer])| RsmCapture {
                    depth,
                    gbuffer,
                    params: map.params(light, 0),
                })
                .collect();
            let scenes = [(local, frame.buffers())];
            let scenes = &scenes[..usize::from(shadows)];
            harness
                .run(|e| {
                    record(
                        &mut maps,
                        (&kernels, &harness.queue, e),
                        light,
                        &drawn,
                        scenes,
                        VPLS,
                    )
                })
                .unwrap();
            let bare: Vec<RsmTexel> = own.iter().flat_map(|m| m.texels(light)).collect();
            let lit = bare.iter().filter(|t| t.flux[1] > 0.0).count();
            assert!(lit > 100, "{lit} texels are lit");
            let mut twin = bare.clone();
            if shadows {
                let params = shadow_params(light, &scene, twin.len() as u32);
                rsm::shadow(&params, &scene.data().bvh, &mut twin);
                assert!(twin != bare, "the scene shadows nothing");
            }
            let gpu: Vec<RsmTexel> = harness.read(maps.texels(), twin.len()).unwrap();
            let found = texels_differing(&gpu, &twin);
            // A ray that grazes an edge may be on either side of it.
            let flips =
                |&&i: &&usize| shadows && (gpu[i].flux == [0.0; 3]) != (twin[i].flux == [0.0; 3]);
            let by_shadow = found.iter().filter(flips).count();
            assert!(
                found.len() == by_shadow && by_shadow <= 2,
                "kind {}: {} differ, {by_shadow} by visibility; {:?}",
                light.kind,
                found.len(),
                found.first().map(|&i| (gpu[i], twin[i]))
            );
            // Wrong inputs.
            let mut moved = *light;
            moved.direction[1] += 0.01;
            moved.position[1] += 0.01;
            moved.color[0] *= 1.001;
            let wrong: Vec<RsmTexel> = own.iter().flat_map(|m| m.texels(&moved)).collect();
            assert!(texels_differing(&gpu, &wrong).len() > 50);
            if shadows {
                assert!(!texels_differing(&gpu, &bare).is_empty());
            }
            expected.push(gpu);
        }
        assert_eq!(maps.vpl_count(), all);
        // From the texels of the GPU, because a stratum may depend on one of them.
        let gpu: Vec<Vpl> = harness.read(maps.vpls(), all as usize).unwrap();
        for (gpu, texels) in gpu.chunks(VPLS as usize).zip(&expected) {
            assert!(gpu.iter().all(|v| v.flux[0] > 0.0));
            assert_eq!(vpls_differing(gpu, &selected_vpls(texels)), 0);
            let mut wrong = texels.clone();
            wrong.iter_mut().for_each(|t| t.position[2] += 1e-3);
            assert_eq!(vpls_differing(gpu, &selected_vpls(&wrong)), VPLS as usize);
            let mut wrong = texels.clone();
            wrong[..300].iter_mut().for_each(|t| t.flux = [0.0; 3]);
            assert!(vpls_differing(gpu, &selected_vpls(&wrong)) > 10);
        }
    }
    let counters = maps.counters();
    let of = |pass| counters.dispatches_of(pass);
    assert_eq!(
        [
            EntryPoint::RsmTexels,
            EntryPoint::RsmShadow,
            EntryPoint::RsmSelect
        ]
        .map(of),
        [10, 4, 8]
    );
    assert_eq!(counters.total(), 22);

    // Without flux, the lights are zero and not NaN.
    maps.begin(&harness.device, room, all).unwrap();
    let dark = FrameLight::default();
    let views = light_sources[0].1[0].views(&harness);
    let drawn = RsmCapture {
        depth: &views[0],
        gbuffer: &views[1],
        params: light_sources[0].1[0].params(&dark, 0),
    };
    harness
        .run(|e| {
            record(
                &mut maps,
                (&kernels, &harness.queue, e),
                &dark,
                &[drawn],
                &[],
                VPLS,
            )
        })
        .unwrap();
    let gpu: Vec<Vpl> = harness.read(maps.vpls(), VPLS as usize).unwrap();
    assert_eq!(gpu, vec![Vpl::default(); VPLS as usize]);
}

#[test]
fn rsm_without_request_is_not_created() {
    let harness = harness();
    let kernels = KernelPipelines::new(&harness.device).unwrap();
    let mut maps = RsmBuffers::new(&harness.device, 64, 16).unwrap();
    let light = FrameLight::point(Vec3::ZERO, Vec3::ONE, 9.0);
    harness
        .run(|e| {
            record(
                &mut maps,
                (&kernels, &harness.queue, e),
                &light,
                &[],
                &[],
                16,
            )
        })
        .unwrap();
    assert_eq!((maps.counters().total(), kernels.pipeline_count()), (0, 0));
    assert_eq!(maps.vpl_count(), 0);
    assert!(maps.bytes() < 64 * 48 + 16 * 48 + 200);
}

#[test]
fn vpl_matches_twin() {
    let harness = harness();
    let kernels = KernelPipelines::new(&harness.device).unwrap();
    let scene = synthetic::scene(SenderForm::Averages);
    let twin = cpu(&scene, &synthetic::lights(), &settings(0, false));
    assert!(!twin.vector_irradiance().is_empty());
    let frame = GpuFrame::new(&kernels, &harness.queue, &scene, 1).unwrap();
    let screen = Screen::new();
    let size = super::screen::SIZE;
    let viewport = [3.0, 2.0, size[0] as f32 - 5.0, size[1] as f32 - 2.0];
    let local = local_from_space(&local_from_world(), ORIGIN);

    // Lights from a map, and two that no map contains: one without a normal, and one without a
    // size.
    let (light, own) = &light_sources()[0];
    let mut lights = selected_vpls(&own[0].texels(light));
    lights[3].normal = [0.0; 3];
    lights[4].square = 0.0;
    lights[5] = Vpl::default();
    let mut maps = RsmBuffers::new(&harness.device, SIDE * SIDE, VPLS).unwrap();
    let views = own[0].views(&harness);
    let drawn = RsmCapture {
        depth: &views[0],
        gbuffer: &views[1],
        params: own[0].params(light, 0),
    };
    harness
        .run(|e| {
            record(
                &mut maps,
                (&kernels, &harness.queue, e),
                light,
                &[drawn],
                &[],
                VPLS,
            )
        })
        .unwrap();
    harness
        .queue
        .write_buffer(maps.vpls(), 0, bytemuck::cast_slice(&lights));

    let read = TextureUsages::TEXTURE_BINDING | TextureUsages::COPY_SRC;
    let half4 = TextureFormat::Rgba16Float;
    let depth = depth_texture(&harness, size, &screen.depth);
    let gbuffer = harness.texture(size, TextureFormat::Rgba32Uint, read, Some(&screen.gbuffer));
    let earlier = harness.texture(size, half4, read, Some(&screen.earlier));
    let view_of = |t: &wgpu::Texture| t.create_view(&TextureViewDescriptor::default());
    let (depth, gbuffer, earlier) = (view_of(&depth), view_of(&gbuffer), view_of(&earlier));
    let before = wide(&screen.earlier);

    for (shadows, over, scale) in [(false, false, 50.0), (true, true, 50.0), (true, false, 1e6)] {
        let by = VplShadows {
            local_from_space: local,
            scene: frame.buffers(),
            dim: 0.0,
        };
        let shadows = shadows.then_some(&by);
        let world_from_clip = super::screen::world_from_clip();
        let params = VplViewParams {
            space_from_clip: space_from_clip(&world_from_clip, &Mat4::IDENTITY, ORIGIN)
                .to_cols_array_2d(),
            viewport,
            size,
            scale,
            pad: 0,
        };
        let out =
            harness.texture::<[f16; 4]>(size, half4, read | TextureUsages::STORAGE_BINDING, None);
        let output = view_of(&out);
        let targets = SplatTargets {
            depth: &depth,
            gbuffer: &gbuffer,
            earlier: over.then_some(&earlier),
            output: &output,
        };
        let queue = &harness.queue;
        harness
            .run(|e| maps.splat(&kernels, queue, e, &params, shadows, &targets))
            .unwrap();
        let gpu = wide(&harness.read_texture::<[f16; 4]>(&out).unwrap());
        let picture = |params: &VplViewParams, lit: &VplParams, lights: &[Vpl]| {
            (0..(size[0] * size[1]) as usize)
                .map(|i| {
                    let pixel = [i as u32 % size[0], i as u32 / size[0]];
                    let earlier = if over { before[i] } else { [0.0; 4] };
                    let drawn = (pixel, screen.depth[i], screen.gbuffer[i]);
                    vpl::vpl_pixel(params, lit, lights, &scene.data().bvh, drawn, earlier)
                })
                .collect::<Vec<_>>()
        };
        let lit = maps.params(shadows);
        assert_eq!((lit.vpls, lit.nodes > 0), (VPLS, shadows.is_some()));
        let expected = picture(&params, &lit, &lights);
        let wrong = |expected: &[[f32; 4]]| differing(&gpu, expected, 4, HALF, Scale::Rms).len();
        let bright = expected.iter().filter(|e| e[0] > 0.0).count();
        assert!(bright > 500, "{bright}");
        // A ray within rounding of an edge may be on either side of it.
        assert!(wrong(&expected) <= 2, "{} differ", wrong(&expected));
        assert!(gpu.iter().flatten().all(|v| v.is_finite()));
        if scale > 1e5 {
            assert!(
                gpu.iter().any(|e| e[0] == 65_504.0),
                "no value is clamped to the largest f16"
            );
            continue;
        }
        let other = VplParams {
            nodes: scene.data().bvh.nodes.len() as u32 - lit.nodes,
            ..maps.params(Some(&by))
        };
        assert!(wrong(&picture(&params, &other, &lights)) > 20, "shadows");
        let mut dimmer = lights.clone();
        dimmer[7].flux[0] *= 0.5;
        dimmer[8].position[0] += 0.02;
        assert!(wrong(&picture(&params, &lit, &dimmer)) > 20, "lights");
        let scaled = VplViewParams {
            scale: 1.02 * scale,
            ..params
        };
        assert!(wrong(&picture(&scaled, &lit, &lights)) > 20, "scale");
    }
    let counters = maps.counters();
    assert_eq!(
        (
            counters.dispatches_of(EntryPoint::Vpl),
            counters.dispatches_of(EntryPoint::VplOver)
        ),
        (2, 1)
    );
}

//! Comparison of the replacement of Bevy's irradiance volume module with its twin, `read_volume`.
//! Runs the file itself, with substitutes for its imports from Bevy.

use crate::compare::{HALF, Scale, differing};
use crate::harness;
use crate::picture::wide;
use crate::synthetic::HashRandom;
use bevy_meshless_gi::gpu::HeadlessDevice;
use bytemuck::{Pod, Zeroable};
use glam::{Mat4, UVec3, Vec3};
use half::f16;
use meshless_gi::internals::frame::volume_sample::read_volume;
use meshless_gi::internals::frame::{VolumeParams, VoxelGrid};
use wgpu::util::DeviceExt;

/// Substitutes for Bevy. Two volumes cover all positions. The second has half the weight and is
/// four times as bright.
const BEVY: &str = "
struct ClusterableObjectIndexRanges { first: u32 }
struct LightProbeQueryResult { texture_index: i32, intensity: f32, light_from_world: mat4x4<f32>, weight: f32, flags: u32 }
struct LightProbeIterator { found: u32 }
struct SurfaceSample { position: vec3f, facing: vec3f }
struct View { clip_from_world: mat4x4<f32>, view_from_world: mat4x4<f32>, viewport: vec4f, exposure: f32 }
@group(0) @binding(0) var irradiance_volume: texture_3d<f32>;
@group(0) @binding(1) var irradiance_volume_sampler: sampler;
@group(0) @binding(2) var<storage, read> samples: array<SurfaceSample>;
@group(0) @binding(3) var<storage, read_write> lights: array<vec4f>;
@group(0) @binding(4) var view_transmission_texture: texture_2d<f32>;
// Looks along z from one voxel before the volume of 7 x 5 x 6, which fills its viewport; y points
// down.
var<private> view: View = View(
    mat4x4<f32>(2.0 / 7.0, 0.0, 0.0, 0.0, 0.0, -2.0 / 5.0, 0.0, 0.0, 0.0, 0.0, 0.1, 0.0, -1.0, 1.0, 0.0, 1.0),
    mat4x4<f32>(1.0, 0.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, -1.0, 1.0),
    vec4f(0.0, 0.0, 7.0, 5.0),
    0.5,
);
fn light_probe_iterator_new(position: vec3<f32>, is_volume: bool, ranges: ptr<function, ClusterableObjectIndexRanges>) -> LightProbeIterator {
    return LightProbeIterator((*ranges).first + select(9u, 0u, is_volume));
}
fn light_probe_iterator_next(probes: ptr<function, LightProbeIterator>) -> LightProbeQueryResult {
    (*probes).found += 1u;
    let k = (*probes).found;
    let size = vec3f(textureDimensions(irradiance_volume)) / vec3f(1.0, 2.0, 3.0);
    let matrix = mat4x4<f32>(1.0 / size.x, 0.0, 0.0, 0.0, 0.0, 1.0 / size.y, 0.0, 0.0, 0.0, 0.0, 1.0 / size.z, 0.0, -0.5, -0.5, -0.5, 1.0);
    return LightProbeQueryResult(select(-1, 0, k < 3u), select(4.0, 1.0, k == 1u), matrix, select(0.5, 1.0, k == 1u), 0u);
}
@compute @workgroup_size(64)
fn read_all(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= arrayLength(&samples) {
        return;
    }
    var ranges = ClusterableObjectIndexRanges(0u);
    lights[id.x] = vec4f(irradiance_volume_light(samples[id.x].position, samples[id.x].facing, &ranges), 1.0);
}
";

/// Position in voxels from the corner, and surface normal.
#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct SurfaceSample {
    position: [f32; 3],
    pad: u32,
    facing: [f32; 3],
    pad2: u32,
}

/// Returns the module, preprocessed with these definitions.
fn preprocessed(text: &str, defined: &[&str]) -> String {
    let (mut out, mut inside, mut import) = (String::new(), Vec::new(), false);
    for line in text.lines() {
        let words: Vec<&str> = line.split_whitespace().collect();
        match words.as_slice() {
            ["#ifdef", name] => inside.push(defined.contains(name)),
            ["#else"] => {
                let last = inside.last_mut().unwrap();
                *last = !*last;
            }
            ["#endif"] => {
                inside.pop().unwrap();
            }
            ["#define_import_path", _] => {}
            [first, ..] if import || *first == "#import" => {
                import = line.contains('{') && !line.contains('}') || import && !line.contains('}');
            }
            _ if inside.iter().all(|within| *within) => {
                out.push_str(line);
                out.push('\n');
            }
            _ => {}
        }
    }
    assert!(inside.is_empty() && !out.contains('#'), "{out}");
    out
}

/// Creates texels of a volume of this size, with light of any color and walls anywhere.
pub fn random_volume_texels(random: &mut HashRandom, size: UVec3) -> Vec<[f16; 4]> {
    let texels = size * UVec3::new(1, 2, 3);
    // A third of the voxels, and those with x < 3, have no wall. In the others, a third of the
    // directions have no wall up to the next voxel.
    let walls: Vec<[f32; 6]> = (0..size.element_product())
        .map(|i| {
            let open = random.below(3) == 0 || i % size.x < 3;
            std::array::from_fn(|_| match (open, random.below(3)) {
                (true, _) => -2.0,
                (false, 0) => -0.25 - 255.0 / 254.0,
                (false, _) => -0.25 - random.unit(),
            })
        })
        .collect();
    (0..texels.element_product())
        .map(|i| {
            let t = UVec3::new(
                i % texels.x,
                i / texels.x % texels.y,
                i / (texels.x * texels.y),
            );
            let (voxel, side) = (t % size, 2 * (t.z / size.z) + t.y / size.y);
            let voxel = voxel.x + size.x * (voxel.y + size.y * voxel.z);
            let light = random.color();
            [
                light.x,
                light.y,
                light.z,
                walls[voxel as usize][side as usize],
            ]
            .map(f16::from_f32)
        })
        .collect()
}

/// Creates a 3D texture.
pub fn create_texture_3d(
    harness: &HeadlessDevice,
    size: UVec3,
    texels: &[[f16; 4]],
) -> wgpu::TextureView {
    let texture = harness.device.create_texture_with_data(
        &harness.queue,
        &wgpu::TextureDescriptor {
            label: None,
            size: wgpu::Extent3d {
                width: size.x,
                height: size.y,
                depth_or_array_layers: size.z,
            },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D3,
            format: wgpu::TextureFormat::Rgba16Float,
            usage: wgpu::TextureUsages::TEXTURE_BINDING,
            view_formats: &[],
        },
        wgpu::util::TextureDataOrder::LayerMajor,
        bytemuck::cast_slice(texels),
    );
    texture.create_view(&wgpu::TextureViewDescriptor::default())
}

/// Creates an interpolating sampler.
pub fn linear_sampler(harness: &HeadlessDevice) -> wgpu::Sampler {
    harness.device.create_sampler(&wgpu::SamplerDescriptor {
        mag_filter: wgpu::FilterMode::Linear,
        min_filter: wgpu::FilterMode::Linear,
        ..Default::default()
    })
}

/// Creates a screen texture.
fn create_screen_texture(
    harness: &HeadlessDevice,
    [width, height]: [u32; 2],
    texels: &[[f16; 4]],
) -> wgpu::TextureView {
    let texture = harness.device.create_texture_with_data(
        &harness.queue,
        &wgpu::TextureDescriptor {
            label: None,
            size: wgpu::Extent3d {
                width,
                height,
                depth_or_array_layers: 1,
            },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: wgpu::TextureFormat::Rgba16Float,
            usage: wgpu::TextureUsages::TEXTURE_BINDING,
            view_formats: &[],
        },
        wgpu::util::TextureDataOrder::LayerMajor,
        bytemuck::cast_slice(texels),
    );
    texture.create_view(&wgpu::TextureViewDescriptor::default())
}

#[test]
fn volume_read_matches_twin() {
    let harness = harness();
    let device = &harness.device;
    let path = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/shaders/engine/irradiance_volume.wgsl"
    );
    let text = std::fs::read_to_string(path).unwrap();
    let module = preprocessed(
        &text,
        &["IRRADIANCE_VOLUMES_ARE_USABLE", "MESHLESS_GI_DISPLAY"],
    );
    let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: None,
        source: wgpu::ShaderSource::Wgsl(format!("{BEVY}{module}").into()),
    });
    let pipeline = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: None,
        layout: None,
        module: &module,
        entry_point: Some("read_all"),
        compilation_options: wgpu::PipelineCompilationOptions::default(),
        cache: None,
    });

    let mut random = HashRandom::new(5);
    let size = UVec3::new(7, 5, 6);
    let shape = VoxelGrid::new([Vec3::ZERO, size.as_vec3()], size).unwrap();
    let params = VolumeParams::new(&shape, &Mat4::IDENTITY);
    let texels = shape.texels();
    let voxels = random_volume_texels(&mut random, size);
    // Includes the outermost half voxels, positions outside the volume, and normals along the axes.
    let queries: Vec<SurfaceSample> = (0..2000)
        .map(|k| {
            let part = Vec3::new(random.unit(), random.unit(), random.unit());
            let facing = match k % 4 {
                0 => Vec3::AXES[k / 4 % 3] * [1.0, -1.0][k / 12 % 2],
                _ => random.direction(),
            };
            let mut position = (part * 1.2 - 0.1) * size.as_vec3();
            if k % 3 == 0 {
                // The same depth as surfaces of the splatting result below.
                position.z = 3.0;
            }
            SurfaceSample {
                position: position.to_array(),
                pad: 0,
                facing: facing.to_array(),
                pad2: 0,
            }
        })
        .collect();

    // Bevy's fallback texture instead of a splatting result has no negative alpha.
    let none = create_screen_texture(&harness, [1, 1], &[[f16::ONE; 4]]);
    let displayed = |voxels: &[[f16; 4]], display: &wgpu::TextureView| -> Vec<[f32; 4]> {
        let (view, sampler) = (
            create_texture_3d(&harness, texels, voxels),
            linear_sampler(&harness),
        );
        let upload = |contents: &[u8], usage| {
            device.create_buffer_init(&wgpu::util::BufferInitDescriptor {
                label: None,
                contents,
                usage: usage | wgpu::BufferUsages::STORAGE,
            })
        };
        let given = upload(bytemuck::cast_slice(&queries), wgpu::BufferUsages::COPY_DST);
        let lights = upload(
            bytemuck::cast_slice(&vec![[0f32; 4]; queries.len()]),
            wgpu::BufferUsages::COPY_SRC,
        );
        let resources = [
            wgpu::BindingResource::TextureView(&view),
            wgpu::BindingResource::Sampler(&sampler),
            given.as_entire_binding(),
            lights.as_entire_binding(),
            wgpu::BindingResource::TextureView(display),
        ];
        let entries: Vec<_> = (0u32..)
            .zip(resources)
            .map(|(binding, resource)| wgpu::BindGroupEntry { binding, resource })
            .collect();
        let bind = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: None,
            layout: &pipeline.get_bind_group_layout(0),
            entries: &entries,
        });
        harness
            .run(|encoder| {
                let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
                pass.set_pipeline(&pipeline);
                pass.set_bind_group(0, &bind, &[]);
                pass.dispatch_workgroups(queries.len().div_ceil(64) as u32, 1, 1);
            })
            .unwrap();
        harness.read(&lights, queries.len()).unwrap()
    };
    let on_device = |voxels: &[[f16; 4]]| displayed(voxels, &none);
    let expected = |voxels: &[[f32; 4]]| -> Vec<[f32; 4]> {
        let light = |p: &SurfaceSample| {
            let light = read_volume(params.size, voxels, p.position.into(), p.facing.into());
            // Weighted mean of both volumes: (1 + 4 · ½) / 1½ = 2.
            (light * 2.0).extend(1.0).to_array()
        };
        queries.iter().map(light).collect()
    };
    let off = |a: &[[f32; 4]], b: &[[f32; 4]]| differing(a, b, 4, 4.0 * HALF, Scale::Rms).len();

    let found = on_device(&voxels);
    let twin = expected(&wide(&voxels));
    assert_eq!(off(&found, &twin), 0);
    // Without the distances, or with distances one tenth longer, the light differs.
    let perturbed = |change: &dyn Fn(f32) -> f32| -> Vec<[f32; 4]> {
        let mut voxels = wide(&voxels);
        voxels.iter_mut().for_each(|t| t[3] = change(t[3]));
        voxels
    };
    let plain = perturbed(&|_| 1.0);
    assert!(off(&found, &expected(&plain)) * 3 > queries.len());
    let longer = perturbed(&|way| if way > -1.9 { way - 0.1 } else { way });
    assert!(off(&found, &expected(&longer)) * 20 > queries.len());
    // A volume without the encoded distances is sampled with plain interpolation.
    let other: Vec<[f16; 4]> = plain.iter().map(|t| t.map(f16::from_f32)).collect();
    assert_eq!(off(&on_device(&other), &expected(&plain)), 0);
    // Uniform light is uniform between texels.
    let even: Vec<[f16; 4]> = (voxels.iter())
        .map(|t| [f16::ONE, f16::ONE, f16::ONE, t[3]])
        .collect();
    let even = on_device(&even);
    let largest = even.iter().map(|t| (t[0] - 2.0).abs()).fold(0.0, f32::max);
    assert!(largest < 0.01, "{largest}");
    // A splatting result applies to surfaces at its own depth only.
    let pixel = |x: u32, y: u32| {
        [
            0.25,
            0.5,
            1.0,
            if (x + y).is_multiple_of(2) {
                -4.0
            } else {
                -5.0
            },
        ]
    };
    let texels: Vec<[f16; 4]> = (0..size.x * size.y)
        .map(|i| pixel(i % size.x, i / size.x).map(f16::from_f32))
        .collect();
    let display = create_screen_texture(&harness, [size.x, size.y], &texels);
    let by_display = |p: &SurfaceSample| {
        let [x, y, z] = p.position;
        let inside = x >= 0.0 && y >= 0.0 && x < size.x as f32 && y < size.y as f32;
        let away = pixel(x.max(0.0) as u32, y.max(0.0) as u32)[3];
        inside && (1.0 + z + away).abs() < -0.01 * away
    };
    let with: Vec<[f32; 4]> = (queries.iter().zip(&twin))
        // The splatting result over the exposure, times 2 for both volumes as above.
        .map(|(p, volume)| match by_display(p) {
            true => [1.0, 2.0, 4.0, 1.0],
            false => *volume,
        })
        .collect();
    let shown = displayed(&voxels, &display);
    assert_eq!(off(&shown, &with), 0);
    assert!(off(&found, &with) * 20 > queries.len());
}

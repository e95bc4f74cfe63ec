//! Cost and error of irradiance in fewer numbers per point. The reference is vector irradiance in
//! three channels (48 bytes per point). The alternatives are irradiance at the point's normal and
//! vector irradiance in one channel (16 bytes each). Also compares the kernel `apply_one` with
//! `apply`. Prints bytes, times and differences for a box of flat walls, without and with a ball.
//!
//! ```text
//! cargo run --example precision -- draft|medium
//! ```

use bevy_meshless_gi::gpu::HeadlessDevice;
use bevy_meshless_gi::internals::gpu::KERNELS;
use bytemuck::NoUninit;
use glam::Vec3;
use meshless_gi::internals::basis::{NO_COVER, weight};
use meshless_gi::internals::frame::apply::apply_row;
use meshless_gi::internals::frame::apply_one::apply_one_row;
use meshless_gi::internals::frame::{SolveParams, VectorIrradiance};
use meshless_gi::{
    BakedScene, CpuFrame, FrameLight, FrameSettings, Light, Material, Preset, Progress, Quad,
    Recipe, TriangleMesh, bake_scene,
};
use std::error::Error;
use std::f32::consts::{PI, TAU};
use std::hint::black_box;
use std::time::Instant;
use wgpu::util::{BufferInitDescriptor, DeviceExt};

/// Number of positions at which the display is evaluated.
const POSITIONS: usize = 20_000;
/// Number of runs. The minimum counts.
const RUNS: usize = 40;
const BALL: (Vec3, f32) = (Vec3::new(-0.15, 1.25, 0.25), 0.35);

fn main() -> Result<(), Box<dyn Error>> {
    let preset = match std::env::args().nth(1).as_deref() {
        Some("draft") => Preset::Draft,
        Some("medium") => Preset::Medium,
        _ => return Err("usage: precision draft|medium".into()),
    };
    let harness = HeadlessDevice::new()?;
    println!("{}\n", harness.adapter);
    println!(
        "| scene | points | bytes of values | of all on the device | functions visited | functions with weight | bytes read per lookup, vector | scalar | µs per lookup, vector | scalar |\n\
         |---|---|---|---|---|---|---|---|---|---|"
    );
    let mut errors = String::new();
    let mut solves = String::new();
    for ball in [false, true] {
        let mut quads = Quad::cornell_box();
        if ball {
            quads.extend(sphere());
        }
        let name = if ball { "with a ball" } else { "Cornell box" };
        let recipe = Recipe {
            preset,
            ..Recipe::default()
        };
        let scene = bake_scene(
            &TriangleMesh::from_quads(&quads),
            &recipe,
            0,
            &Progress::default(),
        )?
        .scene;
        let mut frame = CpuFrame::new(&scene);
        let light = Light::Point {
            position: Vec3::new(0.4, 1.7, 0.5),
            intensity: Vec3::splat(2.0),
            range: f32::INFINITY,
        };
        frame.set_lights(&scene, &FrameLight::expand(&light, 1));
        frame.solve(&scene, &FrameSettings::bounces(4));
        let values = frame.vector_irradiance();
        let scalars: Vec<[f32; 4]> = (scene.data().points.iter().zip(values))
            .map(|(p, e)| e.dot(p.n()).extend(0.0).to_array())
            .collect();
        let mut positions = walls(&quads, POSITIONS);
        display(name, &scene, values, &scalars, &positions);
        errors += &irradiance_difference(name, "walls", &scene, values, &scalars, &positions, 0.0);
        if ball {
            positions = on_ball();
            errors +=
                &irradiance_difference(name, "the ball", &scene, values, &scalars, &positions, 0.0);
        }
        errors += &irradiance_difference(
            name,
            "walls, bumps of 20°",
            &scene,
            values,
            &scalars,
            &walls(&quads, POSITIONS),
            20f32.to_radians(),
        );
        solves += &solve(&harness, name, &scene, frame.senders())?;
    }
    println!(
        "\n| scene | where | NRMSE scalar to vector | p99 | largest |\n|---|---|---|---|---|\n{errors}"
    );
    println!(
        "| scene | links | bytes a solve reads and writes, three channels | one channel and three written | all in one channel | scalar | ms on the CPU, `apply` | `apply_one` | ms on the device, `apply` | `apply_one` | all in one channel |\n|---|---|---|---|---|---|---|---|---|---|---|\n{solves}"
    );
    Ok(())
}

/// Returns a ball of flat faces.
fn sphere() -> Vec<Quad> {
    let (around, up) = (48, 24);
    let at = |i: usize, j: usize| {
        let (phi, theta) = (
            TAU * (i % around) as f32 / around as f32,
            PI * j as f32 / up as f32,
        );
        let way = Vec3::new(
            theta.sin() * phi.cos(),
            theta.cos(),
            theta.sin() * phi.sin(),
        );
        BALL.0 + BALL.1 * way
    };
    let mut quads = Vec::new();
    // The caps have a gap of about one degree, which no probe enters.
    for j in 1..up - 1 {
        for i in 0..around {
            quads.push(Quad {
                corners: [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)],
                material: Material::diffuse(Vec3::splat(0.6)),
            });
        }
    }
    quads
}

/// Returns counter-based random numbers in 0 to 1.
fn number(i: usize, k: u32) -> f32 {
    let mut h = (i as u32).wrapping_mul(0x9e37_79b9) ^ k.wrapping_mul(0x85eb_ca6b);
    h = (h ^ (h >> 16)).wrapping_mul(0x7feb_352d);
    h = (h ^ (h >> 15)).wrapping_mul(0x846c_a68b);
    ((h ^ (h >> 16)) >> 8) as f32 / (1 << 24) as f32
}

/// Returns positions on the box with their normals.
fn walls(quads: &[Quad], count: usize) -> Vec<(Vec3, Vec3)> {
    let flat = &quads[..Quad::cornell_box().len()];
    (0..count)
        .map(|i| {
            let quad = &flat[i % flat.len()];
            let [a, b, _, d] = quad.corners;
            let n = (b - a).cross(d - a).normalize();
            (a + number(i, 1) * (b - a) + number(i, 2) * (d - a), n)
        })
        .collect()
}

/// Returns positions on the ball with smooth normals.
fn on_ball() -> Vec<(Vec3, Vec3)> {
    (0..POSITIONS)
        .map(|i| {
            let (y, phi) = (1.9 * number(i, 3) - 0.95, TAU * number(i, 4));
            let r = (1.0 - y * y).sqrt();
            let n = Vec3::new(r * phi.cos(), y, r * phi.sin());
            (BALL.0 + 0.999 * BALL.1 * n, n)
        })
        .collect()
}

/// Evaluates the display at a position: the weighted sum of `add`, divided by the sum of weights.
fn gather<T>(
    scene: &BakedScene,
    x: Vec3,
    n: Vec3,
    mut sum: T,
    add: impl Fn(&mut T, f32, usize),
) -> Option<(T, f32)> {
    let (mut cover, mut denominator) = (0.0, 0.0);
    for &j in scene.data().display.grid.indices_near(x) {
        let point = &scene.data().points[j as usize];
        let w = weight(point, &scene.data().display.planes, x, n);
        if w > 0.0 {
            let v = (w / point.radius) * (w / point.radius);
            cover += w;
            denominator += v;
            add(&mut sum, v, j as usize);
        }
    }
    (cover > NO_COVER).then_some((sum, denominator))
}

fn vector(
    scene: &BakedScene,
    values: &[VectorIrradiance],
    x: Vec3,
    n: Vec3,
    shaded: Vec3,
) -> Option<Vec3> {
    let (e, of) = gather(scene, x, n, VectorIrradiance::default(), |sum, v, j| {
        sum.add_scaled(v, &values[j])
    })?;
    Some((e.dot(shaded) / of).max(Vec3::ZERO))
}

fn scalar(scene: &BakedScene, values: &[[f32; 4]], x: Vec3, n: Vec3) -> Option<Vec3> {
    let (e, of) = gather(scene, x, n, glam::Vec4::ZERO, |sum, v, j| {
        *sum += v * glam::Vec4::from_array(values[j])
    })?;
    Some((e.truncate() / of).max(Vec3::ZERO))
}

/// Returns the minimum seconds of each function. They run alternately, so that other load affects
/// all alike.
fn fastest<const N: usize>(mut all: [&mut dyn FnMut(); N]) -> [f64; N] {
    let mut min = [f64::INFINITY; N];
    for _ in 0..RUNS {
        for (run, min) in all.iter_mut().zip(&mut min) {
            let start = Instant::now();
            run();
            *min = min.min(start.elapsed().as_secs_f64());
        }
    }
    min
}

fn display(
    name: &str,
    scene: &BakedScene,
    values: &[VectorIrradiance],
    scalars: &[[f32; 4]],
    positions: &[(Vec3, Vec3)],
) {
    let (mut looked, mut count, mut planes) = (0usize, 0usize, 0usize);
    for &(x, n) in positions {
        for &j in scene.data().display.grid.indices_near(x) {
            let point = &scene.data().points[j as usize];
            looked += 1;
            if weight(point, &scene.data().display.planes, x, n) > 0.0 {
                count += 1;
                planes += point.plane_range().len();
            }
        }
    }
    let per_position = |n: usize| n as f64 / positions.len() as f64;
    let read = |value: usize| per_position(looked * 36 + planes * 16 + count * value);
    let [of_vector, of_scalar] = fastest([
        &mut || {
            for &(x, n) in positions {
                black_box(vector(scene, values, x, n, n));
            }
        },
        &mut || {
            for &(x, n) in positions {
                black_box(scalar(scene, scalars, x, n));
            }
        },
    ]);
    let own = size_of_val(values);
    let links = scene.data().operator.links.len() * 8;
    let others = size_of_val(&scene.data().points[..])
        + size_of_val(&scene.data().surfaces[..])
        + links
        + size_of_val(&scene.data().display.grid.entries[..])
        + size_of_val(&scene.data().display.planes[..])
        + size_of_val(&scene.data().bvh.triangles[..])
        + size_of_val(&scene.data().bvh.nodes[..]);
    println!(
        "| {name} | {} | {own} | {:.1} % | {:.1} | {:.1} | {:.0} | {:.0} | {:.3} | {:.3} |",
        scene.data().points.len(),
        100.0 * own as f64 / (own + others) as f64,
        per_position(looked),
        per_position(count),
        read(48),
        read(16),
        1e6 * of_vector / positions.len() as f64,
        1e6 * of_scalar / positions.len() as f64,
    );
}

/// Returns the difference of scalar and vector irradiance for normals bent by an angle in radians.
fn irradiance_difference(
    name: &str,
    position: &str,
    scene: &BakedScene,
    values: &[VectorIrradiance],
    scalars: &[[f32; 4]],
    positions: &[(Vec3, Vec3)],
    bend: f32,
) -> String {
    let mut off = Vec::new();
    let mut all = 0.0f64;
    for (i, &(x, n)) in positions.iter().enumerate() {
        let along = n.any_orthonormal_vector();
        let across = n.cross(along);
        let phi = TAU * number(i, 7);
        let bent = bend.cos() * n + bend.sin() * (phi.cos() * along + phi.sin() * across);
        if let (Some(a), Some(b)) = (
            vector(scene, values, x, n, bent),
            scalar(scene, scalars, x, n),
        ) {
            off.push((a - b).length());
            all += f64::from(a.length_squared());
        }
    }
    let rms = (all / off.len() as f64).sqrt();
    let squared: f64 = off.iter().map(|d| f64::from(d * d)).sum();
    off.sort_by(f32::total_cmp);
    format!(
        "| {name} | {position} | {:.2} % | {:.1} % | {:.1} % |\n",
        100.0 * (squared / off.len() as f64).sqrt() / rms,
        100.0 * f64::from(off[off.len() * 99 / 100]) / rms,
        100.0 * f64::from(off[off.len() - 1]) / rms,
    )
}

/// Returns the bytes that the operator reads and writes, and its time on one core.
fn solve(
    harness: &HeadlessDevice,
    name: &str,
    scene: &BakedScene,
    senders: &[[f32; 4]],
) -> Result<String, Box<dyn Error>> {
    let links = scene.data().operator.links.len();
    let rows = &scene.data().operator.rows;
    let gray: Vec<f32> = senders.iter().map(|f| f[0]).collect();
    let all = &scene.data().operator.links;
    let [three, one] = fastest([
        &mut || {
            for row in rows {
                black_box(apply_row(row, all, senders));
            }
        },
        &mut || {
            for row in rows {
                black_box(apply_one_row(row, all, senders, 1, [1.0; 4]));
            }
        },
    ]);
    let three_channels = Applied::new(harness, scene, &kernel("apply")?, senders, 48);
    let one_channel = Applied::new(harness, scene, &kernel("apply_one")?, senders, 48);
    let alone = Applied::new(harness, scene, &alone()?, &gray, 16);
    let [device_three, device_one, device_alone] = fastest([
        &mut || three_channels.run(),
        &mut || one_channel.run(),
        &mut || alone.run(),
    ]);
    let bytes = |coefficient: usize, value: usize| links * (8 + coefficient) + rows.len() * value;
    Ok(format!(
        "| {name} | {links} | {} | {} | {} | {} | {:.2} | {:.2} | {:.2} | {:.2} | {:.2} |\n",
        bytes(16, 48),
        bytes(4, 48),
        bytes(4, 16),
        bytes(16, 16),
        1e3 * three,
        1e3 * one,
        1e3 * device_three,
        1e3 * device_one,
        1e3 * device_alone,
    ))
}

/// Returns the source of a kernel without changes.
fn kernel(name: &str) -> Result<String, Box<dyn Error>> {
    let kernel = KERNELS.iter().find(|k| k.name == name);
    Ok(kernel.ok_or("unknown kernel")?.source.into())
}

/// Returns `apply` for arrays of one channel: one number per coefficient, three per value.
fn alone() -> Result<String, Box<dyn Error>> {
    let mut source = kernel("apply")?;
    for (from, to) in [
        ("coefficients: array<vec4f>", "coefficients: array<f32>"),
        ("applied: array<VectorIrradiance>", "applied: array<vec4f>"),
        ("sums_x: array<vec3f, 64>", "sums_x: array<f32, 64>"),
        ("sums_y: array<vec3f, 64>", "sums_y: array<f32, 64>"),
        ("sums_z: array<vec3f, 64>", "sums_z: array<f32, 64>"),
        ("var x = vec3f(0.0)", "var x = 0.0"),
        ("var y = vec3f(0.0)", "var y = 0.0"),
        ("var z = vec3f(0.0)", "var z = 0.0"),
        ("[link.z_sender >> 16u].xyz", "[link.z_sender >> 16u]"),
        ("applied[i] = VectorIrradiance(", "applied[i] = vec4f("),
        (
            "vec4f(row.scale * sums_x[local], 0.0),",
            "row.scale * sums_x[local],",
        ),
        (
            "vec4f(row.scale * sums_y[local], 0.0),",
            "row.scale * sums_y[local],",
        ),
        (
            "vec4f(row.scale * sums_z[local], 0.0),",
            "row.scale * sums_z[local], 0.0",
        ),
    ] {
        if source.matches(from).count() != 1 {
            return Err(format!("kernel `apply` has no single `{from}`").into());
        }
        source = source.replace(from, to);
    }
    Ok(source)
}

/// Times the operator on the device in one of the three forms.
struct Applied<'a> {
    harness: &'a HeadlessDevice,
    pipeline: wgpu::ComputePipeline,
    bind: wgpu::BindGroup,
    groups: u32,
}

impl<'a> Applied<'a> {
    fn new<T: NoUninit>(
        harness: &'a HeadlessDevice,
        scene: &BakedScene,
        source: &str,
        coefficients: &[T],
        value: usize,
    ) -> Self {
        let device = &harness.device;
        let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: None,
            source: wgpu::ShaderSource::Wgsl(source.into()),
        });
        let pipeline = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: None,
            layout: None,
            module: &module,
            entry_point: None,
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            cache: None,
        });
        let filled = |bytes: &[u8], usage| {
            device.create_buffer_init(&BufferInitDescriptor {
                label: None,
                contents: bytes,
                usage,
            })
        };
        let (rows, links) = (&scene.data().operator.rows, &scene.data().operator.links);
        let count = rows.len() as u32;
        let order: Vec<u32> = (0..count).collect();
        let read = wgpu::BufferUsages::STORAGE;
        let buffers = [
            filled(
                bytemuck::bytes_of(&[0, count, 0, 0]),
                wgpu::BufferUsages::UNIFORM,
            ),
            filled(bytemuck::cast_slice(rows), read),
            filled(bytemuck::cast_slice(links), read),
            filled(bytemuck::cast_slice(coefficients), read),
            filled(&vec![0; value * rows.len()], read),
            filled(bytemuck::cast_slice(&order), read),
        ];
        let params = SolveParams {
            hue: [1.0; 4],
            ..SolveParams::default()
        };
        let params = filled(bytemuck::bytes_of(&params), wgpu::BufferUsages::UNIFORM);
        let mut entries: Vec<_> = (1..)
            .zip(&buffers)
            .map(|(binding, buffer)| wgpu::BindGroupEntry {
                binding,
                resource: buffer.as_entire_binding(),
            })
            .collect();
        if source.contains("fn apply_one(") {
            entries.push(wgpu::BindGroupEntry {
                binding: 0,
                resource: params.as_entire_binding(),
            });
        }
        let bind = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: None,
            layout: &pipeline.get_bind_group_layout(0),
            entries: &entries,
        });
        Self {
            harness,
            pipeline,
            bind,
            groups: count.div_ceil(4),
        }
    }

    fn run(&self) {
        let done = self.harness.run(|encoder| {
            let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
            pass.set_pipeline(&self.pipeline);
            pass.set_bind_group(0, &self.bind, &[]);
            pass.dispatch_workgroups(self.groups.min(65_535), self.groups.div_ceil(65_535), 1);
        });
        done.expect("the device completes its work");
    }
}

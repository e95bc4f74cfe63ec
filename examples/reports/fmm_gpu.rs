//! Times of the fast multipole method on the device and on the CPU: upward and downward pass, as in
//! [G08] Figs. 10 and 11. Prints a table with the name of the adapter.
//!
//! ```text
//! cargo run --release --example fmm_gpu
//! ```
//!
//! Each time is the minimum of three. Device times are from submission to completion. The CPU
//! computes in single precision too.

use meshless_gi_lab::fixtures::fmm as room;

use bevy_meshless_gi::gpu::{HeadlessDevice, KernelPipelines};
use bevy_meshless_gi::internals::gpu::{GpuCounters, GpuFmm};
use glam::Vec3;
use meshless_gi::internals::frame::VectorIrradiance;
use meshless_gi::internals::frame::fmm_down::fmm_down;
use meshless_gi::internals::frame::fmm_up::fmm_up;
use meshless_gi::internals::transport::fmm::passes::Field;
use meshless_gi::internals::transport::fmm::{Fmm, FmmSettings, Passes};
use room::{varying_radiosity, with_ball};
use std::error::Error;
use std::time::Instant;

fn main() -> Result<(), Box<dyn Error>> {
    let harness = HeadlessDevice::new()?;
    let kernels = KernelPipelines::new(&harness.device)?;
    println!(
        "{}, {} CPU threads\n",
        harness.adapter,
        rayon::current_num_threads()
    );
    println!(
        "| points | CPU up, ms | CPU down, ms | GPU up, ms | GPU down, ms | ratio up | ratio down | largest difference over the RMS |"
    );
    println!("|---|---|---|---|---|---|---|---|");
    for points in [1000, 10_000, 30_000, 100_000, 300_000] {
        let room = with_ball(points);
        let radiosity = varying_radiosity(&room);
        // 50 points per leaf, as in [G08] §4.
        let settings = FmmSettings {
            leaf: 50,
            ..FmmSettings::default()
        };
        let fmm = Fmm::new(&room.points, &settings, None)?;
        let operator = fmm.operator(|at| at);
        let count = radiosity.len() as u32;
        let gpu = match GpuFmm::new(&harness.device, &harness.queue, &operator, count) {
            Ok(gpu) => gpu,
            Err(error) => {
                println!("| {points} | {error} |");
                break;
            }
        };
        // No sky.
        let light = radiosity.iter().chain([&Vec3::ZERO]);
        let light: Vec<[f32; 4]> = light.map(|b| b.extend(0.0).to_array()).collect();
        let buffer = |size: usize| {
            harness.device.create_buffer(&wgpu::BufferDescriptor {
                label: None,
                size: size as u64,
                usage: wgpu::BufferUsages::STORAGE
                    | wgpu::BufferUsages::COPY_DST
                    | wgpu::BufferUsages::COPY_SRC,
                mapped_at_creation: false,
            })
        };
        let (from, to) = (buffer(16 * light.len()), buffer(48 * radiosity.len()));
        let bytes = bytemuck::cast_slice(&light);
        harness.queue.write_buffer(&from, 0, bytes);
        let mut counters = GpuCounters::default();
        let mut passes = Passes::new(Field::from_operator(&operator));
        let mut values = vec![VectorIrradiance::default(); radiosity.len()];
        let mut min = [f64::INFINITY; 4];
        for _ in 0..3 {
            let mut note = |k: usize, start: Instant| {
                min[k] = min[k].min(1e3 * start.elapsed().as_secs_f64());
            };
            let start = Instant::now();
            fmm_up(&mut passes, &light);
            note(0, start);
            let start = Instant::now();
            fmm_down(&mut passes, &operator, &light, radiosity.len(), &mut values);
            note(1, start);
            let start = Instant::now();
            harness.run(|encoder| {
                let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
                gpu.record_upward(&kernels, &mut pass, &mut counters, &from);
            })?;
            note(2, start);
            let start = Instant::now();
            harness.run(|encoder| {
                let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
                gpu.record_downward(&kernels, &mut pass, &mut counters, &from, &to);
            })?;
            note(3, start);
        }
        let found: Vec<f32> = harness.read(&to, 12 * radiosity.len())?;
        let all: &[f32] = bytemuck::cast_slice(&values);
        let pairs = found.iter().zip(all);
        let largest = pairs.fold(0.0f32, |m, (a, b)| m.max((a - b).abs()));
        // The fourth component is unused.
        let rms = (all.iter().map(|e| e * e).sum::<f32>() / (0.75 * all.len() as f32)).sqrt();
        let [a, b, c, d] = min;
        println!(
            "| {} | {a:.2} | {b:.2} | {c:.2} | {d:.2} | {:.2} | {:.2} | {:.1e} |",
            room.points.len(),
            a / c,
            b / d,
            largest / rms
        );
    }
    Ok(())
}

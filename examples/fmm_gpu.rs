//! The fast multipole method on the device beside the CPU: upward and downward pass, as [G08] Figs. 10 and 11. Prints a table with the name of the adapter.
//!
//! ```text
//! cargo run --release --no-default-features --features cli,gpu --example fmm_gpu
//! ```
//!
//! Each time is the least of three, that of the device from submission until it is done. The CPU's are in single precision too.

#[path = "fmm/room.rs"]
#[allow(dead_code, reason = "the rooms serve several examples")]
mod room;

use bevy_meshless_gi::frame::fmm_down::fmm_down;
use bevy_meshless_gi::frame::fmm_up::fmm_up;
use bevy_meshless_gi::gpu::{GpuFmm, Harness, Kernels};
use bevy_meshless_gi::transport::fmm::passes::Field;
use bevy_meshless_gi::transport::fmm::{Fmm, FmmSettings, Passes};
use room::{glow, with_ball};
use std::error::Error;
use std::time::Instant;

fn main() -> Result<(), Box<dyn Error>> {
    let harness = Harness::new()?;
    let kernels = Kernels::new(&harness.device)?;
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
        let radiosity = glow(&room);
        // 50 points a leaf, as in [G08] §4.
        let settings = FmmSettings {
            leaf: 50,
            ..FmmSettings::default()
        };
        let fmm = Fmm::new(&room.points, &settings, None)?;
        let mut gpu = match GpuFmm::new(&kernels, &harness.queue, &fmm) {
            Ok(gpu) => gpu,
            Err(why) => {
                println!("| {points} | {why} |");
                break;
            }
        };
        gpu.set_radiosity(&harness.queue, &radiosity);
        let field = Field::<f32>::new(fmm.tree(), fmm.lists(), fmm.expansions(), settings.disks);
        let sorted: Vec<_> = fmm
            .tree()
            .order
            .iter()
            .map(|&i| radiosity[i as usize].extend(0.0).to_array())
            .collect();
        let mut passes = Passes::new(field);
        let mut least = [f64::INFINITY; 4];
        for _ in 0..3 {
            let mut note = |k: usize, start: Instant| {
                least[k] = least[k].min(1e3 * start.elapsed().as_secs_f64());
            };
            let start = Instant::now();
            fmm_up(&mut passes, &sorted);
            note(0, start);
            let start = Instant::now();
            fmm_down(&mut passes, &sorted);
            note(1, start);
            let start = Instant::now();
            harness.run(|encoder| gpu.up(&kernels, encoder))?;
            note(2, start);
            let start = Instant::now();
            harness.run(|encoder| gpu.down(&kernels, encoder))?;
            note(3, start);
        }
        let found: Vec<[f32; 4]> = harness.read(gpu.outputs()[2], sorted.len())?;
        let pairs = found
            .as_flattened()
            .iter()
            .zip(passes.irradiance.as_flattened());
        let largest = pairs.fold(0.0f32, |m, (a, b)| m.max((a - b).abs()));
        let all = passes.irradiance.as_flattened();
        let rms = (all.iter().map(|e| e * e).sum::<f32>() / all.len() as f32 * 4.0 / 3.0).sqrt();
        let [a, b, c, d] = least;
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

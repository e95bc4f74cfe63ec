//! Error and time of the fast multipole method ([G08]): by order, by the number of points, and by
//! the tolerance for points that face away from each other. Also with visibility against the
//! reference integrator, and in bakes. Writes `fmm.md` and its charts.
//!
//! ```text
//! cargo run --release -p meshless_gi_lab --example fmm -- -o docs/reports [--most POINTS]
//! ```
//!
//! `--most` excludes larger scenes (1,024,000 points by default).

mod bakes;
mod document;
use meshless_gi_lab::fixtures::fmm as room;

use glam::Vec3;
use meshless_gi::internals::eval::irradiance_at_all;
use meshless_gi::internals::samples::Random;
use meshless_gi::internals::transport::fmm::harmonics::inverse_fourth;
use meshless_gi::internals::transport::fmm::lists::ListCounts;
use meshless_gi::internals::transport::fmm::{Fmm, FmmSettings, direct};
use meshless_gi::{Light, Quad, ReferenceSettings, TriangleMesh};
use meshless_gi_lab::accuracy::{Errors, errors};
use meshless_gi_lab::report::split_sentences;
use room::{Room, cornell, lit, varying_radiosity, with_ball};
use std::error::Error;
use std::path::PathBuf;
use std::time::Instant;

/// Number of receivers of the sums over all pairs.
const RECEIVERS: usize = 1000;
/// Maximum number of bounces, enough for every variant that does not diverge.
pub const BOUNCES: u32 = 16;
/// Number of rounds over all numbers of points.
pub const ROUNDS: usize = 5;
/// Number of points for the errors by order and by slack.
const POINTS: usize = 10_000;

/// Results of one order.
pub struct Order {
    /// Order of the expansion.
    pub order: usize,
    /// Median relative error of \[G08\] Eq. (5) at r_y / r_x = 0.4.
    pub series: f64,
    /// NRMSE of the irradiance against the sum over all pairs.
    pub error: f64,
    /// Seconds of one pass up and down.
    pub pass: f64,
}

/// Results of one number of points.
pub struct Size {
    /// Number of points.
    pub points: usize,
    /// Number of nodes.
    pub nodes: usize,
    /// Seconds: tree, lists, upward pass, downward pass.
    pub seconds: [f64; 4],
    /// Seconds of the sum over all pairs, extrapolated from a subset of receivers.
    pub direct: f64,
    /// NRMSE against the sum over all pairs.
    pub error: f64,
    /// Number of pairs of points in the near list.
    pub point_pairs: u64,
}

/// Results of one slack.
pub struct Slack {
    /// Slack of the interaction test.
    pub slack: f32,
    /// NRMSE against the sum over all pairs.
    pub error: f64,
    /// Seconds of the downward pass.
    pub down: f64,
    /// Sizes of the lists.
    pub counts: ListCounts,
}

/// Results of the Cornell box with visibility.
pub struct VisibilityResult {
    /// Number of points.
    pub points: usize,
    /// Maximum number of points per leaf.
    pub leaf: usize,
    /// Description.
    pub name: &'static str,
    /// Errors of many bounces against the reference integrator.
    pub errors: Errors,
    /// Seconds: lists with their rays, all bounces.
    pub seconds: [f64; 2],
    /// Number of bounces.
    pub bounces: u32,
    /// Sizes of the lists.
    pub counts: ListCounts,
}

/// All results of the document.
pub struct FmmResults {
    /// Results by order.
    pub orders: Vec<Order>,
    /// Results by number of points.
    pub sizes: Vec<Size>,
    /// Results by slack.
    pub slacks: Vec<Slack>,
    /// Results with visibility.
    pub visibility_results: Vec<VisibilityResult>,
}

fn main() -> Result<(), Box<dyn Error>> {
    let usage = "usage: fmm -o FOLDER [--most POINTS]";
    let (mut folder, mut max) = (None, 1_024_000);
    let mut args = std::env::args().skip(1);
    while let Some(arg) = args.next() {
        match arg.as_str() {
            "-o" => folder = Some(PathBuf::from(args.next().ok_or(usage)?)),
            "--most" => max = args.next().ok_or(usage)?.parse()?,
            _ => return Err(usage.into()),
        }
    }
    let folder = folder.ok_or(usage)?;
    let found = FmmResults {
        orders: orders()?,
        slacks: slacks()?,
        visibility_results: visibility_results()?,
        sizes: sizes(max)?,
    };
    let charts = folder.join("fmm");
    std::fs::create_dir_all(&charts)?;
    for (file, chart) in document::charts(&found) {
        std::fs::write(charts.join(file), chart.svg())?;
    }
    let text = document::text(&found)? + &bakes::measure(&charts)?;
    std::fs::write(folder.join("fmm.md"), split_sentences(&text))?;
    Ok(())
}

/// Returns the root mean square error relative to the root mean square of `right`, for a reference
/// without noise.
fn nrmse(values: &[Vec3], right: &[Vec3]) -> f64 {
    errors(values, right, &vec![Vec3::ZERO; right.len()]).nrmse
}

fn receiver_indices(room: &Room) -> Vec<u32> {
    let step = room.points.len().div_ceil(RECEIVERS).max(1);
    (0..room.points.len() as u32).step_by(step).collect()
}

fn at(values: &[Vec3], receivers: &[u32]) -> Vec<Vec3> {
    receivers.iter().map(|&i| values[i as usize]).collect()
}

/// Returns settings that isolate the error of the expansions: the kernel of [G08] without disks and
/// without slack.
fn exact() -> FmmSettings {
    FmmSettings {
        disks: false,
        slack: 0.0,
        ..FmmSettings::default()
    }
}

/// Returns the median errors of [G08] Eq. (5) up to each n, at r_y / r_x = 0.4.
fn series() -> Vec<f64> {
    let mut random = Random::new(1, 0x67_30_38, 0);
    let mut found = vec![Vec::new(); 17];
    for _ in 0..501 {
        let mut direction = || {
            let v = Vec3::from_array([0; 3].map(|_| random.unit() - 0.5));
            v.as_dvec3().normalize()
        };
        let (x, y) = (direction(), direction() * 0.4);
        let exact = x.distance_squared(y).powi(-2);
        let mut sum = 0.0;
        for (n, term) in inverse_fourth(16, x.to_array(), y.to_array())
            .into_iter()
            .enumerate()
        {
            sum += term;
            found[n].push((sum / exact - 1.0f64).abs());
        }
    }
    let median = |mut errors: Vec<f64>| {
        errors.sort_by(f64::total_cmp);
        errors[errors.len() / 2]
    };
    found.into_iter().map(median).collect()
}

fn orders() -> Result<Vec<Order>, Box<dyn Error>> {
    let room = with_ball(POINTS);
    let radiosity = varying_radiosity(&room);
    let receivers = receiver_indices(&room);
    let right = direct(&room.points, &radiosity, &receivers, false, None);
    let mut out = Vec::new();
    for (order, series) in series().into_iter().enumerate() {
        let settings = FmmSettings { order, ..exact() };
        let fmm = Fmm::new(&room.points, &settings, None)?;
        let start = Instant::now();
        let (e, _) = fmm.irradiance(&radiosity)?;
        out.push(Order {
            order,
            series,
            pass: start.elapsed().as_secs_f64(),
            error: nrmse(&at(&e, &receivers), &right),
        });
        eprintln!("order {order}");
    }
    Ok(out)
}

fn slacks() -> Result<Vec<Slack>, Box<dyn Error>> {
    let room = with_ball(POINTS);
    let radiosity = varying_radiosity(&room);
    let receivers = receiver_indices(&room);
    let right = direct(&room.points, &radiosity, &receivers, false, None);
    let mut out = Vec::new();
    for slack in [0.0, 0.03, 0.1, 0.3, 1.0] {
        let settings = FmmSettings {
            slack,
            order: 6,
            ..exact()
        };
        let fmm = Fmm::new(&room.points, &settings, None)?;
        let (e, times) = fmm.irradiance(&radiosity)?;
        out.push(Slack {
            slack,
            error: nrmse(&at(&e, &receivers), &right),
            down: times.down.as_secs_f64(),
            counts: fmm.lists().counts,
        });
        eprintln!("slack {slack}");
    }
    Ok(out)
}

/// Returns numbers of points. Above 1000 there are two per octave, so that a fit does not depend on
/// the leaf occupancy of one of them.
fn numbers(max: usize) -> Vec<usize> {
    let large = (0..=20).map(|k| (1000.0 * f64::powf(2.0, f64::from(k) / 2.0)) as usize);
    let all = [60, 120, 250, 500].into_iter().chain(large);
    all.filter(|&n| n <= max).collect()
}

fn sizes(max: usize) -> Result<Vec<Size>, Box<dyn Error>> {
    let numbers = numbers(max);
    let mut out: Vec<Size> = Vec::new();
    // Every round runs all sizes, and the minimum time counts. Temporary load of the machine thus
    // affects all sizes. Sizes that take microseconds run more often.
    for round in 0..ROUNDS {
        for (k, &points) in numbers.iter().enumerate() {
            let room = with_ball(points);
            let radiosity = varying_radiosity(&room);
            let receivers = receiver_indices(&room);
            for run in 0..(20_000 / points).clamp(1, 20) {
                let start = Instant::now();
                let right = direct(&room.points, &radiosity, &receivers, true, None);
                let slow = start.elapsed().as_secs_f64() * room.points.len() as f64
                    / receivers.len() as f64;
                let fmm = Fmm::new(&room.points, &FmmSettings::default(), None)?;
                let (e, times) = fmm.irradiance(&radiosity)?;
                let [tree, lists] = fmm.build;
                let seconds = [tree, lists, times.up, times.down].map(|t| t.as_secs_f64());
                if round == 0 && run == 0 {
                    out.push(Size {
                        points: room.points.len(),
                        nodes: fmm.tree().nodes.len(),
                        seconds,
                        direct: slow,
                        error: nrmse(&at(&e, &receivers), &right),
                        point_pairs: fmm.lists().counts.point_pairs,
                    });
                }
                let size = &mut out[k];
                size.direct = size.direct.min(slow);
                for (min, time) in size.seconds.iter_mut().zip(seconds) {
                    *min = min.min(time);
                }
            }
        }
        eprintln!("sizes, round {round}");
    }
    Ok(out)
}

fn visibility_results() -> Result<Vec<VisibilityResult>, Box<dyn Error>> {
    let mesh = TriangleMesh::from_quads(&Quad::cornell_box());
    let light_source = Light::Point {
        position: Vec3::new(0.0, 1.8, 0.2),
        intensity: Vec3::splat(10.0),
        range: f32::INFINITY,
    };
    let reference = ReferenceSettings {
        paths: 4096,
        bounces: None,
        seed: 5,
    };
    let default = FmmSettings::default();
    let mut out = Vec::new();
    for points in [2000, 8000, 32_000] {
        let room = cornell(points);
        let emission = lit(&room, &mesh, &light_source);
        let receivers: Vec<u32> = (0..room.points.len() as u32)
            .step_by(room.points.len() / 400)
            .collect();
        let positions: Vec<_> = receivers
            .iter()
            .map(|&i| &room.points[i as usize])
            .map(|p| (p.position, p.normal))
            .collect();
        let right = irradiance_at_all(
            &mesh,
            std::slice::from_ref(&light_source),
            &positions,
            &reference,
        );
        let (values, noise): (Vec<_>, Vec<_>) =
            right.iter().map(|r| (r.indirect, r.indirect_error)).unzip();
        let leaves = |leaf| FmmSettings { leaf, ..default };
        let variants = [
            ("default settings", default, true),
            ("small leaves", leaves(8), true),
            (
                "64 rays",
                FmmSettings {
                    rays: 64,
                    ..default
                },
                true,
            ),
            (
                "points instead of disks",
                FmmSettings {
                    disks: false,
                    ..default
                },
                true,
            ),
            ("no visibility", default, false),
        ];
        for (name, settings, visibility) in variants {
            let start = Instant::now();
            let fmm = match visibility {
                true => Fmm::new(&room.points, &settings, Some(&mesh))?,
                false => Fmm::new(&room.points, &settings, None)?,
            };
            let built = start.elapsed().as_secs_f64();
            let solved = fmm.solve(&room.albedo, &emission, BOUNCES, 1e-3)?;
            out.push(VisibilityResult {
                points: room.points.len(),
                leaf: settings.leaf,
                name,
                errors: errors(&at(&solved.irradiance, &receivers), &values, &noise),
                seconds: [built, (solved.times.up + solved.times.down).as_secs_f64()],
                bounces: solved.bounces,
                counts: fmm.lists().counts,
            });
        }
        eprintln!("{points} points with visibility");
    }
    Ok(out)
}

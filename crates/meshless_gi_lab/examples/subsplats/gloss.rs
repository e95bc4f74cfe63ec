//! Virtual lights on a screen: gloss refined for each light ([N09] Table 1, §3.3.1), and numbers of
//! lights at several resolutions ([N09] Fig. 14).

use super::gloss_support::{Scene, evaluated_fraction, room, virtual_lights};
use glam::Vec3;
use meshless_gi::internals::frame::refine::FLOOR;
use meshless_gi::internals::frame::subsplat::LUMINANCE;
use meshless_gi::internals::frame::vpl_specular::{
    SpecularView, receiver, specular_fraction, specular_of_light,
};
use meshless_gi::internals::frame::{SubsplatParams, VplParams, brdf, gbuffer, subsplats, vpl};
use meshless_gi::{SpecularSettings, SubsplatSettings};
use rayon::prelude::*;
use std::f32::consts::FRAC_1_PI;
use std::fmt::{Error, Write};
use std::time::Instant;

/// Size of the picture in [N09], and the level of its coarsest cells.
const SQUARE: [u32; 2] = [1024, 1024];
const COARSEST: u32 = 6;
/// [N09] Table 1: virtual lights along an edge, and the number of refinements of 16² cells. Fewer
/// than four refinements are "N/A" in the table.
const SIDES: [(u32, u32); 4] = [(16, 4), (32, 4), (64, 3), (128, 1)];
/// Maximum number of lights for which our lists are measured too.
const MAX: u32 = 1024;
/// Roughness of the floor.
const ROUGHNESS: f32 = 0.25;
const SMALL: [u32; 2] = [960, 540];
/// Numbers of lights on a screen.
const LIGHTS: [u32; 3] = [16, 64, 256];
/// Finest levels of Fig. 14.
const FINEST: [u32; 4] = [4, 3, 2, 1];
const QUARTER: [u32; 2] = [480, 270];

/// Column of Table 1: number of lights. `theirs` has the cells in the lists of [N09] and the
/// seconds of refinement by resolution, `ours` has our evaluations.
pub struct Column {
    lights: u32,
    theirs: Vec<(u64, f64)>,
    ours: Option<Vec<u64>>,
}

/// Results of gloss at screen size.
pub struct Row {
    lights: u32,
    /// Seconds, fraction of the evaluations and FLIP of full resolution, one list, and one list per
    /// light.
    modes: [(f64, f64, f32); 3],
}

/// Results of diffuse light: seconds at full resolution. `levels` has the fraction of the
/// evaluations and the seconds of each finest level.
pub struct Diffuse {
    lights: u32,
    full: f64,
    levels: Vec<(f64, f64)>,
}

pub struct Found {
    columns: Vec<Column>,
    rows: Vec<Row>,
    diffuse: Vec<Diffuse>,
}

fn timed<T>(run: impl FnOnce() -> T) -> (T, f64) {
    let began = Instant::now();
    let out = run();
    (out, began.elapsed().as_secs_f64())
}

pub fn measure() -> Found {
    let mesh = room();
    let mut scene = Scene::new(SQUARE, virtual_lights(&mesh, 32, 16), ROUGHNESS);
    let columns = SIDES.map(|(side, passes)| {
        scene.vpls = virtual_lights(&mesh, 128, side * side);
        scene.lit = VplParams::unshadowed(side * side);
        let column = column(&scene, passes);
        eprintln!("{side}² lights in lists of their own");
        column
    });
    let rows = LIGHTS.map(|count| {
        let scene = Scene::new(SMALL, virtual_lights(&mesh, 64, count), ROUGHNESS);
        let row = row(&scene);
        eprintln!("specular light of {count} lights");
        row
    });
    let diffuse = LIGHTS.map(|count| {
        diffuse(&Scene::new(
            QUARTER,
            virtual_lights(&mesh, 64, count),
            ROUGHNESS,
        ))
    });
    Found {
        columns: columns.into(),
        rows: rows.into(),
        diffuse: diffuse.into(),
    }
}

/// Returns the gloss of one light in a pixel, times the scale, which [N09] compares.
fn light_gloss(view: &SpecularView<'_>, i: u32, pixel: [u32; 2]) -> Vec3 {
    let size = view.screen.size;
    let (depth, texel) = (
        view.picture.depth(size, pixel),
        view.picture.texel(size, pixel),
    );
    if depth <= 0.0 || specular_fraction(view.params, texel) <= 0.0 {
        return Vec3::ZERO;
    }
    let at = receiver(view.view, &view.lights, pixel, depth, texel);
    let found = specular_of_light(&view.lights, i, &at);
    let f0 = gbuffer::f0(texel);
    let color = found.f0 * f0 + found.f90 * brdf::f90(f0);
    view.view.scale * color * Vec3::from_array(view.lights.vpls[i as usize].flux)
}

/// Computes the list of cells of one light by [N09] §3.3.1. Cells whose quadrants differ by more
/// than `max` in a channel are replaced by their quadrants. Returns the number of cells in the list
/// and the elapsed seconds of each pass.
fn cell_counts(view: &SpecularView<'_>, i: u32, passes: u32, max: f32) -> Vec<(u64, f64)> {
    let [w, h] = view.screen.size.map(|edge| edge >> COARSEST);
    let mut list: Vec<[u32; 2]> = (0..w * h).map(|c| [c % w, c / w]).collect();
    let (mut done, mut out) = (0, vec![(list.len() as u64, 0.0)]);
    let began = Instant::now();
    for pass in 0..passes {
        let edge = 1 << (COARSEST - pass);
        let mut next = Vec::new();
        for [x, y] in list {
            let [mut low, mut high] = [Vec3::INFINITY, Vec3::NEG_INFINITY];
            for q in 0..4 {
                let of = |at: u32, odd: u32| at * edge + edge / 4 + odd * edge / 2;
                let v = light_gloss(view, i, [of(x, q & 1), of(y, q >> 1)]);
                (low, high) = (low.min(v), high.max(v));
            }
            if (high - low).max_element() > max {
                next.extend((0..4).map(|q| [2 * x + (q & 1), 2 * y + (q >> 1)]));
            } else {
                done += 1;
            }
        }
        out.push((done + next.len() as u64, began.elapsed().as_secs_f64()));
        list = next;
    }
    out
}

fn column(scene: &Scene, passes: u32) -> Column {
    let settings = SpecularSettings {
        coarsest_level: COARSEST,
        finest_level: COARSEST - passes,
        ..SpecularSettings::default()
    };
    let params = scene.params(&settings);
    let view = scene.view(&params);
    let lights = scene.lit.vpls;
    // Our threshold at the mean gloss, divided equally among all lights.
    let some: Vec<u32> = (0..SQUARE[0] * SQUARE[1]).step_by(997).collect();
    let every: Vec<[f32; 4]> = some
        .into_par_iter()
        .map(|i| view.full(scene.pixel(i as usize)))
        .filter(|t| t[3] > 0.0)
        .collect();
    let each = every.iter().map(|t| Vec3::new(t[0], t[1], t[2]));
    let sum: f32 = each.map(|color| LUMINANCE.dot(color)).sum();
    let mean = sum / every.len().max(1) as f32;
    let max = view.screen.radiance_threshold * (mean + FLOOR * FRAC_1_PI) / lights as f32;
    let mut theirs = vec![(0, 0.0); passes as usize + 1];
    let lists: Vec<_> = (0..lights)
        .into_par_iter()
        .map(|i| cell_counts(&view, i, passes, max))
        .collect();
    for list in &lists {
        for (sum, (count, seconds)) in theirs.iter_mut().zip(list) {
            *sum = (sum.0 + count, sum.1 + seconds);
        }
    }
    let ours = (lights <= MAX).then(|| {
        let found = view.levels();
        (0..=passes as usize)
            .map(|pass| found.evaluated[COARSEST as usize - pass..].iter().sum())
            .collect()
    });
    Column {
        lights,
        theirs,
        ours,
    }
}

fn row(scene: &Scene) -> Row {
    let (full, seconds) = timed(|| scene.full());
    let way = |together| {
        let settings = SpecularSettings {
            together,
            ..SpecularSettings::default()
        };
        let (found, seconds) = timed(|| scene.run(&settings));
        let flip = scene.compare(&full, &found.texels).0;
        (seconds, evaluated_fraction(scene, &full, &found), flip)
    };
    Row {
        lights: scene.lit.vpls,
        modes: [(seconds, 1.0, 0.0), way(true), way(false)],
    }
}

fn diffuse(scene: &Scene) -> Diffuse {
    let drawn = |pixel: [u32; 2]| {
        let i = (pixel[1] * QUARTER[0] + pixel[0]) as usize;
        (pixel, scene.drawn.depth[i], scene.drawn.gbuffer[i])
    };
    let (_, full) = timed(|| {
        (0..scene.drawn.depth.len())
            .into_par_iter()
            .map(|i| {
                let of = drawn(scene.pixel(i));
                let bvh = &scene.bvh;
                vpl::vpl_pixel(&scene.view, &scene.lit, &scene.vpls, bvh, of, [0.0; 4])
            })
            .collect::<Vec<_>>()
    });
    let levels = FINEST
        .iter()
        .map(|&finest| {
            let params = SubsplatParams::new(
                &SubsplatSettings {
                    coarsest_level: 5,
                    finest_level: finest,
                    ..SubsplatSettings::default()
                },
                scene.view_from_clip,
                scene.view_from_world,
                scene.view.viewport,
                QUARTER,
            );
            let plain = scene.params(&SpecularSettings::default());
            let picture = scene.view(&plain).picture;
            let (found, seconds) = timed(|| {
                subsplats(&params, &picture, &|pixel, node| {
                    let of = drawn(pixel);
                    vpl::vpl_node(&scene.view, &scene.lit, &scene.vpls, &scene.bvh, of, node);
                })
            });
            let share = f64::from(found.counts.total()) / f64::from(found.counts.pixels);
            (share, seconds)
        })
        .collect();
    Diffuse {
        lights: scene.lit.vpls,
        full,
        levels,
    }
}

fn short(count: u64) -> String {
    match count {
        0..1_000_000 => format!("{:.1}K", count as f64 / 1e3),
        _ => format!("{:.2}M", count as f64 / 1e6),
    }
}

pub fn text(found: &Found, out: &mut String) -> Result<(), Error> {
    writeln!(
        out,
        "\n## Specular light: a list for each light ([N09] Table 1)\n\n\
         A room with a glossy floor (perceptual roughness {ROUGHNESS}), a metal ball and a crate, {} × {} pixels, virtual lights from a reflective shadow map of all surfaces.\n\
         Each cell has two values:\n\n\
         - the subsplats of [N09] §3.3.1: a list for each light, from 16² cells. A cell is divided if its quadrants differ by more than the threshold at the mean specular light over the number of lights. Next to it the CPU time to refine them, summed over threads.\n\
         - after the slash, the evaluations of a light in this implementation, to the same resolution.\n\n\
         [N09] evaluates each subsplat four times to refine it and once to show it.\n\
         This implementation has no lists: one bit per light marks a prediction that failed at a node. Only marked lights are evaluated around the node, and again at the nodes of the prediction.\n\
         Its threshold is per light, so the quality of both differs: see the next table.\n\
         \"–\" is not measured, as in [N09] if the lists are too long. This implementation has at most 1024 virtual lights per light.\n\n\
         | resolution |{}\n\
         |---|{}",
        SQUARE[0],
        SQUARE[1],
        found
            .columns
            .iter()
            .map(|c| format!(" {} lights |", c.lights))
            .collect::<String>(),
        "---|".repeat(found.columns.len())
    )?;
    for pass in 0..=4 {
        write!(out, "| {0} × {0} |", 16 << pass)?;
        for column in &found.columns {
            let Some(&(count, seconds)) = column.theirs.get(pass) else {
                write!(out, " – |")?;
                continue;
            };
            let ours = match &column.ours {
                Some(ours) => short(ours[pass]),
                None => "–".into(),
            };
            write!(
                out,
                " {}, {:.0} ms / {ours} |",
                short(count),
                1000.0 * seconds
            )?;
        }
        writeln!(out)?;
    }
    writeln!(
        out,
        "\nThe same room at {} × {} pixels with the default settings.\n\
         Each group: evaluations of lights relative to those at every glossy pixel, FLIP of diffuse and specular light, and time relative to every pixel, in one run.\n\
         \"One list\" divides cells by the sum of all lights.\n\n\
         | lights | every pixel | one list: fraction | FLIP | time | each light: fraction | FLIP | time |\n\
         |---|---|---|---|---|---|---|---|",
        SMALL[0], SMALL[1]
    )?;
    for row in &found.rows {
        let [full, one, each] = row.modes;
        writeln!(
            out,
            "| {} | {:.2} s | 1/{:.1} | {:.4} | {:.2} | 1/{:.1} | {:.4} | {:.2} |",
            row.lights,
            full.0,
            1.0 / one.1,
            one.2,
            one.0 / full.0,
            1.0 / each.1,
            each.2,
            each.0 / full.0
        )?;
    }
    writeln!(
        out,
        "\n## Number of lights ([N09] Fig. 14)\n\n\
         Diffuse light of the same lights by one list of subsplats, from cells of 32 pixels, {} × {} pixels.\n\
         Each cell: evaluations relative to the pixels, and time relative to every pixel. With many lights the two are equal.\n\
         `examples/reports/subsplats_gpu.rs` prints the same on a device.\n\n\
         | lights | every pixel |{}\n\
         |---|---|{}",
        QUARTER[0],
        QUARTER[1],
        FINEST
            .map(|k| format!(" finest {} pixels |", 1 << k))
            .concat(),
        "---|".repeat(FINEST.len())
    )?;
    for row in &found.diffuse {
        write!(out, "| {} | {:.0} ms |", row.lights, 1000.0 * row.full)?;
        for (share, seconds) in &row.levels {
            write!(out, " 1/{:.1}, {:.2} |", 1.0 / share, seconds / row.full)?;
        }
        writeln!(out)?;
    }
    Ok(())
}

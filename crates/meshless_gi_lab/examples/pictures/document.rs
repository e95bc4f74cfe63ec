//! Text of the document.

use super::measure::{Measured, Row};
use meshless_gi::Preset;
use std::fmt::Write;

/// Number of points of largest error that the document lists per reference.
const LISTED: usize = 3;

/// Returns the document.
pub fn text(scenes: &[Measured], presets: &[Preset]) -> String {
    let names: Vec<String> = presets.iter().map(|p| format!("{p:?}")).collect();
    let mut out = format!(
        "# Pictures\n\n\
         Indirect light of scenes with details that are hard for a basis on points, compared with the path tracer's.\n\
         Printed by one command:\n\n\
         ```text\n\
         cargo run -p meshless_gi_lab --example pictures -- -o docs/reports --presets {}\n\
         ```\n\n\
         The light is irradiance without albedo.\n\
         It has one to four reflections of the light of lights, and none to four of the light of the sky and of emissive surfaces.\n\
         A frame adds it to the direct light of its lights.\n\
         Each scene has three views of 96 x 54 pixels and 1000 random surface points, with 256 to 8192 paths each.\n\n\
         - **wrong**: fraction of pixels with a visible error.\n\
         \x20 The reference is scaled to a mean of 0.2, and any channel is off by more than 24 of 255 in sRGB.\n\
         - **NRMSE**: without the variance of the reference.\n\
         - **99.5 %**: NRMSE without the worst 0.5 % of the points.\n\
         - **p99**: 99th percentile of the error over the RMS of the reference.\n\
         - **dark**: points with a reference below 1 % of its RMS.\n\
         - **dark, wrong**: those of them that are more than three standard errors above 5 % of the RMS.\n\n\
         The pictures show the reference, then {}.\n\
         Below each is its difference to the reference, magnified three times.\n",
        names.join(",").to_lowercase(),
        names.join(", ")
    );
    for scene in scenes {
        section(&mut out, scene);
    }
    out
}

fn section(out: &mut String, scene: &Measured) {
    let _ = write!(out, "\n## {}\n\n", title(&scene.name));
    let bytes: Vec<String> = scene
        .bytes
        .iter()
        .map(|(preset, bytes)| format!("{preset:?} {:.1} MB", *bytes as f64 / 1e6))
        .collect();
    let _ = write!(
        out,
        "{} triangles. {}.\n\n",
        scene.triangles,
        bytes.join(", ")
    );
    out.push_str("| preset | points | wrong | NRMSE | 99.5 % | p99 | dark, wrong | dark |\n");
    out.push_str("|---|---|---|---|---|---|---|---|\n");
    for row in &scene.rows {
        let e = &row.errors;
        let _ = writeln!(
            out,
            "| {:?} | {} | {:.2} % | {:.1} % | {:.1} % | {:.0} % | {} | {} |",
            row.preset,
            row.set,
            100.0 * e.wrong_fraction,
            100.0 * e.nrmse,
            100.0 * e.nrmse_without_worst,
            100.0 * e.p99,
            e.dark_wrong,
            e.dark_count
        );
    }
    out.push('\n');
    for k in 1..=3 {
        let _ = writeln!(out, "![View {k}](pictures/{}_{k}.png)\n", scene.name);
    }
    out.push_str("Points of largest error:\n\n| preset | points | position, m | normal | reference, W/m² | bake |\n|---|---|---|---|---|---|\n");
    for row in &scene.rows {
        worst(out, row);
    }
}

fn worst(out: &mut String, row: &Row) {
    for (point, value) in row.worst.iter().take(LISTED) {
        let _ = writeln!(
            out,
            "| {:?} | {} | {} | {} | {} | {} |",
            row.preset,
            row.set,
            vector(point.position, 2),
            vector(point.normal, 1),
            vector(point.irradiance, 2),
            vector(*value, 2)
        );
    }
}

fn vector(v: glam::Vec3, digits: usize) -> String {
    format!("{:.digits$}, {:.digits$}, {:.digits$}", v.x, v.y, v.z)
}

/// Returns the name of a scene as a heading.
fn title(name: &str) -> String {
    let name = name.replace('_', " ");
    let mut chars = name.chars();
    chars.next().map_or_else(String::new, |first| {
        first.to_uppercase().chain(chars).collect()
    })
}

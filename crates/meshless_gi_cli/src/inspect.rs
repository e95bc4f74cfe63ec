//! `inspect`: prints the content of a bake as a table or as JSON.

use super::error::ToolError;
use super::input;
use super::output::{self, Table};
use meshless_gi::internals::asset::{BakedStats, SectionInfo, list_sections};
use meshless_gi::{AssetError, BakeInfo, BakedScene, TierInfo};
use serde_json::json;
use std::path::{Path, PathBuf};

#[derive(clap::Args)]
pub struct Args {
    /// Bake to inspect.
    bake: PathBuf,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

pub fn run(args: &Args) -> Result<(), ToolError> {
    let asset_error = |error: AssetError| ToolError::asset(&args.bake, &error);
    let scene = input::bake(&args.bake)?;
    let bytes = input::bytes(&args.bake)?;
    let sections = list_sections(&bytes, &input::limits()).map_err(asset_error)?;
    let stats = scene
        .validate()
        .map_err(AssetError::Invalid)
        .map_err(asset_error)?;
    output::print(&if args.json {
        format!("{:#}\n", as_json(&scene, &stats, &sections, bytes.len()))
    } else {
        as_table(&args.bake, &scene, &stats, &sections, bytes.len())
    })
}

fn as_json(
    scene: &BakedScene,
    stats: &BakedStats,
    sections: &[SectionInfo],
    size: usize,
) -> serde_json::Value {
    json!({
        "info": scene.info(),
        "stats": stats,
        "bytes": size,
        "sections": sections,
        "levels": scene.levels(),
        "sender_levels": scene.data().sender_levels,
        "points": scene.data().points.len(),
        "samples_per_sender": scene.data().light_samples.per_sender,
        "sender_form": format!("{:?}", scene.data().operator.form),
        "display_radius": scene.data().display.radius,
        "tiers": tiers(scene),
    })
}

/// Returns one entry per tier, fewest links first.
fn tiers(scene: &BakedScene) -> serde_json::Value {
    (scene.info().tiers.iter().zip(1..))
        .map(|(tier, number)| {
            json!({
                "tier": number,
                "rows": tier.rows,
                "links": tier.links,
                "bytes": tier.bytes(),
                "share": link_fraction(scene, tier, number),
                "estimated_nrmse": tier.estimated_nrmse,
                "estimated_nrmse_interval": tier.estimated_nrmse_interval,
            })
        })
        .collect()
}

/// Returns the links of a tier as a fraction of all links.
fn link_fraction(scene: &BakedScene, tier: &TierInfo, number: u32) -> f64 {
    // The octree has no links. Its tier lies above those of the links.
    match number > scene.data().link_tiers() {
        true => 1.0,
        false => tier.links as f64 / scene.data().operator.links.len().max(1) as f64,
    }
}

fn as_table(
    path: &Path,
    scene: &BakedScene,
    stats: &BakedStats,
    sections: &[SectionInfo],
    size: usize,
) -> String {
    let mut table = Table::default();
    add_source(&mut table, path, scene, stats, size as u64);
    add_operator(&mut table, scene, stats);
    add_optional_data(&mut table, scene, stats);
    add_display(&mut table, scene, stats);
    add_errors(&mut table, scene.info());
    add_tiers(&mut table, scene);
    add_sections(&mut table, sections, size);
    table.text()
}

/// Adds the file, its origin and the points.
fn add_source(table: &mut Table, path: &Path, scene: &BakedScene, stats: &BakedStats, size: u64) {
    let info = scene.info();
    let position = |p: [f32; 3]| format!("({}, {}, {})", p[0], p[1], p[2]);
    table
        .row(
            "file",
            format!("{}, {}", path.display(), output::bytes(size)),
        )
        .row("memory", output::bytes(stats.memory))
        .row("baked by", format!("version {}", info.version))
        .row("fingerprint", info.fingerprint.clone())
        .row("recipe", info.recipe.clone())
        .row("triangles", output::count(info.triangles))
        .row(
            "box",
            format!(
                "{} to {} m",
                position(info.bounds[0]),
                position(info.bounds[1])
            ),
        )
        .row(
            "viewpoints",
            match info.viewpoints.as_slice() {
                [] => "none".into(),
                [one] => position(*one),
                [one, ..] => format!("{}, the first is {}", info.viewpoints.len(), position(*one)),
            },
        )
        .row("rays", output::count(info.rays))
        .row("points", output::sum(&stats.points_per_level));
}

/// Adds senders, links, octree and bounces.
fn add_operator(table: &mut Table, scene: &BakedScene, stats: &BakedStats) {
    table
        .row(
            "senders",
            format!(
                "{} on {} of {} levels",
                output::count(stats.senders),
                scene.data().sender_levels,
                scene.levels()
            ),
        )
        .row("rows", output::count(stats.active_rows))
        .row(
            "links",
            format!(
                "{}, at most {} per row, as {}",
                output::count(stats.links),
                output::count(stats.longest_row),
                format!("{:?}", scene.data().operator.form).to_lowercase()
            ),
        )
        .row(
            "components",
            match stats.columns {
                0 => "none".into(),
                columns => format!(
                    "{} of {} clusters, {} values",
                    output::count(columns),
                    output::count(stats.clusters),
                    output::count(stats.column_values)
                ),
            },
        )
        .row(
            "octree",
            match &scene.data().fmm {
                None => "none".into(),
                Some(octree) => format!(
                    "order {}, {} samples in {} nodes, {} entries, {}",
                    octree.order,
                    output::count(stats.fmm_points),
                    output::count(stats.fmm_nodes),
                    output::count(stats.fmm_entries),
                    output::bytes(stats.fmm_bytes)
                ),
            },
        )
        .row(
            "illumination",
            match scene.data().illumination.is_empty() {
                true => "none".into(),
                false => format!(
                    "{} points",
                    output::count(scene.data().illumination.len() as u64)
                ),
            },
        )
        .row(
            "bounces",
            match stats.bounce_links {
                0 => format!("{}, in the frame", scene.info().bounces),
                links => format!(
                    "{}, baked: {} links",
                    scene.info().bounces,
                    output::count(links)
                ),
            },
        );
}

/// Adds the optional data of a recipe: probes, sky, materials, occluders and visibility.
fn add_optional_data(table: &mut Table, scene: &BakedScene, stats: &BakedStats) {
    table
        .row(
            "probes",
            match &scene.data().probes {
                None => "none: dynamic objects get the light of nearby surfaces".into(),
                Some(probes) => format!(
                    "{} probes, {} links, {} clip planes, {}",
                    output::count(stats.probes),
                    output::count(stats.probe_links),
                    output::count(probes.planes.len() as u64),
                    output::bytes(probes.bytes())
                ),
            },
        )
        .row(
            "sky",
            match stats.sky_terms {
                0 => "uniform".into(),
                terms => format!("varying, {terms} terms"),
            },
        )
        .row(
            "materials",
            match stats.materials {
                0 => "static".into(),
                count => format!(
                    "{count} dynamic, {} shares of senders",
                    output::count(stats.material_shares)
                ),
            },
        )
        .row(
            "occluders",
            match &scene.data().occluders {
                None => "none".into(),
                Some(o) => format!(
                    "{}, {} link terms cross them, {}",
                    o.names.join(", "),
                    output::count(stats.occluded_link_terms),
                    output::bytes(o.bytes())
                ),
            },
        )
        .row(
            "visibility",
            match &scene.data().visibility {
                None => "none: no soft shadows".into(),
                Some(v) => format!(
                    "{} × {} directions, {} clusters, {} coefficients ({:.0} %), {}",
                    v.grid.columns,
                    v.grid.rows,
                    output::count(stats.visibility_clusters),
                    output::count(stats.visibility_coefficients),
                    100.0 * v.kept(),
                    output::bytes(stats.visibility_bytes)
                ),
            },
        );
}

/// Adds the display's grid and the BVH of the shadow rays.
fn add_display(table: &mut Table, scene: &BakedScene, stats: &BakedStats) {
    table
        .row(
            "display",
            format!(
                "radius {} m, {} clip planes, {} cells, at most {} points per cell",
                scene.data().display.radius,
                output::count(stats.planes),
                output::count(stats.grid_cells),
                output::count(stats.longest_list)
            ),
        )
        .row(
            "shadow rays",
            format!(
                "{} triangles in {} nodes, depth {}",
                output::count(stats.bvh_triangles),
                output::count(stats.bvh_nodes),
                stats.bvh_depth
            ),
        );
}

/// Adds the estimated error and the energy checks.
fn add_errors(table: &mut Table, info: &BakeInfo) {
    table
        .row(
            "estimated error",
            output::error(
                f64::from(info.estimated_nrmse),
                f64::from(info.estimated_nrmse_interval),
            ),
        )
        .row(
            "link error",
            format!("{:.3} % of a row's largest link", 100.0 * info.link_error),
        )
        .row("uncovered", format!("{:.3} %", 100.0 * info.uncovered))
        .row("largest row sum", format!("{:.3}", info.largest_row_sum))
        .row("gain", output::gain(&info.energy))
        .row(
            "row sum error",
            format!(
                "at most {:.1e}, RMS {:.1e}",
                info.energy.row_deviation, info.energy.row_deviation_rms
            ),
        )
        .row(
            "not reciprocal",
            format!("{:.1} %", 100.0 * info.energy.reciprocity),
        );
}

/// Adds one row per tier.
fn add_tiers(table: &mut Table, scene: &BakedScene) {
    for (tier, number) in scene.info().tiers.iter().zip(1..) {
        table.row(
            if number == 1 { "tiers" } else { "" },
            format!(
                "{number}: {} rows, {} links, {}, {:.0} %, error {}",
                output::count(tier.rows),
                output::count(tier.links),
                output::bytes(tier.bytes()),
                100.0 * link_fraction(scene, tier, number),
                output::error(
                    f64::from(tier.estimated_nrmse),
                    f64::from(tier.estimated_nrmse_interval)
                ),
            ),
        );
    }
}

/// Adds one row per section that takes at least a thousandth of the file, large ones first.
fn add_sections(table: &mut Table, sections: &[SectionInfo], size: usize) {
    let mut large: Vec<_> = (sections.iter())
        .filter(|section| 1000 * section.bytes >= size as u64)
        .collect();
    large.sort_by_key(|section| std::cmp::Reverse(section.bytes));
    for (i, section) in large.into_iter().enumerate() {
        table.row(
            if i == 0 { "sections" } else { "" },
            format!(
                "{}: {}, {:.1} %",
                section.name,
                output::bytes(section.bytes),
                100.0 * section.bytes as f64 / size as f64
            ),
        );
    }
}

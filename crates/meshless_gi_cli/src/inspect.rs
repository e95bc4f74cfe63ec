//! `inspect`: what is in a bake, as a table or as JSON.

use super::error::ToolError;
use super::input;
use super::output::{self, Table};
use meshless_gi::internals::asset::BakedStats;
use meshless_gi::{AssetError, BakeInfo, BakedScene, TierInfo};
use serde_json::json;
use std::path::{Path, PathBuf};

#[derive(clap::Args)]
pub struct Args {
    /// The bake.
    bake: PathBuf,
    /// As JSON.
    #[arg(long)]
    json: bool,
}

pub fn run(args: &Args) -> Result<(), ToolError> {
    let failed = |why: AssetError| ToolError::asset(&args.bake, &why);
    let scene = input::bake(&args.bake)?;
    let stats = scene
        .validate()
        .map_err(|wrong| failed(AssetError::Invalid(wrong)))?;
    let size = std::fs::metadata(&args.bake)
        .map_err(|why| ToolError::read(&args.bake, &why))?
        .len();
    output::print(&if args.json {
        format!("{:#}\n", as_json(&scene, &stats, size))
    } else {
        as_table(&args.bake, &scene, &stats, size)
    })
}

fn as_json(scene: &BakedScene, stats: &BakedStats, size: u64) -> serde_json::Value {
    json!({
        "info": scene.info,
        "stats": stats,
        "bytes": size,
        "levels": scene.levels(),
        "sender_levels": scene.sender_levels,
        "points": scene.points.len(),
        "places_per_sender": scene.places.per_sender,
        "sender_form": format!("{:?}", scene.operator.form),
        "display_radius": scene.display.radius,
        "tiers": tiers(scene),
    })
}

/// One entry a tier, the one with the fewest links first.
fn tiers(scene: &BakedScene) -> serde_json::Value {
    (scene.info.tiers.iter().zip(1..))
        .map(|(tier, number)| {
            json!({
                "tier": number,
                "rows": tier.rows,
                "links": tier.links,
                "bytes": tier.bytes(),
                "share": share(scene, tier, number),
                "estimated_nrmse": tier.estimated_nrmse,
                "estimated_nrmse_interval": tier.estimated_nrmse_interval,
            })
        })
        .collect()
}

/// A tier's links as a share of all.
fn share(scene: &BakedScene, tier: &TierInfo, number: u32) -> f64 {
    // The octree has no links; it is all of what is above them.
    match number > scene.link_tiers() {
        true => 1.0,
        false => tier.links as f64 / scene.operator.links.len().max(1) as f64,
    }
}

fn as_table(path: &Path, scene: &BakedScene, stats: &BakedStats, size: u64) -> String {
    let info: &BakeInfo = &scene.info;
    let place = |p: [f32; 3]| format!("({}, {}, {})", p[0], p[1], p[2]);
    let mut table = Table::default();
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
            format!("{} to {} m", place(info.bounds[0]), place(info.bounds[1])),
        )
        .row(
            "viewpoints",
            match info.viewpoints.as_slice() {
                [] => "none".into(),
                [one] => place(*one),
                [one, ..] => format!("{}, the first {}", info.viewpoints.len(), place(*one)),
            },
        )
        .row("rays", output::count(info.rays))
        .row("points", output::sum(&stats.points_per_level))
        .row(
            "senders",
            format!(
                "{} on {} of {} levels",
                output::count(stats.senders),
                scene.sender_levels,
                scene.levels()
            ),
        )
        .row("rows", output::count(stats.active_rows))
        .row(
            "links",
            format!(
                "{}, at most {} a row, as {}",
                output::count(stats.links),
                output::count(stats.longest_row),
                format!("{:?}", scene.operator.form).to_lowercase()
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
            match &scene.fmm {
                None => "none".into(),
                Some(octree) => format!(
                    "order {}, {} places in {} nodes, {} entries, {}",
                    octree.order,
                    output::count(stats.fmm_places),
                    output::count(stats.fmm_nodes),
                    output::count(stats.fmm_entries),
                    output::bytes(stats.fmm_bytes)
                ),
            },
        )
        .row(
            "illumination",
            match scene.illumination.is_empty() {
                true => "none".into(),
                false => format!("{} points", output::count(scene.illumination.len() as u64)),
            },
        )
        .row(
            "bounces",
            match stats.bounce_links {
                0 => format!("{}, in the frame", info.bounces),
                links => format!("{}, baked: {} links", info.bounces, output::count(links)),
            },
        )
        .row(
            "free space",
            match &scene.probes {
                None => "none: what moves takes what its place on the level gets".into(),
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
                terms => format!("may vary: {terms} terms"),
            },
        )
        .row(
            "materials",
            match stats.materials {
                0 => "as baked".into(),
                count => format!(
                    "{count} may change, {} shares of senders",
                    output::count(stats.material_shares)
                ),
            },
        )
        .row(
            "occluders",
            match &scene.occluders {
                None => "none".into(),
                Some(o) => format!(
                    "{}, {} parts of links pass them, {}",
                    o.names.join(", "),
                    output::count(stats.passages),
                    output::bytes(o.bytes())
                ),
            },
        )
        .row(
            "visibility",
            match &scene.visibility {
                None => "none: lights cast no soft shadows".into(),
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
        )
        .row(
            "display",
            format!(
                "radius {} m, {} clip planes, {} cells, at most {} points a cell",
                scene.display.radius,
                output::count(stats.planes),
                output::count(stats.grid_cells),
                output::count(stats.longest_list)
            ),
        )
        .row(
            "shadow rays",
            format!(
                "{} triangles in {} nodes, {} deep",
                output::count(stats.bvh_triangles),
                output::count(stats.bvh_nodes),
                stats.bvh_depth
            ),
        )
        .row(
            "estimated error",
            output::error(
                f64::from(info.estimated_nrmse),
                f64::from(info.estimated_nrmse_interval),
            ),
        )
        .row(
            "link error",
            format!("{:.3} % of a row's largest", 100.0 * info.link_error),
        )
        .row("uncovered", format!("{:.3} %", 100.0 * info.uncovered))
        .row("largest row sum", format!("{:.3}", info.largest_row_sum))
        .row("gain", output::gain(&info.energy))
        .row(
            "rows off one",
            format!(
                "{:.1e} at most, {:.1e} rms",
                info.energy.row_deviation, info.energy.row_deviation_rms
            ),
        )
        .row(
            "not reciprocal",
            format!("{:.1} %", 100.0 * info.energy.reciprocity),
        );
    for (tier, number) in info.tiers.iter().zip(1..) {
        table.row(
            if number == 1 { "tiers" } else { "" },
            format!(
                "{number}: {} rows, {} links, {}, {:.0} %, error {}",
                output::count(tier.rows),
                output::count(tier.links),
                output::bytes(tier.bytes()),
                100.0 * share(scene, tier, number),
                output::error(
                    f64::from(tier.estimated_nrmse),
                    f64::from(tier.estimated_nrmse_interval)
                ),
            ),
        );
    }
    table.text()
}

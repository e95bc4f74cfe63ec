//! Fourth stage: packed rows, and the scene that a frame reads.

use super::context::BakeContext;
use super::staleness::{fingerprint_of, hex};
use super::survey::Survey;
use super::transport_stage::Transport;
use super::{
    BAKE_VERSION, BakeError, BakeStage, BakeStats, SkyModel, canonical_recipe, materials,
    occluders, sky,
};
use crate::asset::{
    BakeInfo, EnergyInfo, FlatBasis, PointSurface, SceneData, SkyVisibility, TierInfo,
};
use crate::transport::pca::Compression;
use crate::transport::{PackSettings, RawRow, assign_tiers, pack};
use glam::Vec3;

/// Result of the stage: a scene with one bounce of light, and data for the measurements of later
/// stages.
pub(super) struct Assembled {
    pub scene: SceneData,
    /// Rows of all points in full precision.
    pub rows: Vec<RawRow>,
    /// Fraction of each point's hemisphere that has no sender.
    pub missed: Vec<f32>,
    /// Normals of the coarsest points.
    pub coarse_normals: Vec<Vec3>,
}

/// Packs the rows and assembles the scene.
pub(super) fn assemble(
    context: &BakeContext<'_>,
    survey: &Survey,
    transport: Transport,
    stats: &mut BakeStats,
) -> Result<Assembled, BakeError> {
    context.report(BakeStage::Packing, 0.0)?;
    let source = context.source;
    let settings = &survey.settings;
    count(&transport, settings.sender_levels as usize, stats);
    let surfaces = sender_surfaces(&transport, settings.sender_levels as usize);
    let Transport {
        points,
        mut refined,
        compression,
        probes,
        flat,
        precision,
        ..
    } = transport;
    let hierarchy = points.hierarchy;
    let senders = hierarchy.level_starts[settings.sender_levels as usize] as usize;
    let form = survey.method.form();
    let tiers = assign_tiers(
        &refined.rows,
        &hierarchy.level_starts,
        &points.parents,
        form,
    );
    let columns = compression
        .as_ref()
        .map_or(senders, Compression::components);
    let (sky_terms, rays) = sky::terms(
        source.geometry,
        &hierarchy,
        &mut refined.rows,
        columns,
        settings,
    );
    stats.rays += refined.rays + rays;
    let pack_settings = PackSettings {
        form,
        senders: columns,
        points: &flat.points,
        link_step: settings.link_step,
        precision: &precision,
    };
    let (rows, sky) = (&refined.rows, &refined.sky);
    let mut packed = pack(rows, &tiers, sky, &sky_terms, &pack_settings);
    packed.operator.compression = compression;
    let (materials, rays) = match settings.dynamic_materials {
        true => materials::cover(
            source.geometry,
            &hierarchy,
            &points.light_samples,
            &points.pull,
        ),
        false => (None, 0),
    };
    stats.rays += rays;
    stats.links = packed.operator.links.len() as u64;
    stats.link_error = f64::from(packed.error);
    let (probes, probe_terms) = probes.map_or((None, Vec::new()), |baked| {
        (Some(baked.probes), baked.occluded)
    });
    let mut scene = SceneData {
        surfaces,
        sender_levels: settings.sender_levels,
        light_samples: points.light_samples,
        pull: points.pull,
        parents: points.parents,
        operator: packed.operator,
        fmm: None,
        illumination: Vec::new(),
        materials,
        sky: (settings.sky == SkyModel::Harmonics).then(|| SkyVisibility {
            senders: (sky_terms.iter().zip(&hierarchy.surfaces))
                .take(senders)
                .map(|(terms, s)| terms.map(|t| t.dot(s.normal)))
                .collect(),
        }),
        bounces: None,
        visibility: None,
        probes,
        occluders: occluders::index_terms(&source.occluders, &packed.link_terms, &probe_terms)?,
        display: FlatBasis {
            radius: flat.radius(),
            planes: flat.planes,
            grid: flat.grid,
        },
        points: flat.points,
        bvh: source.bvh.clone(),
        info: bake_info(context, survey, stats),
        level_starts: hierarchy.level_starts,
    };
    scene.info.tiers = TierInfo::from_scene(&scene);
    let coarsest = &hierarchy.surfaces[scene.level(0)];
    Ok(Assembled {
        coarse_normals: coarsest.iter().map(|s| s.normal).collect(),
        scene,
        rows: refined.rows,
        missed: refined.missed,
    })
}

/// Writes the numbers of points, rows and rays to `stats`.
fn count(transport: &Transport, sender_levels: usize, stats: &mut BakeStats) {
    let refined = &transport.refined;
    let hierarchy = &transport.points.hierarchy;
    let senders = hierarchy.level_starts[sender_levels];
    stats.gather_rays = refined.rays;
    stats.gathered = refined.gathered;
    stats.senders = u64::from(senders);
    let level_sizes = hierarchy.level_starts.windows(2);
    stats.points_per_level = level_sizes.map(|w| u64::from(w[1] - w[0])).collect();
    stats.truncated_levels = hierarchy.truncated.iter().map(|&l| l as u64).collect();
    stats.active_rows = refined.rows.iter().filter(|r| r.active).count() as u64;
    stats.uncovered = refined.uncovered;
    stats.largest_row_sum = f64::from(refined.largest_row_sum);
    stats.clip_planes = transport.flat.planes.len() as u64;
}

/// Computes the surfaces of all points. Coarse senders get the mean albedo of their part of the
/// surface, not the albedo at their own point.
fn sender_surfaces(transport: &Transport, sender_levels: usize) -> Vec<PointSurface> {
    let hierarchy = &transport.points.hierarchy;
    let mut surfaces: Vec<PointSurface> = hierarchy
        .surfaces
        .iter()
        .zip(&transport.refined.sky)
        .map(|(s, sky)| PointSurface {
            albedo: s.albedo.to_array(),
            emission: s.emission.to_array(),
            sky: sky.to_array(),
            ..PointSurface::default()
        })
        .collect();
    for level in (0..sender_levels).rev() {
        for k in hierarchy.level(level) {
            let row = transport.points.pull.row(k);
            if !row.is_empty() {
                let mean: Vec3 = row
                    .iter()
                    .map(|w| w.weight * Vec3::from_array(surfaces[w.index as usize].albedo))
                    .sum();
                surfaces[k].albedo = mean.min(Vec3::ONE).to_array();
            }
        }
    }
    surfaces
}

/// Creates the description of the bake. Later stages fill in energy, tiers and errors.
fn bake_info(context: &BakeContext<'_>, survey: &Survey, stats: &BakeStats) -> BakeInfo {
    let (source, recipe) = (context.source, context.recipe);
    let bounds = source.geometry.bounds();
    let settings = survey.settings.to_ron();
    BakeInfo {
        version: env!("CARGO_PKG_VERSION").into(),
        bake_version: BAKE_VERSION,
        fingerprint: fingerprint_of(&source.content_hash, &settings, &recipe.viewpoints),
        content_hash: hex(&source.content_hash),
        scene: recipe.scene.clone(),
        scene_digest: String::new(),
        given_recipe: canonical_recipe(recipe),
        recipe: settings,
        triangles: source.primitives,
        rays: stats.rays,
        bounces: survey.settings.bounces,
        bounds: [bounds.min.to_array(), bounds.max.to_array()],
        viewpoints: survey.viewpoints.iter().map(|v| v.to_array()).collect(),
        estimated_nrmse: 0.0,
        estimated_nrmse_interval: 0.0,
        tiers: Vec::new(),
        link_error: stats.link_error as f32,
        uncovered: stats.uncovered as f32,
        largest_row_sum: stats.largest_row_sum as f32,
        energy: EnergyInfo::default(),
        request: String::new(),
    }
}

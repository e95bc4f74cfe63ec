//! Fourth stage: octree of method `fmm` ([G08]).
//!
//! **Sources** are the senders of the finest sender level. Each emits from several pieces of its
//! cell ([`find_cells`]), so that a close wall is a wall and not a few disks. [G08] has one
//! position per point.
//!
//! **Receivers** are the points of the sender levels. Points of finer levels take the mean of their
//! parents. Evaluating expansions at them costs more, and no measurement was more exact, since
//! visibility is constant over a leaf.
//!
//! **Closed form.** Uniform radiosity of one gives irradiance one at every point, except for the
//! sky and unlit back sides: (1/π) ∫ n·ω dω = 1. A factor per point corrects the errors of close
//! disks, areas and partial visibility.

use super::context::{BakeContext, StageCost};
use super::link_method::LinkMethod;
use super::survey::Survey;
use super::transport_stage::Transport;
use super::{BakeError, BakeStage, FmmRecipe};
use crate::basis::{CellPart, find_cells};
use crate::samples::Point;
use crate::transport::fmm::passes::{Field, component_along};
use crate::transport::fmm::{Fmm, FmmOperator, FmmPoint, FmmSettings, Passes};
use crate::transport::{ReceiverRays, gather_sky_visibility};
use glam::Vec3;
use rayon::prelude::*;
use std::time::Instant;

impl FmmRecipe {
    /// Returns the settings of the solver.
    fn solver(&self, seed: u64) -> FmmSettings {
        FmmSettings {
            order: self.order as usize,
            leaf: self.leaf_size as usize,
            rays: self.visibility_rays,
            seed,
            ..FmmSettings::default()
        }
    }
}

/// Range of the correction factor. Factors outside of it are not rounding errors: such a point
/// receives light that no list has, or lies in a crack.
const FACTOR_RANGE: [f32; 2] = [0.25, 4.0];

/// Result of the stage.
pub(super) struct Octree {
    pub operator: FmmOperator,
    /// Sky visibility of all points. `None` with fallback links, which have their own.
    pub sky: Option<Vec<Vec3>>,
    /// Area of each sender in m². 0 for senders that do not emit.
    pub areas: Vec<f32>,
    /// Largest and root-mean-square deviation of the senders' irradiance from one, under uniform
    /// light and a uniform sky.
    pub deviation: [f32; 2],
}

/// Builds the octree of method `fmm`. Other methods have none.
pub(super) fn build_octree(
    context: &BakeContext<'_>,
    survey: &Survey,
    transport: &Transport,
) -> Result<(Option<Octree>, StageCost), BakeError> {
    let LinkMethod::Octree(recipe) = survey.method else {
        return Ok(Default::default());
    };
    let began = Instant::now();
    context.report(BakeStage::Packing, 0.0)?;
    let (geometry, settings) = (context.source.geometry, &survey.settings);
    let (hierarchy, points) = (&transport.points.hierarchy, &transport.flat.points);
    let finest = settings.sender_levels as usize - 1;
    let level = &hierarchy.senders[finest];
    let (cells, cell_rays) = find_cells(geometry, level, recipe.samples_per_sender, settings.seed);
    let rays = (settings.rays_per_point / 4).max(16);
    let (gathered, unlit): (Vec<Vec3>, Vec<f32>) = (points.par_iter().enumerate())
        .map(|(i, p)| {
            let at = (p.x(), p.n());
            let rays = ReceiverRays::at_center(geometry, at, i, rays, settings.seed);
            gather_sky_visibility(geometry, &rays)
        })
        .unzip();
    // Links have their own gathered sky visibility. Sweeps over them subtract it.
    let sky = (!recipe.fallback_links).then_some(gathered);
    let emitters = hierarchy.level(finest);
    let senders = &points[..emitters.end];
    let (points, of) = octree_points(&cells, emitters.start, senders);
    let fmm = Fmm::new(&points, &recipe.solver(settings.seed), Some(geometry))
        .map_err(|error| BakeError::Octree(Box::new(error)))?;
    let mut operator = fmm.operator(|at| of[at as usize]);
    let visible_sky = sky.as_ref().unwrap_or(&transport.rows.sky);
    for point in operator.points.iter_mut().filter(|p| p.share == 0.0) {
        point.sky = visible_sky[point.point as usize].to_array();
    }
    normalize_to_closed_form(&mut operator, senders.len(), &unlit);
    let deviation = deviation(&operator, senders, visible_sky, &unlit);
    let own = cells.iter().map(|cell| cell.iter().map(|p| p.area).sum());
    let octree = Octree {
        sky,
        areas: std::iter::repeat_n(0.0, emitters.start)
            .chain(own)
            .collect(),
        deviation,
        operator,
    };
    let sky_rays = unlit.len() as u64 * u64::from(rays);
    let cost = StageCost::new(began, cell_rays + sky_rays + fmm.lists().counts.rays);
    Ok((Some(octree), cost))
}

/// Returns the points of the octree, and the sender of each: pieces of the emitting senders from
/// `first`, then the points of all senders.
fn octree_points(
    cells: &[Vec<CellPart>],
    first: usize,
    senders: &[Point],
) -> (Vec<FmmPoint>, Vec<u32>) {
    let pieces = (cells.iter().zip(first..)).flat_map(|(cell, j)| {
        cell.iter().map(move |part| {
            let point = FmmPoint {
                position: part.position,
                normal: part.normal,
                weight: part.area,
                receives: false,
            };
            (point, j as u32)
        })
    });
    let receivers = senders.iter().zip(0..).map(|(p, i)| {
        let point = FmmPoint {
            position: p.x(),
            normal: p.n(),
            weight: 0.0,
            receives: true,
        };
        (point, i)
    });
    pieces.chain(receivers).unzip()
}

/// Sets the correction factor of every receiver.
fn normalize_to_closed_form(operator: &mut FmmOperator, senders: usize, unlit: &[f32]) {
    let unit = unit_response(operator, senders);
    for point in operator.points.iter_mut().filter(|p| p.share == 0.0) {
        let i = point.point as usize;
        let sky = Vec3::from_array(point.sky).dot(Vec3::from_array(point.normal));
        let right = 1.0 - sky.max(0.0) - unlit[i];
        let factor = right / unit[i];
        point.factor = match (FACTOR_RANGE[0]..=FACTOR_RANGE[1]).contains(&factor) {
            true => factor,
            false => 1.0,
        };
    }
}

/// Computes the irradiance of the senders along their normals for radiosity one.
fn unit_response(operator: &FmmOperator, senders: usize) -> Vec<f32> {
    let radiosity = vec![[1.0f32; 4]; senders];
    let mut passes = Passes::new(Field::from_operator(operator));
    passes.run(&radiosity);
    let mut out = vec![0.0; senders];
    for node in operator.nodes.iter().filter(|n| n.is_leaf()) {
        for i in node.receiver_range() {
            let point = &operator.points[i];
            let e = component_along(point.normal, &passes.values[i])[0];
            out[point.point as usize] = point.factor * e;
        }
    }
    out
}

/// Computes [`Octree::deviation`].
fn deviation(operator: &FmmOperator, senders: &[Point], sky: &[Vec3], unlit: &[f32]) -> [f32; 2] {
    let (mut largest, mut squares) = (0.0f64, 0.0);
    let even = unit_response(operator, senders.len());
    for (i, (e, point)) in even.iter().zip(senders).enumerate() {
        let sky = sky[i].dot(point.n());
        let d = f64::from(e + sky.max(0.0) + unlit[i]) - 1.0;
        largest = largest.max(d.abs());
        squares += d * d;
    }
    let rms = (squares / even.len().max(1) as f64).sqrt();
    [largest as f32, rms as f32]
}

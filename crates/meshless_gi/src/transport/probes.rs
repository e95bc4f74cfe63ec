//! Rows of probes: spherical harmonics up to degree 2 of the incident radiance at a position, as a
//! linear function of the senders' radiosity. Probes use the operator's senders. Their rows are
//! gathered after the operator's rows.
//!
//! A surface with normal n at the probe has the irradiance E(n) = ∫ L(ω) max(0, n·ω) dω. The
//! convolution theorem of \[RH01\] (Eqs. (7)-(9)) gives E(n) = c + d·n + n·Q n. The cosine has the
//! factors π, 2π/3 and π/4 for the degrees 0, 1 and 2, which have 99 % of its energy. The
//! coefficients are
//!
//! - c = (1/4) ∫ L dω, d = (1/2) ∫ L ω dω, Q = (15/32) ∫ L (ω ωᵀ − I/3) dω. Q is symmetric and has
//!   trace zero, so a probe has nine coefficients.
//!
//! With the radiosity b = π L, a link has (1/π) times these integrals over the sender's function,
//! like links of surfaces (design D1). The nine coefficients form three vectors. A probe therefore
//! has three ordinary rows: d, then (c, Q_xx, Q_yy), then (Q_xy, Q_xz, Q_yz). The kernel `apply`
//! needs no change.
//!
//! The three rows are truncated together as in [`super::bounded_truncation`], by the effect on c.

use super::bounded_truncation::{CutMeasure, CutScratch, cut_row};
use super::gather::{GatherScene, Gathered};
use super::occluded_links::{LinkTerm, merge_parts};
use super::{RawRow, SenderTree, Training};
use crate::basis::{GatherHit, WeightEntry};
use crate::samples::{Random, lattice, uniform_sphere};
use crate::scene::{Ray, SkyRadiance};
use glam::{Vec2, Vec3, Vec3A};
use rayon::prelude::*;

/// Number of rows per probe.
pub const PROBE_ROWS: usize = 3;

/// Rows of all probes.
#[derive(Debug, Default)]
pub struct ProbeGather {
    /// [`PROBE_ROWS`] rows per probe.
    pub rows: Vec<RawRow>,
    /// Sky coefficients of each row, from the directions without a hit.
    pub sky: Vec<Vec3>,
    /// Coefficients of the terms of a sky that is not uniform. Empty for a uniform sky.
    pub terms: Vec<[Vec3; SkyRadiance::TERMS]>,
    /// Mean part of the directions that hit a surface without a sender, or a back side.
    pub lost: f64,
    /// Number of rays cast.
    pub rays: u64,
}

/// Computes the nine coefficients of a direction with weight 1/N. They integrate to (1/π) times c,
/// d and Q of a radiosity of one.
fn harmonics(way: Vec3, weight: f32) -> [Vec3A; PROBE_ROWS] {
    let square = way * way - 1.0 / 3.0;
    let q = 1.875 * weight;
    [
        Vec3A::from(way) * (2.0 * weight),
        Vec3A::new(weight, q * square.x, q * square.y),
        Vec3A::new(way.x * way.y, way.x * way.z, way.y * way.z) * q,
    ]
}

/// Gathers and truncates the rows of the probes at `positions`, with the terms of a sky that is not
/// uniform if `sky_terms`. `on_progress` receives the completed part and returns `false` to cancel.
/// Returns `None` if canceled. The result does not depend on the number of threads.
pub fn probe_rows(
    scene: &GatherScene<'_>,
    positions: &[Vec3],
    tree: &SenderTree,
    training: &Training,
    epsilon: f32,
    sky_terms: bool,
    on_progress: &(dyn Fn(f32) -> bool + Sync),
) -> Option<ProbeGather> {
    let senders = tree.parent.len();
    let measure = CutMeasure { training, epsilon };
    let mut out = ProbeGather::default();
    let mut lost = 0.0;
    const BATCH_SIZE: usize = 256;
    for (chunk, some) in positions.chunks(BATCH_SIZE).enumerate() {
        let found: Vec<Probe> = some
            .par_iter()
            .enumerate()
            .map_init(
                || ProbeScratch::new(senders),
                |scratch, (k, &x)| one(scene, chunk * BATCH_SIZE + k, x, tree, &measure, scratch),
            )
            .collect();
        for mut probe in found {
            if !sky_terms {
                // Removes the parts of the sky's terms, since rows have no links to them.
                let rows = probe.rows.iter_mut();
                rows.for_each(|row| row.parts.retain(|p| p.sender as usize <= senders));
            }
            out.rows.extend(probe.rows);
            out.sky.extend(probe.sky.map(Vec3::from));
            if sky_terms {
                out.terms.extend(probe.terms.map(|row| row.map(Vec3::from)));
            }
            lost += f64::from(probe.lost);
        }
        out.rays += some.len() as u64 * u64::from(scene.rays);
        if !on_progress((chunk * BATCH_SIZE + some.len()) as f32 / positions.len() as f32) {
            return None;
        }
    }
    out.lost = lost / positions.len().max(1) as f64;
    Some(out)
}

struct Probe {
    rows: [RawRow; PROBE_ROWS],
    sky: [Vec3A; PROBE_ROWS],
    terms: [[Vec3A; SkyRadiance::TERMS]; PROBE_ROWS],
    lost: f32,
}

/// Scratch memory of one thread.
struct ProbeScratch {
    gathered: Gathered,
    cut: CutScratch,
    found: Vec<WeightEntry>,
    /// Sender, weight, direction and crossed occluders of each deposit.
    deposits: Vec<(u32, f32, Vec3, u64)>,
    /// Index of each sender's link in the row.
    slot: Vec<u32>,
}

const NONE: u32 = u32::MAX;

impl ProbeScratch {
    fn new(senders: usize) -> Self {
        Self {
            gathered: Gathered::new(senders),
            cut: CutScratch::default(),
            found: Vec::new(),
            deposits: Vec::new(),
            slot: vec![NONE; senders],
        }
    }
}

fn one(
    scene: &GatherScene<'_>,
    i: usize,
    x: Vec3,
    tree: &SenderTree,
    measure: &CutMeasure<'_>,
    scratch: &mut ProbeScratch,
) -> Probe {
    let mut random = Random::new(scene.seed, 0x7072_6f62, i as u64);
    let shift = Vec2::new(random.unit(), random.unit());
    let weight = 1.0 / scene.rays as f32;
    let mut out = Probe {
        rows: Default::default(),
        sky: [Vec3A::ZERO; PROBE_ROWS],
        terms: [[Vec3A::ZERO; SkyRadiance::TERMS]; PROBE_ROWS],
        lost: 0.0,
    };
    scratch.gathered.reset();
    scratch.deposits.clear();
    let emitters = scene.hierarchy.separate_emitters(scene.geometry);
    for k in 0..scene.rays {
        let way = uniform_sphere(lattice(k, scene.rays, shift)).normalize_or(Vec3::Y);
        let ray = Ray::new(x, way);
        let Some(hit) = scene.geometry.cast(&ray) else {
            let parts = harmonics(way, weight);
            out.sky.iter_mut().zip(parts).for_each(|(s, p)| *s += p);
            for (row, part) in out.terms.iter_mut().zip(parts) {
                let terms = row.iter_mut().zip(SkyRadiance::polynomials(way));
                terms.for_each(|(t, p)| *t += part * p);
            }
            let crossed = scene.geometry.crossed_occluders(&ray);
            if crossed != 0 {
                // The sky and its terms.
                let factors = [1.0].into_iter().chain(SkyRadiance::polynomials(way));
                for (sender, p) in (tree.parent.len() as u32..).zip(factors) {
                    add_occluded_terms(&mut out.rows, sender, crossed, &parts.map(|part| part * p));
                }
            }
            continue;
        };
        let site = scene.geometry.hit_point(&ray, &hit);
        let is_emitter = emitters.is_some_and(|e| e.contains(hit.primitive));
        let grid = &scene.hierarchy.senders[scene.sender_levels - 1].grid;
        if !scene.hierarchy.hit_senders(
            scene.geometry,
            scene.sender_levels,
            grid.indices_near(site.position),
            &GatherHit {
                position: site.position,
                normal: site.normal,
                distance: hit.t,
                is_emitter,
                is_lit: site.lit,
            },
            &mut scratch.found,
        ) {
            out.lost += weight;
            continue;
        }
        let crossed = scene
            .geometry
            .crossed_occluders(&Ray::segment(x, way, hit.t));
        for entry in &scratch.found {
            let (j, w) = (entry.index, entry.weight * weight);
            // Truncation uses each sender's contribution to c.
            scratch.gathered.deposit(j, (k & 1) as usize, Vec3A::Z * w);
            scratch.deposits.push((j, w, way, crossed));
        }
    }
    let cut = cut_row(
        &mut scratch.gathered,
        tree,
        Vec3A::Z,
        measure,
        &mut scratch.cut,
    );
    for (at, &(j, _)) in cut.iter().enumerate() {
        scratch.slot[j as usize] = at as u32;
    }
    let mut links = vec![[Vec3A::ZERO; PROBE_ROWS]; cut.len()];
    for &(j, w, way, crossed) in &scratch.deposits {
        // Moved mass belongs to the nearest kept ancestor.
        let mut k = j;
        while scratch.slot[k as usize] == NONE && tree.parent[k as usize] != k {
            k = tree.parent[k as usize];
        }
        if let Some(link) = links.get_mut(scratch.slot[k as usize] as usize) {
            let parts = harmonics(way, w);
            link.iter_mut().zip(parts).for_each(|(s, p)| *s += p);
            if crossed != 0 {
                add_occluded_terms(&mut out.rows, k, crossed, &parts);
            }
        }
    }
    for (&(j, _), link) in cut.iter().zip(&links) {
        scratch.slot[j as usize] = NONE;
        for (row, part) in out.rows.iter_mut().zip(link) {
            row.active = true;
            row.links.push((j, *part));
        }
    }
    for row in &mut out.rows {
        row.active = true;
        merge_parts(&mut row.parts);
    }
    out
}

/// Adds the terms of a probe's links to `sender` that cross occluders.
fn add_occluded_terms(
    rows: &mut [RawRow; PROBE_ROWS],
    sender: u32,
    crossed: u64,
    values: &[Vec3A; PROBE_ROWS],
) {
    for (row, &value) in rows.iter_mut().zip(values) {
        row.parts.push(LinkTerm {
            sender,
            crossed,
            value,
        });
    }
}

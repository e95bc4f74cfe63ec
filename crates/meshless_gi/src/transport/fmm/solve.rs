//! The solver. It builds tree and lists once ([`Fmm::new`]). Afterwards it runs any number of
//! passes for any radiosity ([`Fmm::irradiance`]), or bounces until convergence ([`Fmm::solve`]).
//!
//! \[G08\] §3.1.6 runs everything three times, once per color, and iterates three times. Here the
//! colors are computed together and a tolerance ends the iteration. Results are bit-identical for
//! any number of threads (design D5): one thread computes a node, and sums have the order of the
//! lists.

use super::expansion::Expansions;
use super::lists::{Lists, lists};
use super::operator::FmmOperator;
use super::passes::{Field, component_along};
use super::settings::{FmmError, FmmPoint, FmmSettings, check_points};
use super::threads::{PassTimes, Passes};
use super::tree::{Tree, TreePoint};
use super::visibility::Visibility;
use crate::scene::Geometry;
use glam::Vec3;
use std::time::{Duration, Instant};

/// Solution of B = ρE + M.
#[derive(Clone, Debug, PartialEq)]
pub struct FmmSolution {
    /// Irradiance at every point from the radiosity of the others, W/m².
    pub irradiance: Vec<Vec3>,
    /// Radiosity of every point, W/m².
    pub radiosity: Vec<Vec3>,
    /// Number of computed bounces.
    pub bounces: u32,
    /// Power of the last bounce (radiosity times surface area, all colors) over that of all
    /// bounces. 1 without a bounce, 0 if all radiosities are zero.
    pub change: f32,
    /// Times of all bounces together.
    pub times: PassTimes,
}

/// Points, their octree and their lists.
#[derive(Clone, Debug)]
pub struct Fmm {
    tree: Tree,
    lists: Lists,
    expansions: Expansions,
    settings: FmmSettings,
    points: usize,
    /// Build times of tree and lists.
    pub build: [Duration; 2],
}

impl Fmm {
    /// Builds the tree and the lists. With a geometry, occluded points exchange no light.
    ///
    /// # Errors
    /// Error if a setting is out of its range, or a value of a point is not physical.
    pub fn new(
        points: &[FmmPoint],
        settings: &FmmSettings,
        geometry: Option<&dyn Geometry>,
    ) -> Result<Self, FmmError> {
        settings.check()?;
        check_points(points)?;
        let start = Instant::now();
        let tree = Tree::new(points, settings.leaf);
        let tree_time = start.elapsed();
        let visibility = geometry.map(|geometry| Visibility {
            geometry,
            points,
            rays: settings.rays,
            seed: settings.seed,
        });
        let start = Instant::now();
        let lists = lists(&tree, settings, visibility)?;
        Ok(Self {
            tree,
            lists,
            expansions: Expansions::new(settings.order),
            settings: *settings,
            points: points.len(),
            build: [tree_time, start.elapsed()],
        })
    }

    /// Returns the octree.
    #[must_use]
    pub fn tree(&self) -> &Tree {
        &self.tree
    }

    /// Returns the lists.
    #[must_use]
    pub fn lists(&self) -> &Lists {
        &self.lists
    }

    /// Returns the tables of the order.
    #[must_use]
    pub fn expansions(&self) -> &Expansions {
        &self.expansions
    }

    /// Creates the arrays that a bake stores. `point` maps a point of the input to the baked point
    /// that sends and receives for it.
    #[must_use]
    pub fn operator(&self, point: impl Fn(u32) -> u32) -> FmmOperator {
        let FmmSettings { order, disks, .. } = self.settings;
        FmmOperator::new(&self.tree, &self.lists, order, disks, point)
    }

    /// Returns the settings of the solver.
    #[must_use]
    pub fn settings(&self) -> &FmmSettings {
        &self.settings
    }

    fn check(&self, what: &'static str, values: &[Vec3], max: f32) -> Result<(), FmmError> {
        if values.len() != self.points {
            return Err(FmmError::Count {
                what,
                have: values.len(),
                points: self.points,
            });
        }
        for (index, v) in values.iter().enumerate() {
            let bad = v.to_array().into_iter().find(|c| !(0.0..=max).contains(c));
            if let Some(value) = bad {
                let right = "out of its range";
                return Err(FmmError::Point {
                    index,
                    what,
                    value,
                    right,
                });
            }
        }
        Ok(())
    }

    /// Computes the irradiance at every point from this radiosity (both W/m², in the order of the
    /// points). Also returns the elapsed time.
    ///
    /// # Errors
    /// Error if there is not one radiosity per point, or one is negative or not finite.
    pub fn irradiance(&self, radiosity: &[Vec3]) -> Result<(Vec<Vec3>, PassTimes), FmmError> {
        self.check("radiosity", radiosity, f32::MAX)?;
        let field = Field::<f64>::new(
            &self.tree,
            &self.lists,
            &self.expansions,
            self.settings.disks,
        );
        let mut passes = Passes::new(field);
        Ok(self.through(&mut passes, radiosity))
    }

    fn through(&self, passes: &mut Passes<'_, f64>, radiosity: &[Vec3]) -> (Vec<Vec3>, PassTimes) {
        let wide = |b: &Vec3| b.as_dvec3().extend(0.0).to_array();
        let radiosity: Vec<_> = radiosity.iter().map(wide).collect();
        let times = passes.run(&radiosity);
        let mut out = vec![Vec3::ZERO; self.points];
        for (f, p) in passes.values.iter().zip(&passes.field.points) {
            let (e, max) = (component_along(p.normal, f), f64::from(f32::MAX));
            out[p.point as usize] = Vec3::from_array([0, 1, 2].map(|c| e[c].min(max) as f32));
        }
        (out, times)
    }

    /// Bounces light until the power of the last bounce is at most `tolerance` of that of all
    /// bounces, or `bounces` are computed. B = M + ρ E(B) is the sum of its Neumann series.
    /// `emission` is M, W/m², and includes the directly reflected light of light sources. `albedo`
    /// is ρ in \[0, 1\].
    ///
    /// # Errors
    /// Error if there is not one value of each per point, or one is out of its range.
    pub fn solve(
        &self,
        albedo: &[Vec3],
        emission: &[Vec3],
        bounces: u32,
        tolerance: f32,
    ) -> Result<FmmSolution, FmmError> {
        self.check("albedo", albedo, 1.0)?;
        self.check("emission", emission, f32::MAX)?;
        let field = Field::<f64>::new(
            &self.tree,
            &self.lists,
            &self.expansions,
            self.settings.disks,
        );
        let mut passes = Passes::new(field);
        let power = |values: &[Vec3]| -> f64 {
            let of = |p: &TreePoint, i: u32| p.weight * values[i as usize].as_dvec3().element_sum();
            let pairs = self.tree.points.iter().zip(&self.tree.order);
            pairs.map(|(p, &i)| of(p, i)).sum()
        };
        let mut reflected = 0.0;
        let finite = |v: Vec3| v.min(Vec3::splat(f32::MAX));
        let mut solution = FmmSolution {
            irradiance: vec![Vec3::ZERO; self.points],
            radiosity: emission.to_vec(),
            bounces: 0,
            change: if power(emission) > 0.0 { 1.0 } else { 0.0 },
            times: PassTimes::default(),
        };
        let mut last = emission.to_vec();
        while solution.bounces < bounces && solution.change > tolerance {
            let (irradiance, times) = self.through(&mut passes, &last);
            solution.times.up += times.up;
            solution.times.down += times.down;
            solution.bounces += 1;
            for i in 0..self.points {
                last[i] = albedo[i] * irradiance[i];
                solution.irradiance[i] = finite(solution.irradiance[i] + irradiance[i]);
                solution.radiosity[i] = finite(solution.radiosity[i] + last[i]);
            }
            let added = power(&last);
            reflected += added;
            solution.change = if added > 0.0 {
                (added / reflected) as f32
            } else {
                0.0
            };
        }
        Ok(solution)
    }
}

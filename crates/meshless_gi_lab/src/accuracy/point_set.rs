//! Bases of [V11]'s experiment over Poisson-disk points on the sphere and the disk. They are the
//! paper's own, and this project's as the bake and the frame have them.

use super::sphere_over_disk::SphereOverDisk;
use super::{
    GaussianBasis, MultilevelBasis, PointBasis, PointBasisError, PointSample, ShepardBasis,
    SurfaceField, check_samples,
};
use glam::Vec3;
use meshless_gi::internals::asset::FlatBasis;
use meshless_gi::internals::basis::{Hierarchy, HierarchySettings, LevelBasis};
use meshless_gi::internals::frame::VectorIrradiance;
use meshless_gi::internals::frame::splat::{splat, splat_vector};
use meshless_gi::internals::samples::Point;
use std::f64::consts::TAU;

/// Levels of the multilevel basis.
const LEVELS: usize = 3;

/// Basis of the comparison.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Basis {
    /// Inverse squared site distance, ϕ^S of \[V11\].
    Shepard,
    /// Gaussian functions with the width of \[V11\] §VI, ϕ^G.
    Gaussian,
    /// Gaussian functions of half that width, between §V and §VI.
    HalfGaussian,
    /// Gaussian functions that are nearly zero at the nominal radius, as in \[V11\] §V.
    NarrowGaussian,
    /// One level of \[L08\]'s functions, ϕ^L of \[V11\].
    Lehtinen,
    /// Three levels of \[L08\]'s functions, with the coarse points in addition.
    LehtinenLevels,
    /// Flat display basis with a scalar per point.
    Flat,
    /// Flat display basis with a vector irradiance per point, as in the plugin.
    FlatVector,
    /// Flat display basis with vectors, and a second pass over the same samples. The pass corrects
    /// each point's value by the residual of the field there. The plugin does not have it.
    CorrectedFlatVector,
}

impl Basis {
    /// Bases in the order of the tables.
    pub const ALL: [Self; 9] = [
        Self::Shepard,
        Self::Gaussian,
        Self::HalfGaussian,
        Self::NarrowGaussian,
        Self::Lehtinen,
        Self::LehtinenLevels,
        Self::Flat,
        Self::FlatVector,
        Self::CorrectedFlatVector,
    ];

    /// Returns the display name.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Shepard => "Shepard 1/d²",
            Self::Gaussian => "Gaussian RBF, σ = α",
            Self::HalfGaussian => "Gaussian RBF, σ = α/2",
            Self::NarrowGaussian => "Gaussian RBF, σ = α/4",
            Self::Lehtinen => "Lehtinen, 1 level",
            Self::LehtinenLevels => "Lehtinen, 3 levels",
            Self::Flat => "ours, scalars",
            Self::FlatVector => "ours",
            Self::CorrectedFlatVector => "ours, second pass",
        }
    }
}

/// Points of one density with the data of the bases.
#[derive(Debug)]
pub struct PointSet {
    /// Minimum distance of two points, meters.
    pub spacing: f64,
    /// Hierarchy with one level.
    single: Hierarchy,
    /// Hierarchy with several levels. The finest has the same points as `single`.
    levels: Hierarchy,
    flat: Vec<Point>,
    display: FlatBasis,
}

impl PointSet {
    /// Creates Poisson disks of radius `spacing` (meters) over sphere and disk.
    #[must_use]
    pub fn new(scene: &SphereOverDisk, spacing: f64, seed: u64) -> Self {
        let geometry = scene.geometry();
        let viewpoints = viewpoints(scene);
        let settings = |levels: usize| HierarchySettings {
            coarse_radius: (spacing * f64::from(1u32 << (levels - 1))) as f32,
            levels,
            sender_levels: levels,
            max: vec![1 << 20; levels],
            // A level's number is added to its seed. The finest level has the same seed with any
            // number of levels.
            seed: seed.wrapping_sub(levels as u64 - 1),
            sender_overlap: None,
            clip: false,
            drop_first: false,
            separate_emitters: false,
        };
        let build = |levels: usize| {
            let built = Hierarchy::build(&geometry, &viewpoints, &settings(levels), &|_| true);
            built.expect("never canceled")
        };
        let (single, levels) = (build(1), build(LEVELS));
        let clipped = HierarchySettings {
            clip: true,
            ..settings(1)
        };
        let (flat, _) = single.flat(&geometry, &viewpoints, &clipped);
        let LevelBasis {
            points,
            planes,
            grid,
        } = flat;
        Self {
            spacing,
            single,
            levels,
            display: FlatBasis {
                radius: points.first().map_or(0.0, |p| p.radius),
                planes,
                grid,
            },
            flat: points,
        }
    }

    /// Returns the points (x, n) at which a basis has samples.
    #[must_use]
    pub fn points(&self, basis: Basis) -> Vec<(Vec3, Vec3)> {
        let of = match basis {
            Basis::LehtinenLevels => &self.levels,
            _ => &self.single,
        };
        of.surfaces.iter().map(|s| (s.position, s.normal)).collect()
    }

    /// Builds a basis over the points.
    ///
    /// # Errors
    /// Returns an error if the Gaussian system cannot be solved.
    pub fn build(&self, basis: Basis) -> Result<Box<dyn PointBasis + '_>, PointBasisError> {
        let points = || self.points(basis);
        Ok(match basis {
            Basis::Shepard => Box::new(ShepardBasis::new(points())?),
            Basis::Gaussian => Box::new(self.gaussian(1.0)?),
            Basis::HalfGaussian => Box::new(self.gaussian(0.5)?),
            Basis::NarrowGaussian => Box::new(self.gaussian(0.25)?),
            Basis::Lehtinen => Box::new(MultilevelBasis(&self.single.levels)),
            Basis::LehtinenLevels => Box::new(MultilevelBasis(&self.levels.levels)),
            Basis::Flat => Box::new(DisplayBasis::new(self, false, false)),
            Basis::FlatVector => Box::new(DisplayBasis::new(self, true, false)),
            Basis::CorrectedFlatVector => Box::new(DisplayBasis::new(self, true, true)),
        })
    }

    /// Builds Gaussian functions with this width in nominal radii.
    ///
    /// # Errors
    /// Returns an error if their system cannot be solved.
    pub fn gaussian(&self, width: f64) -> Result<GaussianBasis, PointBasisError> {
        GaussianBasis::new(self.points(Basis::Gaussian), width)
    }
}

/// Returns positions from which all lit surfaces are visible.
fn viewpoints(scene: &SphereOverDisk) -> Vec<Vec3> {
    let around = (0..6).map(|k| {
        let (s, c) = (TAU * f64::from(k) / 6.0).sin_cos();
        let high = if k % 2 == 0 { 0.3 } else { 1.5 };
        let out = 0.6 * scene.disk;
        Vec3::new(
            (out * c) as f32,
            (high * scene.height) as f32,
            (out * s) as f32,
        )
    });
    let above = scene.height + 4.0 * scene.radius;
    around.chain([Vec3::Y * above as f32]).collect()
}

/// Flat display basis as the frame evaluates it.
struct DisplayBasis<'a> {
    set: &'a PointSet,
    /// `true` if it has vectors instead of scalars.
    vectors: bool,
    /// `true` if the points' values are corrected by their residuals.
    is_corrected: bool,
}

impl<'a> DisplayBasis<'a> {
    fn new(set: &'a PointSet, vectors: bool, is_corrected: bool) -> Self {
        Self {
            set,
            vectors,
            is_corrected,
        }
    }
}

impl PointBasis for DisplayBasis<'_> {
    fn fit(&self, samples: &[PointSample]) -> Result<SurfaceField<'_>, PointBasisError> {
        let (points, display) = (&self.set.flat, &self.set.display);
        check_samples(points.len(), samples)?;
        let value = |s: &PointSample| {
            let axis = |k: usize| s.vector.map(|v| v[k]);
            let four = |v: [f64; 3]| [v[0] as f32, v[1] as f32, v[2] as f32, 0.0];
            if self.vectors {
                VectorIrradiance {
                    x: four(axis(0)),
                    y: four(axis(1)),
                    z: four(axis(2)),
                }
            } else {
                VectorIrradiance {
                    x: four(s.value.to_array()),
                    ..VectorIrradiance::default()
                }
            }
        };
        let mut values: Vec<VectorIrradiance> = samples.iter().map(value).collect();
        if self.is_corrected {
            let second = |(p, v): (&Point, &VectorIrradiance)| {
                let mut moved = *v;
                if let Some(there) = splat_vector(points, display, &values, p.x(), p.n()) {
                    moved.add_scaled(1.0, v);
                    moved.add_scaled(-1.0, &there);
                }
                moved
            };
            values = points.iter().zip(&values).map(second).collect();
        }
        let vectors = self.vectors;
        Ok(Box::new(move |x, n| {
            let found = if vectors {
                splat(points, display, &values, x, n)
            } else {
                let v = splat_vector(points, display, &values, x, n);
                v.map(|v| Vec3::new(v.x[0], v.x[1], v.x[2]))
            };
            found.map(|e| e.as_dvec3())
        }))
    }
}

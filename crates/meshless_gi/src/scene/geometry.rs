//! Interface between light transport and geometry ([L08] §5.1): closest hit, occlusion, surface.

use super::{Emitters, MaterialFactors};
use glam::Vec3;

/// Axis-aligned box, in meters.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    /// Smallest corner.
    pub min: Vec3,
    /// Largest corner.
    pub max: Vec3,
}

impl Bounds {
    /// Empty box. Joined with any position, it gives a box of that position alone.
    pub const EMPTY: Self = Self {
        min: Vec3::INFINITY,
        max: Vec3::NEG_INFINITY,
    };

    /// Returns the smallest box that contains `self` and `p`.
    #[must_use]
    pub fn join(self, p: Vec3) -> Self {
        Self {
            min: self.min.min(p),
            max: self.max.max(p),
        }
    }

    /// Returns the edge lengths in meters. Zero for an empty box.
    #[must_use]
    pub fn size(self) -> Vec3 {
        (self.max - self.min).max(Vec3::ZERO)
    }

    /// Returns the center in meters.
    #[must_use]
    pub fn center(self) -> Vec3 {
        0.5 * (self.min + self.max)
    }
}

/// Ray. [`Ray::new`] and [`Ray::segment`] are the only constructors. They remove negative zeros
/// from the direction, so that equal directions have equal inverses.
#[derive(Clone, Copy, Debug)]
pub struct Ray {
    /// Start, in meters.
    pub origin: Vec3,
    /// Unit direction without components of -0.0.
    pub direction: Vec3,
    /// Largest hit distance, in meters. Hits beyond it are ignored.
    pub max_t: f32,
}

impl Ray {
    /// Creates a ray of infinite length. `direction` must be of unit length.
    #[must_use]
    pub fn new(origin: Vec3, direction: Vec3) -> Self {
        Self::segment(origin, direction, f32::INFINITY)
    }

    /// Creates a ray that ends after `max_t` meters.
    #[must_use]
    pub fn segment(origin: Vec3, direction: Vec3, max_t: f32) -> Self {
        Self {
            origin,
            // Adding +0.0 turns -0.0 into +0.0 and does not change any other value.
            direction: direction + Vec3::ZERO,
            max_t,
        }
    }

    /// Returns the position at distance `t`.
    #[must_use]
    pub fn at(&self, t: f32) -> Vec3 {
        self.origin + self.direction * t
    }
}

/// Intersection of a ray with a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Distance along the ray, in meters.
    pub t: f32,
    /// Index of the primitive: a triangle or a shape.
    pub primitive: u32,
    /// Barycentric weights of the second and third vertex, or any two surface parameters.
    pub uv: [f32; 2],
}

/// Surface at a hit, on the side of the ray's origin.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Surface {
    /// Position in meters, as near to the true surface as the representation allows.
    pub position: Vec3,
    /// Unit geometric normal on the side of the ray's origin.
    pub normal: Vec3,
    /// Diffuse reflectance, linear RGB, each in [0, 1]. Black on the back of a single-sided
    /// material.
    pub albedo: Vec3,
    /// Emitted radiosity M = π · radiance, W/m². Black on the back of a single-sided material.
    pub emission: Vec3,
    /// `true` if the ray hit the front of the surface, given by the winding.
    pub front: bool,
}

/// Subset of a [`Surface`] that a gather needs for each of its hits. It requires no texture reads.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HitPoint {
    /// Position in meters.
    pub position: Vec3,
    /// Unit geometric normal on the side of the ray's origin.
    pub normal: Vec3,
    /// `false` on the back of a single-sided material, which reflects and emits no light.
    pub lit: bool,
}

/// Terms that multiply a material's factors at a hit: textures, visible side and dielectric
/// fraction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MaterialTerms {
    /// Index of the material among [`Geometry::materials`].
    pub material: u32,
    /// Diffuse reflectance for a base color of one. Black on the back of a single-sided material.
    pub albedo: Vec3,
    /// Emitted radiance for an emissive factor of one. Black on the back of a single-sided
    /// material.
    pub emission: Vec3,
}

/// Plane at which a basis function ends, and the range behind the plane that still belongs to its
/// side.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Barrier {
    /// Unit normal, toward the origin of the ray.
    pub normal: Vec3,
    /// Position on the plane, meters.
    pub position: Vec3,
    /// Half of the thickness of an occluder in meters. The plane is then the middle of the
    /// occluder. `None` for static geometry, because no geometry is rendered inside it.
    pub half_thickness: Option<f32>,
}

/// Queries of light transport to a scene. Implementations are pure: the same ray gives the same
/// result on any thread.
pub trait Geometry: Sync {
    /// Returns a box around all geometry. [`Bounds::EMPTY`] if there is none.
    fn bounds(&self) -> Bounds;

    /// Returns the closest hit with `t` in (0, `ray.max_t`). Rays pass through cut-out texels.
    fn cast(&self, ray: &Ray) -> Option<Hit>;

    /// Returns `true` if any geometry lies strictly between `from` and `to`. Callers must offset
    /// both ends from the surfaces.
    fn is_occluded(&self, from: Vec3, to: Vec3) -> bool;

    /// Returns the surface at `hit` of `ray`.
    fn surface(&self, ray: &Ray, hit: &Hit) -> Surface;

    /// Returns only the position and the side of [`surface`](Self::surface). The values are bitwise
    /// identical.
    fn hit_point(&self, ray: &Ray, hit: &Hit) -> HitPoint {
        let surface = self.surface(ray, hit);
        HitPoint {
            position: surface.position,
            normal: surface.normal,
            lit: surface.front || surface.albedo != Vec3::ZERO,
        }
    }

    /// Returns the material at `hit` of `ray`. `None` if the geometry has no materials that can
    /// change.
    fn material_terms(&self, _ray: &Ray, _hit: &Hit) -> Option<MaterialTerms> {
        None
    }

    /// Returns the names and factors of the materials that [`material_terms`](Self::material_terms)
    /// references. Names may occur more than once.
    fn materials(&self) -> Vec<(String, MaterialFactors)> {
        Vec::new()
    }

    /// Returns the emissive triangles for area sampling. `None` if nothing emits. Also `None` if
    /// emission can be sampled only by rays over the hemisphere.
    fn emitters(&self) -> Option<&Emitters> {
        None
    }

    /// Returns the occluders that `ray` crosses before its end, as bits by occluder number.
    /// Occluders are open, and [`cast`](Self::cast) ignores them.
    fn crossed_occluders(&self, _ray: &Ray) -> u64 {
        0
    }

    /// Returns the same geometry with all occluders closed. `None` without occluders. Basis
    /// functions end at occluders as at walls, in any state.
    fn with_occluders_closed(&self) -> Option<&dyn Geometry> {
        None
    }

    /// Returns the plane at which basis functions end at the hit of `ray`.
    fn barrier(&self, ray: &Ray, hit: &Hit) -> Barrier {
        let surface = self.surface(ray, hit);
        Barrier {
            normal: surface.normal,
            position: surface.position,
            half_thickness: None,
        }
    }

    /// Returns the distance in meters by which a ray's start is offset from a surface at `p`. The
    /// offset prevents a second hit on that surface.
    fn ray_offset(&self, p: Vec3) -> f32 {
        mesh_ray_offset(self.bounds().size().max_element(), p)
    }

    /// Returns the part of [`ray_offset`](Self::ray_offset) that is caused by surface above `p`, in
    /// meters. 0 for smooth surfaces. A frame offsets its shadow rays for rounding only, so light
    /// samples are placed this far above the surface.
    fn surface_relief(&self, _p: Vec3) -> f32 {
        0.0
    }
}

/// Returns the ray offset in meters at `p` for exact surfaces of a geometry of this size.
pub(super) fn mesh_ray_offset(size: f32, p: Vec3) -> f32 {
    (1e-5 * size).max(8.0 * f32::EPSILON * p.abs().max_element().max(size))
}

//! The one interface between light transport and geometry ([L08] §5.1): cast, occlusion, surface.

use super::{Emitters, MaterialFactors};
use glam::Vec3;

/// An axis-aligned box, in meters.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    /// Smallest corner.
    pub min: Vec3,
    /// Largest corner.
    pub max: Vec3,
}

impl Bounds {
    /// A box that holds nothing; joining it with anything gives that thing.
    pub const EMPTY: Self = Self {
        min: Vec3::INFINITY,
        max: Vec3::NEG_INFINITY,
    };

    /// The smallest box that holds `self` and `p`.
    #[must_use]
    pub fn join(self, p: Vec3) -> Self {
        Self {
            min: self.min.min(p),
            max: self.max.max(p),
        }
    }

    /// Edge lengths in meters; zero where the box is empty.
    #[must_use]
    pub fn size(self) -> Vec3 {
        (self.max - self.min).max(Vec3::ZERO)
    }

    /// The center, in meters.
    #[must_use]
    pub fn center(self) -> Vec3 {
        0.5 * (self.min + self.max)
    }
}

/// A ray. [`Ray::new`] is the only way to make one: it removes negative zeros from the direction,
/// so that equal directions have equal inverses.
#[derive(Clone, Copy, Debug)]
pub struct Ray {
    /// Start, in meters.
    pub origin: Vec3,
    /// Unit direction; no component is -0.0.
    pub direction: Vec3,
    /// Hits farther than this (meters) do not count.
    pub max_t: f32,
}

impl Ray {
    /// A ray without an end. `direction` must be of unit length.
    #[must_use]
    pub fn new(origin: Vec3, direction: Vec3) -> Self {
        Self::segment(origin, direction, f32::INFINITY)
    }

    /// A ray that ends after `max_t` meters.
    #[must_use]
    pub fn segment(origin: Vec3, direction: Vec3, max_t: f32) -> Self {
        Self {
            origin,
            // Adding +0.0 turns -0.0 into +0.0 and leaves every other value as it is.
            direction: direction + Vec3::ZERO,
            max_t,
        }
    }

    /// The point at distance `t`.
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

/// The surface at a hit, seen from the side the ray came from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Surface {
    /// Position in meters, as near to the true surface as the representation can say.
    pub position: Vec3,
    /// Unit geometric normal on the side the ray came from.
    pub normal: Vec3,
    /// Diffuse reflectance, linear RGB, each in [0, 1]. Black on the back of a single-sided
    /// material.
    pub albedo: Vec3,
    /// Emitted radiosity M = π · radiance, W/m². Black on the back of a single-sided material.
    pub emission: Vec3,
    /// True where the ray met the front (the winding's side) of the surface.
    pub front: bool,
}

/// The part of a [`Surface`] that a gather needs of each of its hits: no texture is read for it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HitPoint {
    /// Position in meters.
    pub position: Vec3,
    /// Unit geometric normal on the side the ray came from.
    pub normal: Vec3,
    /// False on the back of a single-sided material: no light comes from there.
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
    /// Unit normal, toward the start of the ray that met it.
    pub normal: Vec3,
    /// A position on the plane, meters.
    pub position: Vec3,
    /// Half of the thickness of an occluder, meters, whose middle the plane is; none for what
    /// stays, which nothing is drawn inside of.
    pub half_thickness: Option<f32>,
}

/// Queries of light transport to a scene. Implementations are pure: the same ray gives the same
/// result on any thread.
pub trait Geometry: Sync {
    /// A box around everything. [`Bounds::EMPTY`] when there is nothing.
    fn bounds(&self) -> Bounds;

    /// The closest hit with `t` in (0, `ray.max_t`). Cut-out texels are passed through.
    fn cast(&self, ray: &Ray) -> Option<Hit>;

    /// True when anything lies strictly between `from` and `to`. Callers keep both ends off the
    /// surfaces.
    fn occluded(&self, from: Vec3, to: Vec3) -> bool;

    /// The surface where `ray` met `hit`.
    fn surface(&self, ray: &Ray, hit: &Hit) -> Surface;

    /// The position and side of [`surface`](Self::surface) alone, with the same bits.
    fn hit_point(&self, ray: &Ray, hit: &Hit) -> HitPoint {
        let surface = self.surface(ray, hit);
        HitPoint {
            position: surface.position,
            normal: surface.normal,
            lit: surface.front || surface.albedo != Vec3::ZERO,
        }
    }

    /// The material where `ray` met `hit`; none where the geometry has no materials that could
    /// change.
    fn material_terms(&self, _ray: &Ray, _hit: &Hit) -> Option<MaterialTerms> {
        None
    }

    /// The materials that [`material_terms`](Self::material_terms) names: names and factors. The
    /// same names may come again.
    fn materials(&self) -> Vec<(String, MaterialFactors)> {
        Vec::new()
    }

    /// Emissive triangles, for samples of their area. `None` if nothing emits, or if only rays of
    /// the hemisphere can find what emits.
    fn emitters(&self) -> Option<&Emitters> {
        None
    }

    /// The occluders that `ray` passes before its end, bit k for number k: they stand open, and
    /// [`cast`](Self::cast) ignores them.
    fn crossed_occluders(&self, _ray: &Ray) -> u64 {
        0
    }

    /// The same geometry with all occluders shut, where there are any: functions end at them as at
    /// walls, open or not.
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

    /// A length, in meters, by which a ray's start is lifted off a surface at `p` so that it cannot
    /// meet it again.
    fn ray_offset(&self, p: Vec3) -> f32 {
        mesh_ray_offset(self.bounds().size().max_element(), p)
    }

    /// Part of [`ray_offset`](Self::ray_offset) that is due to surface near `p` that rises above
    /// it, meters. 0 for smooth surfaces. A frame offsets its shadow rays for rounding only, so
    /// light samples are placed this far above the surface.
    fn surface_relief(&self, _p: Vec3) -> f32 {
        0.0
    }
}

/// The lift off exact surfaces at `p` of a geometry of this size, meters.
pub(super) fn mesh_ray_offset(size: f32, p: Vec3) -> f32 {
    (1e-5 * size).max(8.0 * f32::EPSILON * p.abs().max_element().max(size))
}

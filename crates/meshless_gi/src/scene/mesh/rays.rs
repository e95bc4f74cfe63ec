//! Ray casts against a triangle mesh.

use super::*;

/// Returns the unit normal on the side with counter-clockwise corners. `None` if the triangle has
/// no area.
pub(super) fn normal([a, b, c]: &[Vec3; 3]) -> Option<Vec3> {
    let [a, b, c]: [DVec3; 3] = [*a, *b, *c].map(Vec3::as_dvec3);
    let cross = (b - a).cross(c - a);
    let length = cross.length();
    (length > 0.0).then(|| (cross / length).as_vec3())
}

pub(super) fn interpolate(corners: [Vec2; 3], [u, v]: [f32; 2]) -> Vec2 {
    let [a, b, c] = corners;
    a + (b - a) * u + (c - a) * v
}

/// Returns the hit position on a face, the normal on the side of the ray's origin, and `true` if
/// that side is the front.
fn arrive(face: &Face, ray: &Ray, hit: &Hit) -> (Vec3, Vec3, bool) {
    let [a, b, c] = face.corners;
    let outward = normal(&face.corners).unwrap_or(-ray.direction);
    let front = outward.dot(ray.direction) <= 0.0;
    (
        a + (b - a) * hit.uv[0] + (c - a) * hit.uv[1],
        if front { outward } else { -outward },
        front,
    )
}

/// Converts a ray for obvhs. Vectors are converted to arrays. Inverses are exact where possible. An
/// overestimate of a component near zero would let a ray along a wall miss the wall behind it.
fn traversal_ray(ray: &Ray) -> obvhs::ray::Ray {
    const MIN_COMPONENT: f32 = 1e-18;
    let guarded = |d: f32| {
        if d.abs() < MIN_COMPONENT {
            MIN_COMPONENT.copysign(d)
        } else {
            d
        }
    };
    let inverse = ray.direction.to_array().map(|d| 1.0 / guarded(d));
    obvhs::ray::Ray {
        origin: ray.origin.to_array().into(),
        direction: ray.direction.to_array().into(),
        inv_direction: inverse.into(),
        tmin: 0.0,
        tmax: ray.max_t,
    }
}

fn is_usable(ray: &Ray) -> bool {
    ray.origin.is_finite()
        && ray.direction.is_finite()
        && ray.direction != Vec3::ZERO
        && ray.max_t > 0.0
}

impl Geometry for TriangleMesh {
    fn bounds(&self) -> Bounds {
        self.bounds
    }

    fn cast(&self, ray: &Ray) -> Option<Hit> {
        /// The traversal continues slightly beyond the closest hit, so that another triangle at the
        /// same distance is tested.
        const BEYOND: f32 = 1.0 + 8.0 * f32::EPSILON;
        if self.faces.is_empty() || !is_usable(ray) {
            return None;
        }
        let test = WatertightRay::new(ray);
        let mut best: Option<Hit> = None;
        self.tree
            .ray_traverse(traversal_ray(ray), &mut RayHit::none(), |_, k| {
                let face = &self.faces[k];
                let [a, b, c] = face.corners;
                let limit = best.map_or(ray.max_t, |h| h.t);
                let Some(hit) = test.intersect(a, b, c, limit) else {
                    return f32::INFINITY;
                };
                let closer = match &best {
                    None => hit.t < ray.max_t,
                    Some(b) => hit.t < b.t || face.index < b.primitive,
                };
                if !closer || !self.is_solid(face, &hit) {
                    return f32::INFINITY;
                }
                best = Some(Hit {
                    t: hit.t,
                    primitive: face.index,
                    uv: [hit.u, hit.v],
                });
                hit.t * BEYOND
            });
        best
    }

    fn is_occluded(&self, from: Vec3, to: Vec3) -> bool {
        // The direction is not normalized: t runs from 0 to 1.
        let ray = Ray::segment(from, to - from, 1.0);
        if self.faces.is_empty() || !is_usable(&ray) {
            return false;
        }
        let test = WatertightRay::new(&ray);
        !self.tree.ray_traverse_miss(traversal_ray(&ray), |_, k| {
            let face = &self.faces[k];
            let [a, b, c] = face.corners;
            match test.intersect(a, b, c, 1.0) {
                Some(hit) if hit.t < 1.0 && self.is_solid(face, &hit) => 0.0,
                _ => f32::INFINITY,
            }
        })
    }

    fn surface(&self, ray: &Ray, hit: &Hit) -> Surface {
        let Some(&face_index) = self.face_index.get(hit.primitive as usize) else {
            // The hit is not on this mesh. The result is a black surface that faces the ray.
            return Surface {
                position: ray.at(hit.t),
                normal: -ray.direction,
                albedo: Vec3::ZERO,
                emission: Vec3::ZERO,
                front: true,
            };
        };
        let face = &self.faces[face_index as usize];
        let (position, normal, front) = arrive(face, ray, hit);
        let material = &self.materials[face.material as usize];
        let (mut albedo, mut emission) = (Vec3::ZERO, Vec3::ZERO);
        if front || material.double_sided {
            let (color, metallic, glow) = self.texels(face, hit);
            albedo = material.base_color.truncate() * color * (1.0 - metallic);
            emission = PI * material.emissive * glow;
        }
        Surface {
            position,
            normal,
            albedo,
            emission,
            front,
        }
    }

    fn material_terms(&self, ray: &Ray, hit: &Hit) -> Option<MaterialTerms> {
        let face = &self.faces[*self.face_index.get(hit.primitive as usize)? as usize];
        let (_, _, front) = arrive(face, ray, hit);
        let (mut albedo, mut emission) = (Vec3::ZERO, Vec3::ZERO);
        if front || self.materials[face.material as usize].double_sided {
            let (color, metallic, glow) = self.texels(face, hit);
            (albedo, emission) = (color * (1.0 - metallic), glow);
        }
        Some(MaterialTerms {
            material: face.material,
            albedo,
            emission,
        })
    }

    fn materials(&self) -> Vec<(String, MaterialFactors)> {
        let all = self.materials.iter();
        all.map(|m| (m.name.clone(), m.factors())).collect()
    }

    fn emitters(&self) -> Option<&Emitters> {
        (!self.emitters.is_empty()).then_some(&self.emitters)
    }

    fn hit_point(&self, ray: &Ray, hit: &Hit) -> HitPoint {
        let Some(&face_index) = self.face_index.get(hit.primitive as usize) else {
            return HitPoint {
                position: ray.at(hit.t),
                normal: -ray.direction,
                lit: true,
            };
        };
        let face = &self.faces[face_index as usize];
        let (position, normal, front) = arrive(face, ray, hit);
        HitPoint {
            position,
            normal,
            lit: front || self.materials[face.material as usize].double_sided,
        }
    }

    fn ray_offset(&self, p: Vec3) -> f32 {
        self.surface_relief(p)
            .max(mesh_ray_offset(self.bounds.size().max_element(), p))
    }

    fn surface_relief(&self, p: Vec3) -> f32 {
        self.lifts.iter().map(|l| l.at(p)).fold(0.0, f32::max)
    }
}

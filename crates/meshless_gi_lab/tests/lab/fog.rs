//! Light in fog: radiance that a position in the air scatters toward a camera, compared with the
//! reference integrator. No light of the adjacent room arrives.

use glam::{Mat4, UVec3, Vec2, Vec3};
use meshless_gi::internals::basis::PROBE_OVERLAP;
use meshless_gi::internals::eval::irradiance_at_all;
use meshless_gi::internals::frame::fog::STEP_VOXELS;
use meshless_gi::internals::frame::fog_inscatter::{fog_inscatter, sides};
use meshless_gi::internals::frame::volume::volume_texels;
use meshless_gi::internals::frame::volume_sample::read_voxels;
use meshless_gi::internals::frame::{
    Fog, FogInscatterParams, FogParams, FogView, VolumeParams, VolumeValues, VoxelGrid,
    VoxelWeights, fog, voxels_of,
};
use meshless_gi::internals::samples::{lattice, uniform_sphere};
use meshless_gi::{
    BakedScene, CpuFrame, FrameLight, FrameSettings, Geometry, Irradiance, Light, Material, Preset,
    ProbeSettings, Progress, Quad, Ray, Recipe, ReferenceSettings, TriangleMesh, bake_scene,
};
use meshless_gi_lab::accuracy::errors;
use meshless_gi_lab::fixtures::data::open_rooms;
use std::f32::consts::{FRAC_1_PI, PI};
use std::sync::OnceLock;

/// Number of reflections in the frame and in the reference.
const REFLECTIONS: u32 = 4;
/// Number of directions per position in the reference.
const DIRECTION_COUNT: u32 = 512;

/// Bakes a mesh at Draft with probes.
fn baked(mesh: &TriangleMesh) -> BakedScene {
    let recipe = Recipe {
        preset: Preset::Draft,
        probes: Some(ProbeSettings::default()),
        ..Recipe::default()
    };
    let baked = bake_scene(mesh, &recipe, 0, &Progress::default());
    baked.expect("a bake").scene
}

/// A room with a light, an opening in its wall, and a second room. Baked once for all tests.
fn rooms() -> &'static (TriangleMesh, Vec<Light>, BakedScene) {
    static ROOMS: OnceLock<(TriangleMesh, Vec<Light>, BakedScene)> = OnceLock::new();
    ROOMS.get_or_init(|| {
        let (mesh, lights) = open_rooms();
        let scene = baked(&mesh);
        (mesh, lights, scene)
    })
}

/// Input of fog: a volume of a bake in one light.
struct FogVolumeInput {
    shape: VoxelGrid,
    texels: Vec<[f32; 4]>,
}

impl FogVolumeInput {
    /// Computes the volume with voxels of `edge` meters, or of the plugin's default size.
    fn new(scene: &BakedScene, lights: &[Light], edge: Option<f32>) -> Self {
        let mut frame = CpuFrame::new(scene);
        let lights: Vec<FrameLight> = lights
            .iter()
            .flat_map(|l| FrameLight::expand(l, 16))
            .collect();
        frame.set_lights(scene, &lights);
        frame.solve(scene, &FrameSettings::bounces(REFLECTIONS));
        let probes = scene.data().probes.as_ref().unwrap();
        let widest = probes.points.iter().map(|p| p.radius).fold(0.0, f32::max);
        let edge = edge.unwrap_or(0.5 * widest / PROBE_OVERLAP);
        let [low, high] = scene.info().bounds.map(Vec3::from);
        let (low, high) = (low - edge, high + edge);
        let shape = VoxelGrid::new([low, high], voxels_of(high - low, edge, u32::MAX)).unwrap();
        let positions = VoxelWeights::from_scene(shape, scene.data());
        let values = VolumeValues {
            points: frame.vector_irradiance(),
            probes: frame.probes(),
        };
        let texels = volume_texels(
            &VolumeParams::new(&shape, &Mat4::IDENTITY),
            &positions,
            values,
        );
        Self { shape, texels }
    }

    /// Returns the radiance of a position toward a camera, W/(m² sr). The camera ray has direction
    /// `d`.
    fn scattered(&self, x: Vec3, asymmetry: f32, d: Vec3) -> Vec3 {
        // A distant camera: all rays are parallel to `d`.
        let parallel = FogView {
            view_from_clip: Mat4::orthographic_rh(-1.0, 1.0, -1.0, 1.0, 50.0, 0.1).inverse(),
            world_from_view: Mat4::look_to_rh(x, d, d.any_orthonormal_vector()).inverse(),
            viewport: [0.0, 0.0, 1.0, 1.0],
            exposure: 1.0,
            steps: 1,
        };
        let params = FogInscatterParams::new(&parallel, asymmetry, &self.shape, &Mat4::IDENTITY);
        let texel = (x - self.shape.origin()) / self.shape.voxel();
        read_voxels(params.size, &self.texels, texel, |voxel| {
            Vec3::from_slice(&fog_inscatter(&params, &self.texels, voxel)[..3])
        })
    }
}

/// Positions in the air of both rooms and of the door between them, each with a ray direction.
fn positions() -> Vec<(Vec3, Vec3)> {
    (0..80)
        .map(|k| {
            let t = (k as f32 + 0.5) / 80.0;
            let door = (-((t - 0.5) * 9.0).powi(2)).exp();
            let z = 0.5 + 2.6 * (0.5 + 0.5 * (t * 21.0).sin());
            let y = 0.4 + 1.8 * (0.5 + 0.5 * (t * 33.0).sin());
            let x = Vec3::new(0.4 + 7.2 * t, y + door * (1.0 - y), z + door * (1.95 - z));
            (x, uniform_sphere(lattice(k, 80, Vec2::ZERO)).normalize())
        })
        .collect()
}

/// Phase function of Henyey and Greenstein (1941), 1/sr, for light from direction `w` and a camera
/// ray of direction `d`. Both point against the light's path.
fn phase(asymmetry: f32, w: Vec3, d: Vec3) -> f32 {
    let g = asymmetry;
    (1.0 - g * g) / (4.0 * PI * (1.0 + g * g - 2.0 * g * w.dot(d)).powf(1.5))
}

/// Radiance of the surfaces around each position after one reflection and more, by rays from the
/// position and the reference integrator: (position, direction, radiance).
fn trace_surroundings(
    mesh: &TriangleMesh,
    lights: &[Light],
    positions: &[(Vec3, Vec3)],
) -> Vec<(usize, Vec3, Vec3)> {
    let mut hits = Vec::new();
    let mut visible = Vec::new();
    for (k, &(x, _)) in positions.iter().enumerate() {
        let shift = Vec2::new(k as f32 * 0.618, k as f32 * 0.755).fract();
        for i in 0..DIRECTION_COUNT {
            let w = uniform_sphere(lattice(i, DIRECTION_COUNT, shift)).normalize();
            let ray = Ray::new(x, w);
            let surface = mesh.cast(&ray).map(|hit| mesh.surface(&ray, &hit));
            if let Some(surface) = surface.filter(|s| s.front) {
                visible.push((k, w, surface.albedo));
                hits.push((surface.position, surface.normal));
            }
        }
    }
    let settings = ReferenceSettings {
        paths: 128,
        bounces: Some(REFLECTIONS - 1),
        seed: 5,
    };
    let lit = irradiance_at_all(mesh, lights, &hits, &settings);
    let radiance = |((k, w, albedo), e): ((usize, Vec3, Vec3), &Irradiance)| {
        (k, w, albedo * FRAC_1_PI * (e.direct + e.indirect))
    };
    visible.into_iter().zip(&lit).map(radiance).collect()
}

/// Integral at each position of that radiance times `weight(position, direction)`.
fn integrals(
    around: &[(usize, Vec3, Vec3)],
    positions: usize,
    weight: impl Fn(usize, Vec3) -> f32,
) -> Vec<Vec3> {
    let mut sums = vec![Vec3::ZERO; positions];
    for &(k, w, radiance) in around {
        sums[k] += radiance * weight(k, w) * (4.0 * PI / DIRECTION_COUNT as f32);
    }
    sums
}

fn nrmse(values: &[Vec3], reference: &[Vec3]) -> f64 {
    errors(values, reference, &vec![Vec3::ZERO; reference.len()]).nrmse
}

#[test]
fn fog_matches_reference() {
    let (mesh, lights, scene) = rooms();
    let positions = positions();
    let asymmetries = [0.0, 0.25, 0.5, 0.75];
    let around = trace_surroundings(mesh, lights, &positions);
    let all = positions.len();
    let right = asymmetries.map(|g| integrals(&around, all, |k, w| phase(g, w, positions[k].1)));
    // Irradiance of the six sides at the positions themselves.
    let faces = [0, 1, 2, 3, 4, 5].map(|side| {
        let n = Vec3::AXES[side / 2] * [1.0, -1.0][side % 2];
        integrals(&around, all, |_, w| FRAC_1_PI * w.dot(n).max(0.0))
    });
    let six_sides: Vec<f64> = (asymmetries.iter().zip(&right))
        .map(|(g, right)| {
            let one = |k: usize| -> Vec3 {
                let weights = sides(*g, positions[k].1);
                (0..6).map(|side| weights[side] * faces[side][k]).sum()
            };
            nrmse(&(0..all).map(one).collect::<Vec<_>>(), right)
        })
        .collect();
    println!(
        "six irradiances of the reference itself, asymmetry {asymmetries:?}: NRMSE {six_sides:.3?}"
    );
    for (name, edge) in [
        ("default", None),
        ("0.1 m", Some(0.1)),
        ("0.4 m", Some(0.4)),
    ] {
        let air = FogVolumeInput::new(scene, lights, edge);
        let found = asymmetries.map(|g| -> Vec<Vec3> {
            (positions.iter())
                .map(|&(x, d)| air.scattered(x, g, d))
                .collect()
        });
        let off: Vec<f64> = (found.iter().zip(&right))
            .map(|(f, r)| nrmse(f, r))
            .collect();
        // Isotropic fog instead.
        let even: Vec<f64> = right.iter().map(|r| nrmse(&found[0], r)).collect();
        println!(
            "{name} voxels ({}), asymmetry {asymmetries:?}: NRMSE {off:.3?}; isotropic: {even:.3?}",
            air.shape.size()
        );
        // Error of the volume on top of the error of six irradiances.
        for k in 0..asymmetries.len() {
            assert!(
                off[k] <= six_sides[k] + 0.04,
                "{name}: {off:?}, {six_sides:?}"
            );
        }
        for k in [1, 2] {
            assert!(off[k] < 0.5 * even[k], "{name}: {off:?}, {even:?}");
        }
        // Must fail: light of the wrong side, and of other positions.
        let turned: Vec<Vec3> = (positions.iter())
            .map(|&(x, d)| air.scattered(x, 0.5, -d))
            .collect();
        let mut moved = found[0].clone();
        moved.rotate_left(1);
        let [turned, moved] = [nrmse(&turned, &right[2]), nrmse(&moved, &right[0])];
        println!("{name}: from the wrong side {turned:.3}, of the next position {moved:.3}");
        assert!(turned > 0.4 && moved > 0.1, "{turned} {moved}");
    }
}

/// Error of ray steps of one to eight voxels, relative to steps of an eighth of a voxel.
#[test]
fn fog_ray_step_error_is_bounded() {
    let (mesh, lights, scene) = rooms();
    let air = FogVolumeInput::new(scene, lights, None);
    let bounds = scene.info().bounds.map(Vec3::from);
    let size = [24u32, 16];
    let near = 0.1;
    let projection = Mat4::perspective_infinite_reverse_rh(1.0, 1.5, near);
    let mut off = [0.0f64; 4];
    for (eye, at) in [
        (Vec3::new(0.5, 1.5, 0.5), Vec3::new(5.0, 1.0, 2.2)),
        (Vec3::new(7.5, 1.5, 3.0), Vec3::new(3.0, 1.0, 1.8)),
        (Vec3::new(3.5, 0.5, 3.0), Vec3::new(0.5, 2.0, 0.5)),
    ] {
        let view = FogView {
            view_from_clip: projection.inverse(),
            world_from_view: Mat4::look_at_rh(eye, at, Vec3::Y).inverse(),
            viewport: [0.0, 0.0, size[0] as f32, size[1] as f32],
            exposure: 1.0,
            steps: 1000,
        };
        let fog = Fog {
            world_from_local: Mat4::from_translation(Vec3::new(4.0, 1.3, 1.8))
                * Mat4::from_scale(Vec3::splat(9.0)),
            color: Vec3::ONE,
            density: 0.5,
            absorption: 0.1,
            scattering: 0.3,
            asymmetry: 0.5,
            texture: None,
        };
        let sent = FogInscatterParams::new(&view, fog.asymmetry, &air.shape, &Mat4::IDENTITY);
        let n = air.shape.size();
        let light: Vec<[f32; 4]> = (0..n.element_product())
            .map(|i| UVec3::new(i % n.x, i / n.x % n.y, i / (n.x * n.y)))
            .map(|voxel| fog_inscatter(&sent, &air.texels, voxel))
            .collect();
        let params = FogParams::new(&view, &fog, &air.shape, bounds, &Mat4::IDENTITY, &[]);
        let picture = |parts: f32| -> Vec<Vec3> {
            let mut params = params;
            params.part *= parts / STEP_VOXELS;
            (0..size[0] * size[1])
                .map(|i| {
                    let pixel = Vec2::new((i % size[0]) as f32, (i / size[0]) as f32) + 0.5;
                    let ndc = Vec2::new(
                        2.0 * pixel.x / size[0] as f32 - 1.0,
                        1.0 - 2.0 * pixel.y / size[1] as f32,
                    );
                    let far = view.view_from_clip * ndc.extend(0.0).extend(1.0);
                    let toward = far.truncate() / -far.z;
                    let way = view.world_from_view.transform_vector3(toward);
                    let hit = mesh.cast(&Ray::new(eye, way));
                    let depth = hit.map_or(0.0, |hit| near / hit.t);
                    fog::fog(&params, &air.texels, &light, &|_| 1.0, pixel, depth)
                })
                .collect()
        };
        let right = picture(0.125);
        for (off, parts) in off.iter_mut().zip([1.0, 2.0, 4.0, 8.0]) {
            *off = off.max(nrmse(&picture(parts), &right));
        }
    }
    println!("parts of 1, 2, 4 and 8 voxels: NRMSE {off:.4?}");
    assert_eq!(STEP_VOXELS, 2.0);
    assert!(off[1] < 0.01 && off[3] > 2.0 * off[1], "{off:?}");
}

/// Two rooms, two centimeters apart, one lit: the other room's fog is dark up to its walls.
#[test]
fn fog_in_unlit_room_is_dark() {
    let size = Vec3::new(3.0, 2.5, 3.0);
    let low = Vec3::new(3.02, 0.0, 0.0);
    let mut quads = room(Vec3::ZERO, size);
    quads.extend(room(low, low + size));
    let scene = baked(&TriangleMesh::from_quads(&quads));
    let light_source = Light::Point {
        position: Vec3::new(1.5, 2.0, 1.5),
        intensity: Vec3::ONE,
        range: f32::INFINITY,
    };
    let air = FogVolumeInput::new(&scene, &[light_source], None);
    let (mut lit, mut dark) = (0.0f32, 0.0f32);
    let count = 3000;
    for k in 0..count {
        let texel = lattice(k, count, Vec2::ZERO);
        let high = (k as f32 * 0.7548777).fract();
        let x = size * Vec3::new(texel.x, high, texel.y);
        let d = uniform_sphere(lattice((7 * k) % count, count, Vec2::splat(0.3)));
        let at = |x| air.scattered(x, 0.5, d).max_element();
        lit += at(x) / count as f32;
        dark = dark.max(at(x + low));
    }
    println!(
        "largest of the dark room over the lit one's mean: {:.1e}",
        dark / lit
    );
    assert!(lit > 0.01 && dark <= 1e-4 * lit, "{dark} of {lit}");
}

/// The six walls of a room, which face inward.
fn room(low: Vec3, high: Vec3) -> Vec<Quad> {
    let axes = Vec3::AXES;
    (0..6)
        .map(|k| {
            let edges = [1, 2].map(|next| axes[(k / 2 + next) % 3] * (high - low));
            let (origin, [u, v]) = match k % 2 {
                0 => (low, edges),
                _ => (low + axes[k / 2] * (high - low), [edges[1], edges[0]]),
            };
            Quad {
                corners: [origin, origin + u, origin + u + v, origin + v],
                material: Material::diffuse(Vec3::splat(0.7)),
            }
        })
        .collect()
}

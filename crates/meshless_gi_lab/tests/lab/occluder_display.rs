//! A door that is drawn as a dynamic object, in the opening between two rooms. Its own pixels and
//! those of the adjacent jambs and floor are compared with the reference integrator with the door's
//! mesh in the scene. The door is shut and half open. The occluders enclose the mesh, equal it, lie
//! inside of it, or are absent. `MGI_TEST_PICTURES` names a folder for the pictures.

use glam::{Mat4, Quat, Vec2, Vec3};
use meshless_gi::internals::frame::splat::{FULL_COVER, splat_covered, surface_fraction};
use meshless_gi::internals::frame::volume::volume_texels;
use meshless_gi::internals::frame::volume_sample::read_volume;
use meshless_gi::internals::frame::{
    VolumeParams, VolumeValues, VoxelGrid, VoxelWeights, voxels_of,
};
use meshless_gi::{
    BakedScene, CpuFrame, FrameLight, FrameSettings, Geometry, Material, OccluderBox, OccluderDesc,
    Preset, ProbeSettings, Progress, Quad, Recipe, ReferenceSettings, TriangleMesh, bake_scene,
    irradiance,
};
use meshless_gi_lab::accuracy::Camera;
use meshless_gi_lab::fixtures::data::open_rooms;
use rayon::prelude::*;
use std::path::Path;
use std::sync::OnceLock;

/// Center of the shut door, and half of its edges: a panel of 12 mm in a wall of 20 mm, so that
/// parts of the jambs are visible.
const DOOR_CENTER: Vec3 = Vec3::new(4.01, 1.0, 1.95);
const DOOR_HALF_SIZE: Vec3 = Vec3::new(0.006, 1.0, 0.45);
/// Half of the thickness of the occluders: thicker than the door, as thick, and inside of it.
const BOXES: [(&str, f32); 3] = [("thicker", 0.06), ("equal", 0.006), ("thinner", 0.002)];
/// Largest distance to the opening of pixels of baked surfaces that count as its jambs and its
/// foot, meters.
const MAX_JAMB_DISTANCE: f32 = 0.15;
/// Pixels of a picture.
const SIZE: [u32; 2] = [40, 36];

/// Two views from the lit room, straight on and from aside, and one from the other room.
const VIEWS: [(&str, [f32; 3]); 3] = [
    ("front", [1.6, 1.1, 2.2]),
    ("aside", [2.9, 1.5, 0.6]),
    ("behind", [5.9, 1.3, 2.6]),
];

/// Content of a pixel.
#[derive(Clone, Copy, PartialEq)]
enum Part {
    Door,
    Jamb,
    Far,
}

#[derive(Clone, Copy)]
struct Pixel {
    x: Vec3,
    n: Vec3,
    part: Part,
    right: Vec3,
}

/// The scene, its lights, and the pixels of each view of a shut door and of a half open one, with
/// their reference light.
struct DoorScene {
    level: TriangleMesh,
    lights: Vec<meshless_gi::Light>,
    poses: [Vec<Vec<Option<Pixel>>>; 2],
}

/// The door, turned around its hinge.
fn door(angle: f32) -> TriangleMesh {
    let hinge = DOOR_CENTER - DOOR_HALF_SIZE.z * Vec3::Z;
    let turn = Quat::from_rotation_y(angle);
    let position = |corner: Vec3| hinge + turn * (DOOR_CENTER + DOOR_HALF_SIZE * corner - hinge);
    let quads: Vec<Quad> = (0..6)
        .map(|k| {
            let axes = [Vec3::X, Vec3::Y, Vec3::Z];
            let (w, u, v) = (axes[k / 2], axes[(k / 2 + 1) % 3], axes[(k / 2 + 2) % 3]);
            let (w, u) = if k % 2 == 0 { (w, u) } else { (-w, -u) };
            let corners = [w - u - v, w + u - v, w + u + v, w - u + v];
            Quad {
                corners: corners.map(position),
                material: Material::diffuse(Vec3::splat(0.5)),
            }
        })
        .collect();
    TriangleMesh::from_quads(&quads)
}

fn read() -> (TriangleMesh, Vec<meshless_gi::Light>) {
    open_rooms()
}

fn stage() -> &'static DoorScene {
    static STAGE: OnceLock<DoorScene> = OnceLock::new();
    STAGE.get_or_init(|| {
        let (level, lights) = read();
        let poses = [0.0, -std::f32::consts::FRAC_PI_4].map(|angle| {
            let scene = TriangleMesh::joined(vec![read().0, door(angle)]);
            let view = |(_, eye): &(&str, [f32; 3])| {
                let camera = Camera {
                    eye: Vec3::from(*eye),
                    target: DOOR_CENTER,
                    up: Vec3::Y,
                    vertical_angle: 1.1,
                };
                (0..SIZE[0] * SIZE[1])
                    .into_par_iter()
                    .map(|i| pixel(&scene, level.len(), &lights, &camera, i))
                    .collect()
            };
            VIEWS.iter().map(view).collect()
        });
        DoorScene {
            level,
            lights,
            poses,
        }
    })
}

/// Content of a pixel, and its light after one to four bounces.
fn pixel(
    scene: &TriangleMesh,
    level: usize,
    lights: &[meshless_gi::Light],
    camera: &Camera,
    i: u32,
) -> Option<Pixel> {
    let size = Vec2::new(SIZE[0] as f32, SIZE[1] as f32);
    let at = Vec2::new((i % SIZE[0]) as f32, (i / SIZE[0]) as f32) + 0.5;
    let ray = camera.ray(at / size, size.x / size.y);
    let hit = scene.cast(&ray)?;
    let surface = scene.surface(&ray, &hit);
    let (x, n) = (surface.position, surface.normal);
    let aside = ((x - DOOR_CENTER).abs() - DOOR_HALF_SIZE).max(Vec3::ZERO);
    let part = if hit.primitive as usize >= level {
        Part::Door
    } else if aside.max_element() < MAX_JAMB_DISTANCE {
        Part::Jamb
    } else {
        Part::Far
    };
    let settings = ReferenceSettings {
        paths: if part == Part::Far { 64 } else { 512 },
        bounces: Some(4),
        seed: 5,
    };
    let right = irradiance(scene, lights, x, n, u64::from(i), &settings).indirect;
    Some(Pixel { x, n, part, right })
}

/// Returns a bake with an occluder at the door, or without one. `occluder` has half of the
/// thickness, and the offset of its center from the door's.
fn baked(occluder: Option<(f32, f32)>) -> BakedScene {
    let shape = |(half, off): (f32, f32)| OccluderDesc {
        name: "door".into(),
        boxes: vec![OccluderBox {
            center: (DOOR_CENTER + off * Vec3::X).to_array(),
            half_edges: [half, DOOR_HALF_SIZE.y, DOOR_HALF_SIZE.z],
        }],
    };
    let recipe = Recipe {
        preset: Preset::Draft,
        viewpoints: vec![[2.0, 1.3, 1.8], [6.0, 1.3, 1.8]],
        rays_per_point: Some(128),
        max_refinement_points: Some(4000),
        probes: Some(ProbeSettings::default()),
        occluders: occluder.map(shape).into_iter().collect(),
        ..Recipe::default()
    };
    let baked = bake_scene(&stage().level, &recipe, 0, &Progress::default());
    baked.expect("a bake").scene
}

fn solved(scene: &BakedScene, transmittance: f32) -> CpuFrame {
    let mut frame = CpuFrame::new(scene);
    let lights = stage().lights.iter();
    let lights: Vec<FrameLight> = lights.flat_map(|l| FrameLight::expand(l, 1)).collect();
    frame.set_lights(scene, &lights);
    frame.set_occluders(scene, &[transmittance]);
    frame.solve(scene, &FrameSettings::bounces(4));
    frame
}

/// Light of a frame at a pixel.
fn pixel_irradiance(frame: &CpuFrame, scene: &BakedScene, x: Vec3, n: Vec3) -> Vec3 {
    let space = || frame.probe_irradiance(scene, x, n).map(|l| l.irradiance(n));
    let found = splat_covered(
        &scene.data().points,
        &scene.data().display,
        frame.vector_irradiance(),
        x,
        n,
    );
    let found = found.map(|(e, cover)| {
        (
            e.dot(n).max(Vec3::ZERO),
            surface_fraction(cover, FULL_COVER),
        )
    });
    match found {
        Some((e, share)) if share < 1.0 => space().map_or(e, |space| space.lerp(e, share)),
        Some((e, _)) => e,
        None => space().unwrap_or_default(),
    }
}

/// Error of a view's pixels against the reference.
#[derive(Clone, Copy, Debug)]
struct DisplayErrors {
    /// Root mean square of the error of the door's pixels over that of their light.
    nrmse: f32,
    /// Pixels of door, jambs and floor with less than half of their light, if that light is more
    /// than 5 % of the root mean square.
    dark: usize,
    /// The brightest of them.
    brightest: f32,
    /// Root mean square of the door's reference light.
    rms: f32,
    pixels: [usize; 2],
}

fn rms(values: impl Iterator<Item = Vec3>) -> f32 {
    let (sum, count) = values.fold((0.0, 0), |(s, c), v| (s + v.length_squared(), c + 3));
    (sum / count.max(1) as f32).sqrt()
}

fn compare(
    name: &str,
    pixels: &[Option<Pixel>],
    frame: &CpuFrame,
    scene: &BakedScene,
) -> DisplayErrors {
    let at = |p: &Pixel| pixel_irradiance(frame, scene, p.x, p.n);
    let own: Vec<Option<Vec3>> = pixels.par_iter().map(|p| p.as_ref().map(at)).collect();
    save_images(name, pixels, &own);
    let all = pixels.iter().zip(&own);
    let all: Vec<(Pixel, Vec3)> = all.filter_map(|(p, e)| Some(((*p)?, (*e)?))).collect();
    let of = |part: Part| all.iter().filter(move |(p, _)| p.part == part);
    let bright = rms(of(Part::Door).map(|(p, _)| p.right));
    let near = || all.iter().filter(|(p, _)| p.part != Part::Far);
    let dark = near().filter(|(p, e)| {
        let right = p.right.element_sum() / 3.0;
        right > 0.05 * bright && e.element_sum() / 3.0 < 0.5 * right
    });
    DisplayErrors {
        nrmse: rms(of(Part::Door).map(|(p, e)| *e - p.right)) / bright.max(f32::MIN_POSITIVE),
        dark: dark.count(),
        brightest: near().fold(0.0, |a, (_, e)| a.max(e.max_element())),
        rms: bright,
        pixels: [of(Part::Door).count(), of(Part::Jamb).count()],
    }
}

/// Writes the result next to the reference if `MGI_TEST_PICTURES` names a folder.
fn save_images(name: &str, pixels: &[Option<Pixel>], own: &[Option<Vec3>]) {
    let Some(folder) = std::env::var_os("MGI_TEST_PICTURES") else {
        return;
    };
    let right = pixels.iter().map(|p| p.map(|p| p.right));
    let right: Vec<Option<Vec3>> = right.collect();
    let (wide, zoom) = (SIZE[0] as usize, 8);
    let byte = |v: f32| (255.0 * (0.25 * v).clamp(0.0, 1.0).powf(1.0 / 2.2)) as u8;
    let mut bytes = Vec::new();
    for y in 0..SIZE[1] as usize * zoom {
        for x in 0..2 * wide * zoom {
            let (x, y) = (x / zoom, y / zoom);
            let from = if x < wide { own } else { &right };
            let light = from[y * wide + x % wide].unwrap_or_default();
            bytes.extend(light.to_array().map(byte));
        }
    }
    let path = Path::new(&folder).join(format!("{}.png", name.replace(", ", "_")));
    let (wide, high) = ((2 * wide * zoom) as u32, SIZE[1] * zoom as u32);
    image::save_buffer(path, &bytes, wide, high, image::ExtendedColorType::Rgb8).unwrap();
}

/// Light through a closed door and through a half open one.
const TRANSMITTANCES: [(&str, f32); 2] = [("shut", 0.0), ("half open", 0.5)];

/// The error of each view, and that nothing of the lit room's light is behind a shut door.
fn check(name: &str, scene: &BakedScene, near_too: bool) {
    let stage = stage();
    for (pose, (how, transmittance)) in TRANSMITTANCES.into_iter().enumerate() {
        let frame = solved(scene, transmittance);
        let mut lit = 0.0;
        for ((view, _), pixels) in VIEWS.iter().zip(&stage.poses[pose]) {
            let name = format!("{name}, {how}, {view}");
            let found = compare(&name, pixels, &frame, scene);
            println!("{name}: {found:.3?}");
            assert!(found.pixels.iter().all(|&n| n > 90), "{found:?}");
            if *view != "behind" {
                lit = found.rms;
                assert!(found.nrmse <= 0.15, "{name}: {found:?}");
                assert!(!near_too || found.dark == 0, "{name}: {found:?}");
            } else if transmittance == 0.0 && scene.data().occluders.is_some() {
                assert!(found.brightest <= 1e-5 * lit, "{name}: {found:?}");
            }
        }
    }
}

#[test]
fn door_in_any_box_matches_reference() {
    for (name, half) in BOXES {
        check(name, &baked(Some((half, 0.0))), true);
    }
}

#[test]
fn door_without_occluder_matches_reference() {
    check("none", &baked(None), true);
}

/// The box's middle lies before the door, where planes that do not lean would have the door lit
/// from behind.
#[test]
fn door_in_far_half_of_box_is_lit_from_faced_side() {
    let scene = baked(Some((0.06, -0.04)));
    check("off the middle", &scene, false);
    let mut upright = scene.clone();
    let arrays = upright.data_mut();
    let probes = &mut arrays.probes.as_mut().unwrap().planes;
    for plane in probes.iter_mut().chain(&mut arrays.display.planes) {
        let length = Vec3::from_slice(&plane[..3]).length();
        *plane = plane.map(|c| c / length);
    }
    let pixels = &stage().poses[0][0];
    let found = compare("upright", pixels, &solved(&upright, 0.0), &upright);
    assert!(found.nrmse > 0.3, "{found:?}");
}

/// Forward cameras read next to a closed door the light of their own room.
#[test]
fn volume_at_closed_door_has_light_of_its_side() {
    let scene = baked(Some((0.06, 0.0)));
    let frame = solved(&scene, 0.0);
    let [low, high] = scene.info().bounds.map(Vec3::from);
    let (low, high) = (low - 0.15, high + 0.15);
    let size = voxels_of(high - low, 0.15, u32::MAX);
    let shape = VoxelGrid::new([low, high], size).unwrap();
    let weights = VoxelWeights::from_scene(shape, scene.data());
    let params = VolumeParams::new(&shape, &Mat4::IDENTITY);
    let values = VolumeValues {
        points: frame.vector_irradiance(),
        probes: frame.probes(),
    };
    let texels = volume_texels(&params, &weights, values);
    let read = |p: &Pixel| {
        let position = (p.x - shape.origin()) / shape.voxel();
        std::f32::consts::PI * read_volume(params.size, &texels, position, p.n)
    };
    let of = |view: usize| stage().poses[0][view].iter().flatten();
    let doors = || of(0).filter(|p| p.part == Part::Door);
    let lit = rms(doors().map(|p| p.right));
    let error = rms(doors().map(|p| read(p) - p.right)) / lit;
    let behind = of(2).filter(|p| p.part != Part::Far);
    let brightest = behind.fold(0.0f32, |a, p| a.max(read(p).max_element()));
    println!(
        "volume: NRMSE {error:.3} before the door, {:.1e} behind it",
        brightest / lit
    );
    assert!(error <= 0.15, "{error}");
    assert!(brightest <= 1e-3 * lit, "{brightest} of {lit}");
}

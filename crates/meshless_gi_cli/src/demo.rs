//! `demo`: the main job with no file and no GPU. Bakes the built-in Cornell box and shows it under
//! a lamp at three places: direct light only, with indirect light as a frame computes it, and by
//! the reference integrator.

use super::error::ToolError;
use super::output::{self, count};
use super::picture::{self, View};
use super::progress;
use super::{bake, scatter};
use glam::Vec3;
use meshless_gi::internals::asset::{check_writable, write_file};
use meshless_gi::internals::eval::irradiance_at_all;
use meshless_gi::internals::scene::{PlyEncoding, statue_room};
use meshless_gi::{
    Baked, BakedScene, CpuFrame, FrameLight, FrameSettings, Geometry, Light, Preset, Recipe,
    ReferenceSettings, TriangleMesh, bake_scene, cornell_box, mesh_of_quads,
};
use meshless_gi_lab::accuracy::Camera;
use rayon::prelude::*;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// The statue's points are no nearer to each other than this, meters.
const SPACING: f32 = 0.02;
/// Patches that the lamp counts for in a frame.
const PATCHES: u32 = 64;
/// Diffuse reflections of a frame; the reference has all.
const BOUNCES: u32 = 12;

/// How much care a demo takes.
struct Effort {
    /// Pixels along each side of a picture.
    size: u32,
    /// Rays that the bake casts for each of its points.
    rays: u32,
    /// Paths of the reference for each of the samples of a pixel, in two halves that know nothing
    /// of each other.
    paths: u32,
}

/// For triangles.
const TRIANGLES: Effort = Effort {
    size: 256,
    rays: 1024,
    paths: 40,
};
/// For the statue: rays among a hundred thousand cells cost several times those in an empty room.
const POINTS: Effort = Effort {
    size: 192,
    rays: 512,
    paths: 16,
};

#[derive(clap::Args)]
pub struct Args {
    /// Folder for the pictures, the bake and the table.
    #[arg(short, long, value_name = "DIR", default_value = "out/demo")]
    output: PathBuf,
    /// Bake a point cloud instead: a statue in the Cornell box, all of it points; they are written
    /// as statue.ply.
    #[arg(long)]
    points: bool,
}

/// The lamp at one place.
struct Place {
    name: &'static str,
    lamp: Light,
}

/// One row of the table.
struct Row {
    name: &'static str,
    /// Projection and solve on the CPU, seconds.
    frame: f64,
    reference: f64,
    nrmse: f64,
}

pub fn run(args: &Args) -> Result<(), ToolError> {
    let began = Instant::now();
    let folder = &args.output;
    std::fs::create_dir_all(folder).map_err(|why| ToolError::write(folder, &why))?;
    let composed = folder.join("demo.png");
    check_writable(&composed).map_err(|why| ToolError::write(&composed, &why))?;

    let (name, effort, mesh) = match args.points {
        true => ("statue", POINTS, statue(&folder.join("statue.ply"))?),
        false => ("cornell", TRIANGLES, mesh_of_quads(&cornell_box())),
    };
    let size = effort.size;
    let recipe = recipe(effort.rays);
    let Baked { scene, mut stats } =
        progress::watch(|progress| bake_scene(&mesh, &recipe, 0, progress))
            .map_err(|why| ToolError::Input(format!("the Cornell box: {why}")))?;
    let file = folder.join(format!("{name}.mgi"));
    stats.bytes = scene
        .write(&file)
        .map_err(|why| ToolError::asset(&file, &why))?;

    let camera = Camera {
        eye: Vec3::new(0.0, 1.0, 3.75),
        target: Vec3::new(0.0, 1.0, 0.0),
        up: Vec3::Y,
        vertical_angle: 42f32.to_radians(),
    };
    let view = View::new(&mesh, &camera, size);
    let mut rows = Vec::new();
    let mut all = Vec::new();
    for (i, place) in places().iter().enumerate() {
        let step = progress::Step::new(format!("lamp {} of 3: {}", i + 1, place.name));
        let (row, pictures) = show(&scene, &mesh, &view, place, effort.paths);
        drop(step);
        for (kind, pixels) in ["direct", "indirect", "reference"].iter().zip(&pictures) {
            let path = folder.join(format!("lamp{}_{kind}.png", i + 1));
            save(&path, size, size, pixels)?;
        }
        rows.push(row);
        all.push(pictures);
    }
    let (side, pixels) = picture::grid(&all, size);
    save(&composed, side, side, &pixels)?;

    let mut text = format!(
        "{}, {} triangles: baked in {:.1} s on {} threads, {} points, {} links, {} bytes, estimated error {}\n\n",
        match args.points {
            true => "Statue of points",
            false => "Cornell box",
        },
        count(stats.triangles),
        stats.seconds.total,
        stats.threads,
        count(stats.points_per_level.iter().sum()),
        count(stats.links),
        count(stats.bytes),
        output::error(stats.estimated_nrmse, stats.estimated_nrmse_interval),
    );
    text += "| lamp | frame on the CPU, s | reference, s | NRMSE of indirect light |\n|---|---|---|---|\n";
    for row in &rows {
        text += &format!(
            "| {} | {:.3} | {:.1} | {:.1} % |\n",
            row.name,
            row.frame,
            row.reference,
            100.0 * row.nrmse
        );
    }
    let table = folder.join("demo.md");
    write_file(&table, text.as_bytes()).map_err(|why| ToolError::write(&table, &why))?;
    output::print(&format!(
        "{text}\n{} ({:.1} s in all). Rows: the lamp's places; columns: direct light, with indirect light, reference.\n",
        composed.display(),
        began.elapsed().as_secs_f64()
    ))
}

/// The statue's room as the cells of scattered points, which are written to a file and read from
/// it.
fn statue(file: &Path) -> Result<TriangleMesh, ToolError> {
    let step = progress::Step::new("scattering points");
    scatter::write(&statue_room(), SPACING, 1, PlyEncoding::LittleEndian, file)?;
    drop(step);
    bake::load(file, &[])
}

/// Few points, for a quick bake, but many rays and a tight bound for them.
fn recipe(rays: u32) -> Recipe {
    Recipe {
        preset: Preset::Draft,
        rays: Some(rays),
        epsilon: Some(0.02),
        ..Recipe::default()
    }
}

/// A small square lamp: under the ceiling, turned to the red wall, and low on the right.
fn places() -> [Place; 3] {
    let lamp = |name, center: Vec3, toward: Vec3, power: f32| {
        let (u, v) = toward.normalize().any_orthonormal_pair();
        let half = 0.14;
        // u × v goes where the lamp shines.
        Place {
            name,
            lamp: Light::Rect {
                center,
                u: u * half,
                v: v * half,
                radiance: Vec3::new(1.0, 0.9, 0.75) * power,
            },
        }
    };
    [
        lamp(
            "under the ceiling",
            Vec3::new(0.0, 1.95, 0.1),
            Vec3::NEG_Y,
            40.0,
        ),
        lamp(
            "turned to the red wall",
            Vec3::new(0.45, 1.7, 0.55),
            Vec3::new(-1.0, -0.45, -0.5),
            40.0,
        ),
        lamp(
            "low, turned to the green wall",
            Vec3::new(-0.1, 0.75, 0.75),
            Vec3::new(1.0, 0.1, -0.45),
            40.0,
        ),
    ]
}

/// The pictures of one place of the lamp: direct light only, with indirect light, reference.
fn show(
    scene: &BakedScene,
    mesh: &TriangleMesh,
    view: &View,
    place: &Place,
    paths: u32,
) -> (Row, [Vec<[u8; 3]>; 3]) {
    let began = Instant::now();
    let mut frame = CpuFrame::new(scene);
    frame.set_lights(scene, &FrameLight::expand(&place.lamp, PATCHES));
    frame.solve(scene, &FrameSettings::bounces(BOUNCES));
    let seconds = began.elapsed().as_secs_f64();
    let direct: Vec<Vec3> = view.evaluate(|s| {
        let above = s.position + s.normal * mesh.roughness(s.position);
        frame.direct(scene, above, s.normal)
    });
    let indirect: Vec<Vec3> = view.evaluate(|s| {
        frame
            .irradiance(scene, s.position, s.normal)
            .unwrap_or_default()
    });

    let began = Instant::now();
    let places: Vec<(Vec3, Vec3)> = view.samples().map(|s| (s.position, s.normal)).collect();
    let [one, other] = [1, 2].map(|seed| {
        let settings = ReferenceSettings {
            paths: paths / 2,
            bounces: None,
            seed,
        };
        irradiance_at_all(mesh, &[place.lamp], &places, &settings)
    });
    let reference: Vec<Vec3> = one
        .par_iter()
        .zip(&other)
        .map(|(a, b)| 0.5 * (a.direct + a.indirect + b.direct + b.indirect))
        .collect();
    let row = Row {
        name: place.name,
        frame: seconds,
        reference: began.elapsed().as_secs_f64(),
        nrmse: nrmse(&indirect, |i| one[i].indirect, |i| other[i].indirect),
    };

    let both: Vec<Vec3> = direct.iter().zip(&indirect).map(|(d, i)| *d + *i).collect();
    let pictures = [&direct, &both, &reference].map(|e| view.develop(e));
    let exposure = picture::exposure(&pictures[1]);
    (row, pictures.map(|p| picture::tone_map(&p, exposure)))
}

/// ‖x − reference‖ / ‖reference‖, of two references with independent noise: in products of the one
/// with the other it cancels.
fn nrmse(values: &[Vec3], one: impl Fn(usize) -> Vec3, other: impl Fn(usize) -> Vec3) -> f64 {
    let (mut square, mut power) = (0.0f64, 0.0f64);
    for (i, x) in values.iter().enumerate() {
        square += f64::from((*x - one(i)).dot(*x - other(i)));
        power += f64::from(one(i).dot(other(i)));
    }
    (square.max(0.0) / power).sqrt()
}

fn save(path: &Path, width: u32, height: u32, pixels: &[[u8; 3]]) -> Result<(), ToolError> {
    let bytes = picture::png(width, height, pixels).map_err(|why| ToolError::write(path, &why))?;
    write_file(path, &bytes).map_err(|why| ToolError::write(path, &why))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn demo_lights_point_at_their_targets() {
        for (place, x) in places().iter().zip([Vec3::ZERO, Vec3::NEG_X, Vec3::X]) {
            let Light::Rect { u, v, .. } = place.lamp else {
                panic!("{:?}", place.lamp);
            };
            let toward = u.cross(v).normalize();
            assert!(
                toward.dot(x) > 0.7 || (x == Vec3::ZERO && toward.y < -0.99),
                "{toward}"
            );
        }
    }

    #[test]
    fn reference_noise_is_not_counted_as_error() {
        let noise = |i: usize, k: usize| ((i * 7919 + k * 104_729) % 1000) as f32 / 500.0 - 1.0;
        let values = vec![Vec3::ONE; 3000];
        let noisy = |k: usize| move |i: usize| Vec3::splat(1.0 + 0.5 * noise(i * i, k + i));
        assert!(nrmse(&values, noisy(1), noisy(500)) < 0.06);
        let off: Vec<Vec3> = values.iter().map(|v| 1.2 * *v).collect();
        let found = nrmse(&off, noisy(1), noisy(500));
        assert!((found - 0.2).abs() < 0.03, "{found}");
    }
}

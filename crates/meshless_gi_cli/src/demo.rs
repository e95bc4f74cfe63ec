//! `demo`: bakes the built-in Cornell box and draws it without a GPU, under three positions of a
//! light: direct light only, with indirect light, and by the reference integrator.

use super::demo_frame::{self, DemoLight};
use super::error::ToolError;
use super::output::{self, count};
use super::picture::{self, View};
use super::{animation, progress, scatter, source};
use glam::Vec3;
use meshless_gi::internals::asset::{check_writable, write_file};
use meshless_gi::internals::scene::{PlyEncoding, statue_room};
use meshless_gi::{BakeStats, Baked, Preset, Quad, Recipe, TriangleMesh, bake_scene};
use meshless_gi_lab::accuracy::Camera;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Minimum distance between points of the statue, in meters.
const SPACING: f32 = 0.02;

/// Sample counts of a demo.
struct SampleCounts {
    /// Edge of a picture, in pixels.
    size: u32,
    /// Gather rays per point.
    rays: u32,
    /// Reference paths per sample of a pixel, in two independent halves.
    paths: u32,
}

/// Sample counts for triangles.
const TRIANGLES: SampleCounts = SampleCounts {
    size: 256,
    rays: 1024,
    paths: 40,
};
/// Sample counts for the statue. Rays among 100 000 cells cost several times more than in a room.
const POINTS: SampleCounts = SampleCounts {
    size: 192,
    rays: 512,
    paths: 16,
};

#[derive(clap::Args)]
pub struct Args {
    /// Folder of the pictures, the bake and the table.
    #[arg(short, long, value_name = "DIR", default_value = "out/demo")]
    output: PathBuf,
    /// Bake a point cloud instead: a statue in the Cornell box. Its points go to statue.ply.
    #[arg(long)]
    points: bool,
    /// Write an animated PNG of a moving light (moving_light.png) instead of the pictures.
    #[arg(long)]
    animation: bool,
}

/// Row of the table.
struct Row {
    name: &'static str,
    /// Seconds of projection and solve on the CPU.
    frame: f64,
    /// Seconds of the reference.
    reference: f64,
    nrmse: f64,
}

pub fn run(args: &Args) -> Result<(), ToolError> {
    let began = Instant::now();
    let folder = &args.output;
    std::fs::create_dir_all(folder).map_err(|error| ToolError::write(folder, &error))?;
    let file = folder.join(match args.animation {
        true => "moving_light.png",
        false => "demo.png",
    });
    check_writable(&file).map_err(|error| ToolError::write(&file, &error))?;

    let (name, counts, mesh) = match args.points {
        true => ("statue", POINTS, statue(&folder.join("statue.ply"))?),
        false => (
            "cornell",
            TRIANGLES,
            TriangleMesh::from_quads(&Quad::cornell_box()),
        ),
    };
    let recipe = recipe(counts.rays);
    let Baked {
        scene, mut stats, ..
    } = progress::watch(|progress| bake_scene(&mesh, &recipe, 0, progress))
        .map_err(|error| ToolError::Input(format!("the Cornell box: {error}")))?;
    let bake = folder.join(format!("{name}.mgi"));
    stats.bytes = scene
        .write(&bake)
        .map_err(|error| ToolError::asset(&bake, &error))?;
    if args.animation {
        let view = View::new(&mesh, &camera(), animation::SIZE);
        let bytes = animation::render(&scene, &mesh, &view)
            .map_err(|error| ToolError::write(&file, &error))?;
        write_file(&file, &bytes).map_err(|error| ToolError::write(&file, &error))?;
        return output::print(&format!(
            "{}, {} ({:.1} s)\n",
            file.display(),
            output::bytes(bytes.len() as u64),
            began.elapsed().as_secs_f64()
        ));
    }

    let size = counts.size;
    let view = View::new(&mesh, &camera(), size);
    let mut rows = Vec::new();
    let mut grid = Vec::new();
    for (i, light) in lights().iter().enumerate() {
        let step = progress::Step::new(format!("light {} of 3: {}", i + 1, light.name));
        let frame = demo_frame::compute(&scene, &mesh, &view, light);
        let reference = demo_frame::reference(&mesh, &view, light, counts.paths);
        drop(step);
        rows.push(Row {
            name: light.name,
            frame: frame.seconds,
            reference: reference.seconds,
            nrmse: reference.nrmse(&frame.indirect),
        });
        let pictures = [&frame.direct, &frame.total(), &reference.total()].map(|e| view.develop(e));
        let exposure = picture::exposure(&pictures[1]);
        let pictures = pictures.map(|p| picture::tone_map(&p, exposure));
        for (kind, pixels) in ["direct", "indirect", "reference"].iter().zip(&pictures) {
            save(
                &folder.join(format!("light{}_{kind}.png", i + 1)),
                size,
                size,
                pixels,
            )?;
        }
        grid.push(pictures);
    }
    let (edge, pixels) = picture::grid(&grid, size);
    save(&file, edge, edge, &pixels)?;

    let text = table(args.points, &stats, &rows);
    let path = folder.join("demo.md");
    write_file(&path, text.as_bytes()).map_err(|error| ToolError::write(&path, &error))?;
    output::print(&format!(
        "{text}\n{} ({:.1} s in total). Rows: positions of the light; columns: direct light, with indirect light, reference.\n",
        file.display(),
        began.elapsed().as_secs_f64()
    ))
}

/// Returns the figures of the bake and of each light as Markdown.
fn table(points: bool, stats: &BakeStats, rows: &[Row]) -> String {
    let mut text = format!(
        "{}, {} triangles: baked in {:.1} s on {} threads, {} points, {} links, {} bytes, estimated error {}\n\n",
        match points {
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
    text += "| light | frame on the CPU, s | reference, s | NRMSE of indirect light |\n|---|---|---|---|\n";
    for row in rows {
        text += &format!(
            "| {} | {:.3} | {:.1} | {:.1} % |\n",
            row.name,
            row.frame,
            row.reference,
            100.0 * row.nrmse
        );
    }
    text
}

fn camera() -> Camera {
    Camera {
        eye: Vec3::new(0.0, 1.0, 3.75),
        target: Vec3::new(0.0, 1.0, 0.0),
        up: Vec3::Y,
        vertical_angle: 42f32.to_radians(),
    }
}

/// Scatters the points of the statue's room, writes them to `file` and reads them as cells.
fn statue(file: &Path) -> Result<TriangleMesh, ToolError> {
    let step = progress::Step::new("scattering points");
    scatter::write(&statue_room(), SPACING, 1, PlyEncoding::LittleEndian, file)?;
    drop(step);
    source::load(file, &[])
}

/// Returns a recipe with few points for a quick bake, but many rays and a low truncation error.
fn recipe(rays: u32) -> Recipe {
    Recipe {
        preset: Preset::Draft,
        rays_per_point: Some(rays),
        truncation_error: Some(0.02),
        ..Recipe::default()
    }
}

/// Returns the lights: under the ceiling, facing the red wall, and low, facing the green wall.
fn lights() -> [DemoLight; 3] {
    [
        DemoLight::new("under the ceiling", Vec3::new(0.0, 1.95, 0.1), Vec3::NEG_Y),
        DemoLight::new(
            "facing the red wall",
            Vec3::new(0.45, 1.7, 0.55),
            Vec3::new(-1.0, -0.45, -0.5),
        ),
        DemoLight::new(
            "low, facing the green wall",
            Vec3::new(-0.1, 0.75, 0.75),
            Vec3::new(1.0, 0.1, -0.45),
        ),
    ]
}

fn save(path: &Path, width: u32, height: u32, pixels: &[[u8; 3]]) -> Result<(), ToolError> {
    let bytes =
        picture::png(width, height, pixels).map_err(|error| ToolError::write(path, &error))?;
    write_file(path, &bytes).map_err(|error| ToolError::write(path, &error))
}

#[cfg(test)]
mod tests {
    use super::*;
    use meshless_gi::Light;

    #[test]
    fn demo_lights_point_at_their_targets() {
        for (light, x) in lights().iter().zip([Vec3::ZERO, Vec3::NEG_X, Vec3::X]) {
            let Light::Rect { u, v, .. } = light.light else {
                panic!("{:?}", light.light);
            };
            let toward = u.cross(v).normalize();
            assert!(
                toward.dot(x) > 0.7 || (x == Vec3::ZERO && toward.y < -0.99),
                "{toward}"
            );
        }
    }
}

//! Pictures of the scene as represented by each basis, by the project's renderer on the CPU.

use super::{Experiment, SHOWN_SPACING, slug};
use glam::{DVec3, Vec3};
use meshless_gi_lab::accuracy::{Basis, Camera, Image, exact_samples, render};
use std::error::Error;
use std::path::Path;

/// Width and height of a picture, in pixels.
const SIZE: (u32, u32) = (400, 300);
/// Number of rays per pixel.
const SAMPLES: u32 = 8;
/// Radiosity that is displayed white, in W/m²: of all light, of reflected light.
const WHITE: [f32; 2] = [0.9, 0.6];

/// Camera at a low position, from which the sphere is visible from below.
const CAMERA: Camera = Camera {
    eye: Vec3::new(0.0, 14.0, 46.0),
    target: Vec3::new(0.0, 11.5, 0.0),
    up: Vec3::Y,
    vertical_angle: 0.62,
};

/// Writes the pictures at one density: `total_BASIS.png`, `reflected_BASIS.png`, and
/// `…_solution.png`.
pub fn write(made: &Experiment) -> Result<(), Box<dyn Error>> {
    let folder = made.folder.join("v11");
    let shown = made.sets.iter().find(|set| set.spacing == SHOWN_SPACING);
    let set = shown.ok_or("no point set of the shown density")?;
    let solution = &made.solution;
    let truth = |x: Vec3, _: Vec3| {
        let site = solution.scene.site(x);
        Some(DVec3::new(
            solution.total(site),
            solution.indirect(site),
            0.0,
        ))
    };
    pair(made, &folder, "solution", &truth)?;
    for basis in Basis::ALL {
        let built = set.build(basis)?;
        let samples = exact_samples(solution, &set.points(basis), 1);
        let field = built.fit(&samples)?;
        pair(made, &folder, slug(basis), &*field)?;
    }
    Ok(())
}

/// Writes the pictures of all light and of reflected light.
fn pair(
    made: &Experiment,
    folder: &Path,
    name: &str,
    field: &(dyn Fn(Vec3, Vec3) -> Option<DVec3> + Sync),
) -> Result<(), Box<dyn Error>> {
    let geometry = made.solution.scene.geometry();
    for (channel, what) in ["total", "reflected"].into_iter().enumerate() {
        let picture: Image = render(
            &geometry,
            &CAMERA,
            SIZE,
            SAMPLES,
            // Positions without a value are magenta, to differ from dark ones.
            &|_, seen, _| match field(seen.position, seen.normal) {
                Some(v) => Vec3::splat((v[channel] as f32 / WHITE[channel]).clamp(0.0, 1.0)),
                None => Vec3::new(1.0, 0.0, 1.0),
            },
            &|_| Vec3::new(0.02, 0.03, 0.06),
        );
        let path = folder.join(format!("{what}_{name}.png"));
        let bytes = picture.to_srgb8(1.0);
        image::save_buffer(
            path,
            &bytes,
            picture.width,
            picture.height,
            image::ExtendedColorType::Rgb8,
        )?;
    }
    Ok(())
}

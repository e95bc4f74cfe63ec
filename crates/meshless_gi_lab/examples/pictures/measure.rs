//! Measurements and pictures of one scene.

use super::cache::Cache;
use meshless_gi::Preset;
use meshless_gi_lab::accuracy::{Image, VisibleErrors, visible_errors};
use meshless_gi_lab::fixtures::TestScene;
use meshless_gi_lab::pictures::{
    DisplayedLight, ReferencePoint, Strip, ViewReferenceSize, surface_reference, view_reference,
};
use std::error::Error;
use std::path::Path;

/// Errors of one bake at the points of one reference.
pub struct Row {
    pub preset: Preset,
    /// Name of the reference: a view or the surface.
    pub set: String,
    pub errors: VisibleErrors,
    /// The ten points of largest error, and the bake's irradiance there.
    pub worst: Vec<(ReferencePoint, glam::Vec3)>,
}

/// Measurements of one scene.
pub struct Measured {
    pub name: String,
    pub triangles: usize,
    /// Size of the file at each preset, bytes.
    pub bytes: Vec<(Preset, u64)>,
    pub rows: Vec<Row>,
}

/// Measures the bakes of a scene and writes a picture of each view.
pub fn measure(
    scene: &TestScene,
    presets: &[Preset],
    size: &ViewReferenceSize,
    cache: &Cache,
    folder: &Path,
) -> Result<Measured, Box<dyn Error>> {
    let mut sets = Vec::new();
    for k in 0..scene.views.len() {
        let name = format!("view {}", k + 1);
        let points = cache.reference(scene, &format!("view{}", k + 1), size, || {
            view_reference(scene, k, size)
        })?;
        sets.push((name, points));
    }
    let surface = cache.reference(scene, "surface", size, || surface_reference(scene, size))?;
    sets.push(("surface".into(), surface));
    let views = &sets[..scene.views.len()];
    let mut strips: Vec<Strip> = views
        .iter()
        .map(|(_, p)| Strip::new(size.view, p))
        .collect();
    let mut out = Measured {
        name: scene.name.clone(),
        triangles: scene.mesh.len(),
        bytes: Vec::new(),
        rows: Vec::new(),
    };
    for &preset in presets {
        let (baked, bytes) = cache.bake(scene, preset)?;
        out.bytes.push((preset, bytes));
        let light = DisplayedLight::new(&baked, &scene.lights);
        for (k, (set, points)) in sets.iter().enumerate() {
            let values = light.at(points);
            if let Some(strip) = strips.get_mut(k) {
                strip.add(points, &values);
            }
            out.rows.push(row(preset, set, points, &values));
        }
    }
    for (k, strip) in strips.iter().enumerate() {
        let path = folder.join(format!("{}_{}.png", scene.name, k + 1));
        save(&strip.picture(), &path)?;
    }
    Ok(out)
}

fn row(preset: Preset, set: &str, points: &[ReferencePoint], values: &[glam::Vec3]) -> Row {
    let reference: Vec<_> = points.iter().map(|p| p.irradiance).collect();
    let standard_errors: Vec<_> = points.iter().map(|p| p.standard_error).collect();
    let errors = visible_errors(values, &reference, &standard_errors);
    let worst = errors
        .worst
        .iter()
        .map(|&i| (points[i], values[i]))
        .collect();
    let row = Row {
        preset,
        set: set.into(),
        errors,
        worst,
    };
    eprintln!(
        "{preset:?}, {set}: {:.2} % wrong, NRMSE {:.1} %, without worst {:.1} %",
        100.0 * row.errors.wrong_fraction,
        100.0 * row.errors.nrmse,
        100.0 * row.errors.nrmse_without_worst
    );
    row
}

fn save(image: &Image, path: &Path) -> Result<(), Box<dyn Error>> {
    let bytes = image.to_srgb8(1.0);
    let color = image::ExtendedColorType::Rgb8;
    image::save_buffer(path, &bytes, image.width, image.height, color)?;
    Ok(())
}

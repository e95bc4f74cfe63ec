//! Recipes and scene files.

use super::error::ToolError;
use super::{input, output, progress};
use glam::Vec3;
use meshless_gi::internals::scene::load_geometry_within;
use meshless_gi::{LoadedScene, Recipe, RecipeError, TriangleMesh};
use std::path::{Path, PathBuf};

/// Returns the recipe and the path of the scene file. `path` is a scene or a recipe that names one.
/// `recipe_file` is the value of `--recipe`.
pub fn recipe_and_scene(
    path: &Path,
    recipe_file: Option<&Path>,
) -> Result<(Recipe, PathBuf), ToolError> {
    let is_recipe = has_extension_ron(path);
    let recipe_file = match (is_recipe, recipe_file) {
        (true, Some(_)) => {
            return Err(ToolError::Usage(format!(
                "{} is a recipe already; remove --recipe",
                path.display()
            )));
        }
        (true, None) => Some(path),
        (false, file) => file,
    };
    let recipe = match recipe_file {
        Some(file) => read_recipe(file)?,
        None => Recipe::default(),
    };
    let scene = match (is_recipe, &recipe.scene) {
        (false, _) => path.to_path_buf(),
        (true, Some(scene)) => path.parent().unwrap_or(Path::new("")).join(scene),
        (true, None) => {
            return Err(ToolError::input(
                path,
                &"the recipe names no scene; add `scene: \"level.glb\"`",
            ));
        }
    };
    if has_extension_ron(&scene) {
        return Err(ToolError::input(
            path,
            &format!(
                "`scene` is the recipe {}; name a scene file",
                scene.display()
            ),
        ));
    }
    // Invalid values of a file are invalid input, those of the command line are wrong usage.
    if let Some(file) = recipe_file {
        check(&recipe).map_err(|error| ToolError::input(file, &error))?;
    }
    Ok((recipe, scene))
}

fn has_extension_ron(path: &Path) -> bool {
    path.to_string_lossy().to_lowercase().ends_with(".ron")
}

fn read_recipe(path: &Path) -> Result<Recipe, ToolError> {
    let text = String::from_utf8(input::bytes(path)?)
        .map_err(|_| ToolError::input(path, &"the recipe is not UTF-8 text"))?;
    Recipe::from_ron(&text).map_err(|error| ToolError::input(path, &error))
}

/// Checks each value of a recipe and their combination, for a scene of any size.
pub fn check(recipe: &Recipe) -> Result<(), RecipeError> {
    recipe.settings(1.0).map(|_| ())
}

/// Reads a scene file and prints notes on the parts that were changed or left out. Points without
/// normals face the `viewpoints`.
pub fn load(path: &Path, viewpoints: &[[f32; 3]]) -> Result<TriangleMesh, ToolError> {
    let step = progress::Step::new(format!("reading {}", path.display()));
    let viewpoints: Vec<Vec3> = viewpoints.iter().map(|&v| v.into()).collect();
    let LoadedScene {
        mesh,
        points,
        problems,
        notes,
        ..
    } = load_geometry_within(path, &viewpoints, &mut input::budget())?;
    drop(step);
    if points > 0 {
        output::note(&format!(
            "{} points; their cells are {} triangles",
            output::count(points),
            output::count(mesh.len() as u64)
        ));
    }
    for note in &notes {
        output::note(note);
    }
    for (count, problem) in [
        (
            problems.dropped(),
            "triangles without area or without finite coordinates: left out",
        ),
        (
            problems.albedo_clamped,
            "materials: albedo above 1 clamped to 1",
        ),
        (
            problems.bad_emission,
            "materials: emission not finite, negative or too large; set to 0 or clamped",
        ),
        (problems.bad_texture, "materials: missing textures ignored"),
    ] {
        if count > 0 {
            output::note(&format!("{} {problem}", output::count(count)));
        }
    }
    Ok(mesh)
}

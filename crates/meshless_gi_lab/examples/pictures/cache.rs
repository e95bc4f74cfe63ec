//! References and bakes of earlier runs.

use bytemuck::{Pod, Zeroable};
use meshless_gi::{BakedScene, Limits, Preset, Progress, Recipe, bake_scene};
use meshless_gi_lab::fixtures::TestScene;
use meshless_gi_lab::pictures::{ReferencePoint, ViewReferenceSize};
use std::error::Error;
use std::path::PathBuf;

/// Version of the reference integrator and of the choice of points. Another one makes cached
/// references obsolete.
const REFERENCE_VERSION: u32 = 2;

/// Point of a cached reference.
#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct CachedPoint {
    pixel: u32,
    vectors: [[f32; 3]; 4],
}

/// Folder of the files.
pub struct Cache {
    folder: PathBuf,
    /// Checksum of this program.
    program: u32,
}

impl Cache {
    pub fn new(folder: PathBuf) -> Result<Self, Box<dyn Error>> {
        std::fs::create_dir_all(&folder)?;
        let program = crc32fast::hash(&std::fs::read(std::env::current_exe()?)?);
        Ok(Self { folder, program })
    }

    /// Reads the reference `set` of a scene, or computes and writes it.
    pub fn reference(
        &self,
        scene: &TestScene,
        set: &str,
        size: &ViewReferenceSize,
        compute: impl FnOnce() -> Vec<ReferencePoint>,
    ) -> Result<Vec<ReferencePoint>, Box<dyn Error>> {
        let key = format!(
            "{REFERENCE_VERSION} {:?} {:?} {:?} {size:?}",
            scene.mesh.content_hash(),
            scene.lights,
            scene.views
        );
        let file = format!(
            "{}_{set}_{:08x}.ref",
            scene.name,
            crc32fast::hash(key.as_bytes())
        );
        let path = self.folder.join(file);
        if let Ok(bytes) = std::fs::read(&path)
            && let Ok(entries) = bytemuck::try_cast_slice::<u8, CachedPoint>(&bytes)
        {
            return Ok(entries.iter().map(to_point).collect());
        }
        eprintln!("{}: reference of {set}", scene.name);
        let points = compute();
        let entries: Vec<CachedPoint> = points.iter().map(to_cached).collect();
        meshless_gi::internals::asset::write_file(&path, bytemuck::cast_slice(&entries))?;
        Ok(points)
    }

    /// Reads the bake of a scene, or computes and writes it. Returns it with the size of its file.
    pub fn bake(
        &self,
        scene: &TestScene,
        preset: Preset,
    ) -> Result<(BakedScene, u64), Box<dyn Error>> {
        let hash = scene.mesh.content_hash();
        let hash = crc32fast::hash(&hash) ^ self.program;
        let path = self
            .folder
            .join(format!("{}_{preset:?}_{hash:08x}.mgi", scene.name));
        if let Ok(file) = std::fs::metadata(&path) {
            return Ok((BakedScene::read(&path, &Limits::default())?, file.len()));
        }
        eprintln!("{}: bake at {preset:?}", scene.name);
        let recipe = Recipe {
            preset,
            ..Recipe::default()
        };
        let baked = bake_scene(&scene.mesh, &recipe, 0, &Progress::default())?;
        let bytes = baked.scene.write(&path)?;
        Ok((baked.scene, bytes))
    }
}

fn to_cached(point: &ReferencePoint) -> CachedPoint {
    let vectors = [
        point.position,
        point.normal,
        point.irradiance,
        point.standard_error,
    ];
    CachedPoint {
        pixel: point.pixel,
        vectors: vectors.map(|v| v.to_array()),
    }
}

fn to_point(entry: &CachedPoint) -> ReferencePoint {
    let [position, normal, irradiance, standard_error] = entry.vectors.map(glam::Vec3::from);
    ReferencePoint {
        pixel: entry.pixel,
        position,
        normal,
        irradiance,
        standard_error,
    }
}

//! Bakes pass validation and round-trip through their file: transport methods, bounce modes, any
//! number of threads.

use glam::Vec3;
use meshless_gi::internals::asset::fingerprint;
use meshless_gi::internals::bake::BAKE_VERSION;
use meshless_gi::{
    BakeInfo, BakeSource, BakedScene, BounceMode, CpuFrame, FrameLight, FrameSettings, Limits,
    Material, Preset, Progress, Recipe, TierInfo, TransportMethod, TriangleMesh, bake,
};

/// Section codes of `docs/FORMAT.md`: the points, and the display's grid.
const POINTS: u32 = 4;
const GRID: [u32; 2] = [15, 16];

/// Returns the codes in the section table of a file: 40 bytes per section, after a header of 32
/// bytes.
fn section_codes(file: &[u8]) -> Vec<u32> {
    let word = |at: usize| u32::from_le_bytes(file[at..at + 4].try_into().unwrap());
    (0..word(12) as usize).map(|i| word(32 + 40 * i)).collect()
}

/// Returns a closed room of 4 by 3 by 3 meters with a wall half-way across it.
fn room() -> TriangleMesh {
    let mut triangles = Vec::new();
    let mut quad = |a: Vec3, u: Vec3, v: Vec3| {
        triangles.push([a, a + u, a + u + v]);
        triangles.push([a, a + u + v, a + v]);
    };
    let (x, y, z) = (Vec3::X * 4.0, Vec3::Y * 3.0, Vec3::Z * 3.0);
    quad(Vec3::ZERO, z, x);
    quad(y, x, z);
    quad(Vec3::ZERO, x, y);
    quad(z, y, x);
    quad(Vec3::ZERO, y, z);
    quad(x, z, y);
    quad(Vec3::X * 2.0, y, z * 0.5);
    TriangleMesh::new(triangles, vec![0; 14], vec![Material::default()])
}

fn baked(recipe: &Recipe, threads: usize) -> BakedScene {
    let mesh = room();
    let source = BakeSource {
        geometry: &mesh,
        bvh: mesh.bvh(),
        primitives: mesh.len() as u64,
        content_hash: mesh.content_hash(),
        occluders: Vec::new(),
    };
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build()
        .unwrap();
    pool.install(|| bake(&source, recipe, &Progress::default()))
        .unwrap()
        .scene
}

/// Returns a recipe that bakes the room quickly.
fn small() -> Recipe {
    Recipe {
        preset: Preset::Draft,
        coarse_radius: Some(0.8),
        levels: Some(3),
        sender_levels: Some(2),
        refinement_levels: Some(0),
        rays_per_point: Some(64),
        truncation_error: Some(0.06),
        receiver_tolerance: Some(0.03),
        ..Recipe::default()
    }
}

/// Stored bakes are identified by the bake version. It must increase with every change of the
/// result for equal input. If this test fails, increase [`BAKE_VERSION`] and copy the new digest.
#[test]
fn bake_of_one_version_has_recorded_hash() {
    let mut scene = baked(&small(), 2);
    // The digest excludes the facts about the bake.
    let tiers = TierInfo::from_scene(scene.data());
    *scene.info_mut() = BakeInfo::default();
    scene.info_mut().tiers = tiers;
    let digest = fingerprint(&[&scene.to_bytes().unwrap()]);
    assert_eq!(
        (BAKE_VERSION, digest.as_str()),
        (
            7,
            "c221bdd715ca202dba8cf60a2221ebb012d26b7f634096a281ae9bcb6970cb92"
        )
    );
}

#[test]
fn bake_file_round_trips() {
    let small = small();
    for recipe in [
        small.clone(),
        Recipe {
            bounce_mode: BounceMode::Baked,
            ..small.clone()
        },
        Recipe {
            transport: TransportMethod::L08,
            ..small.clone()
        },
    ] {
        let scene = baked(&recipe, 2);
        let stats = scene
            .validate()
            .unwrap_or_else(|v| panic!("{:?}: {}", recipe.transport, v[0]));
        assert!(stats.links > 100 && stats.senders > 10, "{stats:?}");
        assert_eq!(
            stats.bounce_links > 0,
            recipe.bounce_mode == BounceMode::Baked
        );
        let bytes = scene.to_bytes().unwrap();
        let back = BakedScene::from_bytes(&bytes, &Limits::default()).unwrap();
        assert!(back == scene);
        // The display's grid is rebuilt from the points, and is not in the file.
        let sections = section_codes(&bytes);
        assert!(sections.contains(&POINTS), "{sections:?}");
        assert!(!sections.iter().any(|s| GRID.contains(s)), "{sections:?}");
        assert!(
            (bytes.len() as u64) < stats.memory,
            "{} of {}",
            bytes.len(),
            stats.memory
        );
        // The frame of the read scene is lit.
        let mut frame = CpuFrame::new(&back);
        frame.set_lights(
            &back,
            &[FrameLight::point(
                Vec3::new(1.0, 2.0, 1.5),
                Vec3::ONE,
                f32::INFINITY,
            )],
        );
        frame.solve(&back, &FrameSettings::bounces(2));
        let e = frame
            .irradiance(&back, Vec3::new(1.0, 0.0, 1.5), Vec3::Y)
            .unwrap();
        assert!(e.min_element() > 0.01, "{e}");
    }
    // Two bakes, on one thread and on two, give the same bytes.
    let bytes = |recipe: &Recipe, threads| baked(recipe, threads).to_bytes().unwrap();
    let two = bytes(&small, 2);
    assert!(bytes(&small, 1) == two);
    // Must fail: another seed gives another bake.
    let other = Recipe {
        seed: 7,
        ..small.clone()
    };
    assert!(bytes(&other, 2) != two);
}

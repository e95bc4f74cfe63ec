//! Moving lights: a light on a smooth path gives light without jumps.

use glam::Vec3;
use meshless_gi::{
    BakedScene, CpuFrame, FrameLight, FrameSettings, Preset, Progress, Quad, Recipe, TriangleMesh,
    bake_scene,
};

fn cornell(samples: u32) -> BakedScene {
    let recipe = Recipe {
        preset: Preset::Draft,
        samples_per_sender: Some(samples),
        ..Recipe::default()
    };
    let mesh = TriangleMesh::from_quads(&Quad::cornell_box());
    bake_scene(&mesh, &recipe, 0, &Progress::default())
        .expect("a bake")
        .scene
}

/// Root mean square of the light's second differences along a light's path of even steps, over its
/// root mean square.
fn roughness(scene: &BakedScene) -> f32 {
    const STEPS: usize = 24;
    let mut frame = CpuFrame::new(scene);
    let seen: Vec<Vec<f32>> = (0..STEPS)
        .map(|k| {
            // Low between the blocks, so that their shadows sweep over walls and floor; 4 mm a
            // step.
            let x = Vec3::new(-0.1 + 0.004 * k as f32, 0.9, 0.75);
            let light_source = FrameLight::point(x, Vec3::ONE, f32::INFINITY);
            frame.set_lights(scene, &[light_source]);
            frame.solve(scene, &FrameSettings::default());
            let pairs = frame.vector_irradiance().iter().zip(&scene.data().points);
            pairs.map(|(e, p)| e.dot(p.n()).y).collect()
        })
        .collect();
    let (mut bends, mut light) = (0.0f64, 0.0f64);
    for three in seen.windows(3) {
        for ((a, b), c) in three[0].iter().zip(&three[1]).zip(&three[2]) {
            bends += f64::from(a - 2.0 * b + c).powi(2);
            light += f64::from(*b).powi(2);
        }
    }
    (bends / light).sqrt() as f32
}

/// Senders that are lit at one position each, as in \[L08\], make a shadow's edge jump from one to
/// the next as the light moves. All light jumps with it.
#[test]
fn smoothly_moving_light_gives_smooth_irradiance() {
    let [one, eight] = [1, 8].map(|samples| roughness(&cornell(samples)));
    eprintln!("second differences: {one:.5} with one sample, {eight:.5} with eight");
    assert!(one > 1e-4, "there is nothing to smooth: {one}");
    assert!(
        eight < 0.5 * one,
        "{one} with one sample, {eight} with eight"
    );
}

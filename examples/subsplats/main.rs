#[path = "../../tests/subsplat_support/mod.rs"]
mod subsplat_support;

use bevy_meshless_gi::asset::{BakedScene, Limits};
use bevy_meshless_gi::bake::{Progress, Recipe, bake_level};
use bevy_meshless_gi::frame::SubsplatSettings;
use subsplat_support::{Level, Stage, clutter};

fn main() {
    let bake = |level: &Level| bake_level(&level.mesh, &Recipe::default(), 0, &Progress::default()).unwrap().scene;
    let mut stages = Vec::new();
    for arg in std::env::args().skip(1) {
        let t = std::time::Instant::now();
        if arg == "clutter" {
            let level = clutter();
            println!("{} triangles", level.mesh.len());
            let path = std::path::Path::new("/tmp/n09/clutter.mgi");
            let scene = if path.exists() { BakedScene::read(path, &Limits::default()).unwrap() } else { let s = bake(&level); s.write(path).unwrap(); s };
            stages.push(Stage::new(level, scene));
        } else {
            let level = Level::read(arg.as_ref()).unwrap().unwrap();
            let scene = if arg.contains("sponza") { BakedScene::read("/tmp/n09/sponza.mgi".as_ref(), &Limits::default()).unwrap() } else { bake(&level) };
            stages.push(Stage::new(level, scene));
        }
        println!("{arg} {:.1} s", t.elapsed().as_secs_f32());
    }
    for stage in &stages {
        for i in 0..3 {
            let t = std::time::Instant::now();
            let view = stage.view(i, [1920, 1080]);
            let tv = t.elapsed().as_secs_f32();
            std::fs::write(format!("/tmp/n09/h_{}_{i}.ppm", stage.level.name), [b"P6 1920 1080 255\n".to_vec(), view.image(&view.full).to_srgb8(1.0)].concat()).unwrap();
            for (light, depth, alike, normal, coarsest) in [
                (0.02, 0.05, 0.35, 1.0, 4),
                (0.03, 0.05, 0.35, 1.0, 4),
                (0.03, 0.05, 0.35, 1.0, 5),
                (0.02, 0.1, 0.35, 1.0, 4),
                (0.02, 0.1, 0.2, 1.0, 4),
                (0.02, 0.05, 0.35, 1.0, 3),
                (0.015, 0.2, 0.2, 1.0, 4),
            ] {
                let settings = SubsplatSettings {
                    light, alike, coarsest,
                    depth: bevy_meshless_gi::frame::DepthTest::Plane(depth),
                    normal: bevy_meshless_gi::frame::NormalTest::MinMax(normal),
                    ..SubsplatSettings::default()
                };
                let m = view.measure(&settings);
                println!("{} {i} light {light} depth {depth} alike {alike} coarsest {coarsest}: 1/{:.2} flip {:.4} nrmse {:.4} {:?}", stage.level.name, 1.0 / m.share(), m.flip, m.nrmse, m.counts.evaluated);
            }
            println!("view {tv:.1} s, all {:.1}", t.elapsed().as_secs_f32());
        }
    }
}

//! Exported irradiance volume in a plain Bevy app without this crate's plugin. Its light matches
//! the light of the plugin's own volume.

use crate::support::app::{
    BOUNCES, app, camera, finish_plugins, headless_plugins, picture, run, target,
};
use crate::support::flip::{Picture, flip};
use crate::support::scenes::{Room, rough_recipe};
use crate::support::stage::{counters, light_source, save_picture, spawn_light_source, view};
use bevy::asset::RenderAssetUsages;
use bevy::image::{CompressedImageFormats, ImageSampler, ImageType};
use bevy::light::IrradianceVolume;
use bevy::pbr::DefaultOpaqueRendererMethod;
use bevy::prelude::*;
use bevy::render::render_resource::{Extent3d, TextureDimension, TextureFormat};
use bevy_meshless_gi::internals::plan::FrameStage;
use bevy_meshless_gi::prelude::*;
use meshless_gi::{
    BakedScene, Bounces, ExportedVolume, ProbeSettings, Recipe, VolumeExport, VolumePlacement,
};
use std::sync::Arc;

const LIGHT: Vec3 = Vec3::new(0.3, 1.7, 0.5);

fn bake() -> Arc<BakedScene> {
    Room::cornell().bake_as(&Recipe {
        probes: Some(ProbeSettings {
            spacing: Some(0.25),
            rays_per_probe: None,
        }),
        ..rough_recipe()
    })
}

/// Returns a forward camera's picture of the room with the plugin's volume.
fn plugin_picture(bake: &Arc<BakedScene>) -> Picture {
    let mut app = app();
    app.insert_resource(DefaultOpaqueRendererMethod::forward());
    let scene = bake.clone();
    let world = app.world_mut();
    let asset = world
        .resource_mut::<Assets<GiBakedScene>>()
        .add(GiBakedScene { scene });
    let volume = GiIrradianceVolume::default();
    let root = world
        .spawn((GiScene(asset), volume, Transform::IDENTITY))
        .id();
    Room::cornell().spawn(&mut app, root);
    let image = target(&mut app);
    let eye = (camera(&image, view()), bevy::camera::Hdr, Msaa::Off);
    app.world_mut().spawn(eye);
    spawn_light_source(&mut app, LIGHT);
    let written = |app: &App| counters(app).dispatches_of(FrameStage::VOLUME) > 0;
    for _ in 0..10_000 {
        run(&mut app, 1);
        if written(&app) {
            run(&mut app, 3);
            return picture(&mut app, &image);
        }
    }
    panic!("the volume is never written");
}

/// Returns the picture of the same room and light in an app without the plugin. `files` are the
/// texture and the placement of its volume, if any.
fn plain_picture(files: Option<(&[u8], &str)>) -> Picture {
    let mut app = App::new();
    app.add_plugins(headless_plugins())
        .insert_resource(GlobalAmbientLight::NONE)
        .insert_resource(bevy::light::PointLightShadowMap { size: 256 });
    finish_plugins(&mut app);
    let root = (Transform::IDENTITY, Visibility::default());
    let root = app.world_mut().spawn(root).id();
    Room::cornell().spawn(&mut app, root);
    let image = target(&mut app);
    let eye = (camera(&image, view()), bevy::camera::Hdr, Msaa::Off);
    app.world_mut().spawn(eye);
    spawn_light_source(&mut app, LIGHT);
    if let Some((texture, placement)) = files {
        let texture = load(texture);
        let placement = VolumePlacement::from_ron(placement).unwrap();
        let [x, y, z] = placement.resolution;
        let size = Extent3d {
            width: x,
            height: 2 * y,
            depth_or_array_layers: 3 * z,
        };
        assert_eq!(texture.texture_descriptor.size, size);
        let voxels = app.world_mut().resource_mut::<Assets<Image>>().add(texture);
        app.world_mut().spawn((
            LightProbe::default(),
            IrradianceVolume {
                voxels,
                intensity: placement.intensity,
                ..default()
            },
            Transform {
                translation: placement.translation.into(),
                rotation: Quat::from_array(placement.rotation),
                scale: placement.scale.into(),
            },
        ));
    }
    run(&mut app, 6);
    picture(&mut app, &image)
}

/// Reads a texture with Bevy's loader.
fn load(file: &[u8]) -> Image {
    let image = Image::from_buffer(
        file,
        ImageType::Extension("ktx2"),
        CompressedImageFormats::NONE,
        false,
        ImageSampler::Default,
        RenderAssetUsages::default(),
    )
    .expect("Bevy reads the texture");
    let descriptor = &image.texture_descriptor;
    assert_eq!(descriptor.dimension, TextureDimension::D3);
    assert_eq!(descriptor.format, TextureFormat::Rgba16Float);
    assert_eq!(descriptor.mip_level_count, 1);
    image
}

#[test]
fn exported_volume_matches_plugin_volume() {
    let bake = bake();
    let export = VolumeExport {
        bounces: Some(Bounces::Count(BOUNCES)),
        ..VolumeExport::default()
    };
    let volume = ExportedVolume::new(&bake, &[light_source(LIGHT)], &export).unwrap();
    let placement = volume
        .placement("room.ktx2", "lights.json")
        .to_ron()
        .unwrap();
    let file = volume.ktx2();
    let expected = plugin_picture(&bake);
    let plain = plain_picture(Some((&file, &placement)));
    let without = plain_picture(None);
    save_picture("export", &expected.beside(&plain));
    save_picture("export_without", &expected.beside(&without));
    let [d, dark] = [&plain, &without].map(|p| flip(&expected, p));
    let [off, far] = [&plain, &without].map(|p| p.nrmse(&expected));
    println!("FLIP {d:.4}, NRMSE {off:.4}; without the volume {dark:.4}, {far:.4}");
    assert!(d <= MAX_FLIP && off <= MAX_NRMSE, "{d}, {off}");
    assert!(
        dark > 3.0 * MAX_FLIP && far > 3.0 * MAX_NRMSE,
        "{dark}, {far}"
    );
    // With exchanged axes, the light has the color of the wrong walls.
    let mut turned = volume.clone();
    let layers = turned.texels.len() / 3;
    turned.texels.rotate_left(layers);
    let turned = plain_picture(Some((&turned.ktx2(), &placement)));
    assert!(
        turned.nrmse(&expected) > MAX_NRMSE,
        "{}",
        turned.nrmse(&expected)
    );
}

/// Largest mean FLIP between both pictures.
const MAX_FLIP: f32 = 0.01;
/// Largest NRMSE between both pictures.
const MAX_NRMSE: f32 = 0.01;

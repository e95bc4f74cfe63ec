//! Live materials: base colours and emission of [`StandardMaterial`]s that indirect light follows in the frame in which they change.

use crate::asset::LiveMaterials;
use crate::frame::materials::sound_factors;
use crate::scene::MaterialFactors;
use bevy::asset::{Assets, Handle};
use bevy::color::{ColorToComponents, LinearRgba};
use bevy::ecs::prelude::*;
use bevy::pbr::StandardMaterial;
use bevy::reflect::prelude::*;

/// Which asset a material of the bake is in this world: its name in the level's file, and the [`StandardMaterial`] that is drawn. Goes beside
/// [`MeshlessGi`](super::MeshlessGi). Indirect light then follows `base_color` and `emissive` of the asset, in the frame in which they change; textures and
/// metalness stay those of the bake, and so do materials that are not named. Needs a bake with `live_materials: true` in its recipe.
///
/// bevy_gltf puts a `GltfMaterialName` beside each mesh of a glTF scene: that is the name.
#[derive(Component, Reflect, Clone, Debug, Default, PartialEq)]
#[reflect(Component, Default, Clone, Debug, PartialEq)]
pub struct MeshlessGiMaterials(pub Vec<(String, Handle<StandardMaterial>)>);

/// The factors of the bake's materials now.
pub(crate) fn factors(
    live: &LiveMaterials,
    named: Option<&MeshlessGiMaterials>,
    assets: Option<&Assets<StandardMaterial>>,
) -> Vec<MaterialFactors> {
    let mut out = live.factors.clone();
    let (Some(named), Some(assets)) = (named, assets) else {
        return out;
    };
    for (name, handle) in &named.0 {
        let Some(material) = assets.get(handle) else {
            continue;
        };
        let now = MaterialFactors {
            base_color: LinearRgba::from(material.base_color).to_vec3().to_array(),
            emissive: material.emissive.to_vec3().to_array(),
        };
        let called = live.names.iter().zip(&mut out).filter(|(n, _)| *n == name);
        called.for_each(|(_, factors)| *factors = now);
    }
    sound_factors(live, &out)
}

/// Names that the bake does not know, or all of them where it knows no materials.
pub(crate) fn unknown<'a>(
    live: Option<&LiveMaterials>,
    named: &'a MeshlessGiMaterials,
) -> Vec<&'a str> {
    let known = |name: &String| live.is_some_and(|l| l.names.contains(name));
    let all = named.0.iter().map(|(name, _)| name);
    all.filter(|n| !known(n)).map(String::as_str).collect()
}

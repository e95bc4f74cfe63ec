//! Dynamic materials: base colors and emission of [`StandardMaterial`]s that indirect light follows
//! in the frame in which they change.

use crate::plugin::validation::{GiWarning, GiWarnings, add_warnings};
use bevy::asset::{AssetEvent, AssetId, Assets, Handle};
use bevy::color::{ColorToComponents, LinearRgba};
use bevy::ecs::prelude::*;
use bevy::image::Image;
use bevy::pbr::StandardMaterial;
use bevy::platform::collections::HashMap;
use bevy::reflect::prelude::*;
use meshless_gi::internals::frame::materials::sanitize_factors;
use meshless_gi::{BakedScene, MaterialFactors};
use std::sync::{Arc, Weak};

/// Materials of a bake that can change, each by its name in the scene's file and the
/// [`StandardMaterial`] that is drawn. Goes on the root, next to [`GiScene`](crate::GiScene).
///
/// Indirect light follows `base_color` and `emissive` of these assets in the frame of the change.
/// Textures and metalness keep the baked values, and so do materials that are not listed. The bake
/// needs `dynamic_materials: true` in its recipe.
///
/// bevy_gltf adds a `GltfMaterialName` with the name to each mesh of a glTF scene.
#[derive(Component, Reflect, Clone, Debug, Default, PartialEq)]
#[reflect(Component, Default, Clone, Debug, PartialEq)]
pub struct GiDynamicMaterials(pub Vec<(String, Handle<StandardMaterial>)>);

/// Pairs of named materials and materials of a bake. Computed only after the bake or the names
/// changed, because both may have hundreds of entries.
#[derive(Debug, Default)]
pub(crate) struct ResolvedMaterials {
    bake: Weak<BakedScene>,
    named: Vec<(String, Handle<StandardMaterial>)>,
    /// Pairs of an index in `named` and an index of the bake's materials, in the order of `named`.
    at: Vec<(usize, usize)>,
    /// Names that the bake lacks. All names if it has no materials.
    unknown: Vec<String>,
}

impl ResolvedMaterials {
    /// Resolves the names that differ from those of the last frame.
    fn resolve(&mut self, bake: &Arc<BakedScene>, named: Option<&GiDynamicMaterials>) {
        let named = named.map_or(&[][..], |n| &n.0);
        if self.bake.as_ptr() == Arc::as_ptr(bake) && self.named == named {
            return;
        }
        let mut known: HashMap<&str, Vec<usize>> = HashMap::default();
        if let Some(dynamic) = &bake.data().materials {
            for (at, name) in dynamic.names.iter().enumerate() {
                known.entry(name).or_default().push(at);
            }
        }
        let found = |name: &String| known.get(name.as_str()).map_or(&[][..], Vec::as_slice);
        let names = named.iter().map(|(name, _)| name);
        *self = Self {
            bake: Arc::downgrade(bake),
            at: (names.clone().enumerate())
                .flat_map(|(k, name)| found(name).iter().map(move |&at| (k, at)))
                .collect(),
            unknown: names.filter(|n| found(n).is_empty()).cloned().collect(),
            named: named.to_vec(),
        };
    }

    /// Returns the current factors of the bake's materials, and the names that the bake lacks. The
    /// factors are empty if it has no materials.
    pub fn factors(
        &mut self,
        bake: &Arc<BakedScene>,
        named: Option<&GiDynamicMaterials>,
        assets: Option<&Assets<StandardMaterial>>,
    ) -> (Vec<MaterialFactors>, &[String]) {
        self.resolve(bake, named);
        let Some(dynamic) = &bake.data().materials else {
            return (Vec::new(), &self.unknown);
        };
        let mut out = dynamic.factors.clone();
        for &(k, at) in &self.at {
            let Some(material) = assets.and_then(|a| a.get(&self.named[k].1)) else {
                continue;
            };
            out[at] = MaterialFactors {
                base_color: LinearRgba::from(material.base_color).to_vec3().to_array(),
                emissive: material.emissive.to_vec3().to_array(),
            };
        }
        (sanitize_factors(dynamic, &out), &self.unknown)
    }
}

type Textures = [Option<AssetId<Image>>; 2];

/// Warns if a dynamic material gets another texture, because indirect light keeps the bake's
/// texture. Runs in [`GiSystems::Validate`](crate::plugin::GiSystems::Validate).
pub(crate) fn check_textures(
    mut events: MessageReader<AssetEvent<StandardMaterial>>,
    materials: Res<Assets<StandardMaterial>>,
    named: Query<&GiDynamicMaterials>,
    mut before: Local<HashMap<AssetId<StandardMaterial>, Textures>>,
    mut findings: ResMut<GiWarnings>,
) {
    for event in events.read() {
        let (id, new) = match *event {
            AssetEvent::Added { id } => (id, true),
            AssetEvent::Modified { id } => (id, false),
            AssetEvent::Removed { id } => {
                before.remove(&id);
                continue;
            }
            _ => continue,
        };
        let Some(material) = materials.get(id) else {
            continue;
        };
        let of = |texture: &Option<Handle<Image>>| texture.as_ref().map(Handle::id);
        let now = [
            of(&material.base_color_texture),
            of(&material.emissive_texture),
        ];
        let was = before.insert(id, now);
        let is_named = || named.iter().any(|n| n.0.iter().any(|(_, h)| h.id() == id));
        if !new && was.is_some_and(|was| was != now) && is_named() {
            add_warnings(vec![GiWarning::DynamicMaterialTexture], &mut findings);
        }
    }
}

//! Computes the [inventory](Inventory) of a frame from the differences between the world and the
//! previous frame.
//!
//! The caller describes lights, scenes and cameras. Properties of a bake's surfaces are computed
//! once per bake. A frame costs one comparison per light and scene, and no loop over meshes.

use super::{Cameras, ColorUniformity, Inventory, LightKind, SceneChromaticity, SceneId, SkyKind};
use glam::Vec3;
use meshless_gi::internals::asset::DynamicMaterials;
use meshless_gi::{BakedScene, Light, MaterialFactors, SkyRadiance};
use std::collections::BTreeMap;
use std::sync::{Arc, Weak};

/// State of a baked scene in one frame.
#[derive(Clone, Debug)]
pub struct SceneSnapshot<'a> {
    /// Identifier of the scene.
    pub id: SceneId,
    /// Bake of the scene. `None` until it is loaded.
    pub bake: Option<&'a Arc<BakedScene>>,
    /// Affine transform of the root, in columns.
    pub transform: [f32; 12],
    /// Radiance of the sky.
    pub sky: SkyRadiance,
    /// Factor on the bake's emission.
    pub emission: f32,
    /// Factors of its materials. Empty if they cannot change.
    pub materials: &'a [MaterialFactors],
    /// Transmittance of its occluders.
    pub transmittances: &'a [f32],
    /// Indices of the [`WorldSnapshot::lights`] that do not light it, in ascending order. These
    /// lights are on other layers, or their range ends before it.
    pub unlit_by: Vec<usize>,
}

/// State of the world in one frame.
#[derive(Clone, Debug, Default)]
pub struct WorldSnapshot<'a, K> {
    /// Lights by the caller's key. Each key occurs once. Black lights are off, and the sky is not
    /// included.
    pub lights: Vec<(K, &'a Light)>,
    /// Roots of baked scenes.
    pub scenes: Vec<SceneSnapshot<'a>>,
    /// Numbers of cameras.
    pub cameras: Cameras,
    /// Number of dynamic objects that reflect light.
    pub reflectors: u32,
    /// Number of lights that request a bounce off dynamic objects.
    pub bouncing_lights: u32,
    /// Number of materials with a normal map.
    pub normal_maps: u32,
    /// Number of fog volumes.
    pub fogs: u32,
}

/// Chromaticity of a set of colors.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
enum Chromaticity {
    /// All colors are black.
    #[default]
    None,
    /// All colors have this chromaticity: a color whose largest part is 1.
    One(Vec3),
    /// The chromaticities differ.
    Several,
}

impl Chromaticity {
    /// Largest difference of two chromaticities that count as equal, per part. It covers an eighth
    /// of an 8-bit step and the rounding of textures.
    const MAX_DIFFERENCE: f32 = 2e-3;
    const GRAY: Self = Self::One(Vec3::ONE);

    fn from_color(color: Vec3) -> Self {
        let max = color.abs().max_element();
        match max > 0.0 && max.is_finite() {
            true => Self::One(color / max),
            false => Self::None,
        }
    }

    fn with(self, other: Self) -> Self {
        match (self, other) {
            (Self::None, hues) | (hues, Self::None) => hues,
            (Self::One(a), Self::One(b))
                if a.abs_diff_eq(b, Self::MAX_DIFFERENCE)
                    || a.abs_diff_eq(-b, Self::MAX_DIFFERENCE) =>
            {
                self
            }
            _ => Self::Several,
        }
    }

    fn from_colors(colors: impl IntoIterator<Item = Vec3>) -> Self {
        (colors.into_iter()).fold(Self::None, |hues, c| hues.with(Self::from_color(c)))
    }

    /// Returns the chromaticity of these colors times a factor.
    fn times(self, factor: Vec3) -> Self {
        match self {
            Self::One(hue) => Self::from_color(hue * factor),
            Self::Several if factor == Vec3::ZERO => Self::None,
            other => other,
        }
    }

    fn is_gray(self) -> bool {
        Self::GRAY.with(self) == Self::GRAY
    }

    /// Returns the colors of a scene with light of these chromaticities. `gray` is `true` if all
    /// its surfaces are gray.
    fn to_scene_chromaticity(self, gray: bool) -> SceneChromaticity {
        let (colors, hue) = match (self, gray) {
            (Self::None, _) => (ColorUniformity::Dark, Vec3::ONE),
            (_, false) => (ColorUniformity::Surfaces, Vec3::ONE),
            (Self::Several, true) => (ColorUniformity::Lights, Vec3::ONE),
            // Terms of a sky have either sign.
            (Self::One(hue), true) if hue.min_element() >= 0.0 => (ColorUniformity::One, hue),
            (Self::One(hue), true) if hue.max_element() <= 0.0 => (ColorUniformity::One, -hue),
            (Self::One(_), true) => (ColorUniformity::Lights, Vec3::ONE),
        };
        SceneChromaticity { colors, hue }
    }
}

/// Colors of a bake's surfaces.
#[derive(Clone, Debug)]
struct BakeColors {
    /// Bake of the surfaces.
    bake: Weak<BakedScene>,
    /// Reflected and emitted colors of all surfaces.
    all: [Chromaticity; 2],
    /// Reflected and emitted colors of the surfaces without a dynamic material.
    rest: [Chromaticity; 2],
    /// Reflected and emitted colors of each dynamic material, for factors of one. Textures are
    /// included.
    shares: Vec<[Chromaticity; 2]>,
}

impl BakeColors {
    fn from_bake(bake: &Arc<BakedScene>) -> Self {
        let mut bake_colors = Self {
            bake: Arc::downgrade(bake),
            all: [Chromaticity::None; 2],
            rest: [Chromaticity::None; 2],
            shares: Vec::new(),
        };
        let add = |hues: &mut [Chromaticity; 2], [albedo, emission]: [[f32; 3]; 2]| {
            hues[0] = hues[0].with(Chromaticity::from_color(albedo.into()));
            hues[1] = hues[1].with(Chromaticity::from_color(emission.into()));
        };
        for (j, surface) in bake.data().surfaces.iter().enumerate() {
            let own = [surface.albedo, surface.emission];
            add(&mut bake_colors.all, own);
            let covers = |dynamic: &DynamicMaterials| !dynamic.row(j).is_empty();
            // Points that do not send light have no row.
            if j < bake.data().senders() && !bake.data().materials.as_ref().is_some_and(covers) {
                add(&mut bake_colors.rest, own);
            }
        }
        if let Some(dynamic) = &bake.data().materials {
            bake_colors.shares = vec![[Chromaticity::None; 2]; dynamic.factors.len()];
            for share in &dynamic.shares {
                if let Some(hues) = bake_colors.shares.get_mut(share.material as usize) {
                    add(hues, [share.albedo, share.emission]);
                }
            }
        }
        bake_colors
    }

    /// Returns the reflected and emitted colors with these factors of the materials. All are as
    /// baked if there are no factors.
    fn surface_hues(&self, materials: &[MaterialFactors]) -> [Chromaticity; 2] {
        if materials.is_empty() {
            return self.all;
        }
        let mut now = self.rest;
        for (m, factors) in materials.iter().enumerate() {
            let shares = self
                .shares
                .get(m)
                .copied()
                .unwrap_or([Chromaticity::GRAY; 2]);
            let factors = [factors.base_color, factors.emissive];
            for k in 0..2 {
                now[k] = now[k].with(shares[k].times(factors[k].into()));
            }
        }
        now
    }
}

/// State of a scene in the previous frame.
#[derive(Clone, Debug)]
struct PreviousScene {
    transform: [f32; 12],
    sky: SkyRadiance,
    emission: f32,
    materials: Vec<MaterialFactors>,
    transmittances: Vec<f32>,
    bake_colors: Option<BakeColors>,
}

/// Computes the inventory of each frame. `K` identifies a light.
#[derive(Clone, Debug)]
pub struct InventoryTracker<K> {
    lights: BTreeMap<K, Light>,
    scenes: BTreeMap<SceneId, PreviousScene>,
    colors: BTreeMap<SceneId, SceneChromaticity>,
}

impl<K> Default for InventoryTracker<K> {
    fn default() -> Self {
        Self {
            lights: BTreeMap::new(),
            scenes: BTreeMap::new(),
            colors: BTreeMap::new(),
        }
    }
}

/// Returns kind, color and geometry of a light. `None` for a sky.
fn parts(light: &Light) -> Option<(LightKind, Vec3, [f32; 9])> {
    let mut placement = [0.0; 9];
    let mut put = |at: usize, v: Vec3| placement[at..at + 3].copy_from_slice(&v.to_array());
    let (sort, color) = match *light {
        Light::Point {
            position,
            intensity,
            range,
        } => {
            put(0, position);
            placement[8] = range;
            (LightKind::Point, intensity)
        }
        Light::Spot {
            position,
            direction,
            intensity,
            inner,
            outer,
            range,
        } => {
            put(0, position);
            put(3, direction);
            [placement[6], placement[7], placement[8]] = [inner, outer, range];
            (LightKind::Spot, intensity)
        }
        Light::Directional {
            direction,
            irradiance,
        } => {
            put(3, direction);
            (LightKind::Directional, irradiance)
        }
        Light::Rect {
            center,
            u,
            v,
            radiance,
        } => {
            put(0, center);
            put(3, u);
            put(6, v);
            (LightKind::Rect, radiance)
        }
        _ => return None,
    };
    Some((sort, color, placement))
}

impl<K: Copy + Ord> InventoryTracker<K> {
    /// Creates a tracker without history. Its first inventory counts every object as new.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Returns the inventory of this frame, compared with the previous one.
    pub fn update(&mut self, found: &WorldSnapshot<'_, K>) -> Inventory {
        let mut out = Inventory {
            bakes: found.scenes.len() as u32,
            reflectors: found.reflectors,
            bouncing_lights: found.bouncing_lights,
            cameras: found.cameras,
            normal_maps: found.normal_maps,
            fogs: found.fogs,
            ..Inventory::default()
        };
        let lights = self.count_lights(found, &mut out);
        let all = |hues: Chromaticity, (_, light): (usize, &Chromaticity)| hues.with(*light);
        let world = lights.iter().enumerate().fold(Chromaticity::None, all);
        let (mut hues, mut gray) = (world, true);
        self.colors.clear();
        let mut before = std::mem::take(&mut self.scenes);
        for scene in &found.scenes {
            let was = before.remove(&scene.id);
            let (now, hue, reflects_gray) = count_scene(scene, was, &mut out);
            self.scenes.insert(scene.id, now);
            let lit = match scene.unlit_by.as_slice() {
                [] => world,
                unlit => (lights.iter().enumerate())
                    .filter(|(k, _)| unlit.binary_search(k).is_err())
                    .fold(Chromaticity::None, all),
            };
            (self.colors).insert(scene.id, lit.with(hue).to_scene_chromaticity(reflects_gray));
            hues = hues.with(hue);
            gray &= reflects_gray;
        }
        out.bakes_moved += before.len() as u32;
        out.colors = hues.to_scene_chromaticity(gray).colors;
        out
    }

    /// Returns the light colors of a scene of the last inventory, from its sky, its emissive
    /// surfaces and its lights.
    #[must_use]
    pub fn colors_of(&self, scene: SceneId) -> SceneChromaticity {
        self.colors.get(&scene).copied().unwrap_or_default()
    }

    /// Counts the lights and returns the chromaticity of each.
    fn count_lights(
        &mut self,
        found: &WorldSnapshot<'_, K>,
        out: &mut Inventory,
    ) -> Vec<Chromaticity> {
        let mut hues = vec![Chromaticity::None; found.lights.len()];
        let mut before = std::mem::take(&mut self.lights);
        for ((key, light), hue) in found.lights.iter().zip(&mut hues) {
            let Some((sort, color, placement)) = parts(light) else {
                continue;
            };
            let census = &mut out.lights[sort as usize];
            census.all += 1;
            census.on += u32::from(color != Vec3::ZERO);
            *hue = Chromaticity::from_color(color);
            match before.remove(key).as_ref().and_then(parts) {
                Some((was, tint, stood)) if was == sort => {
                    census.moved += u32::from(stood != placement);
                    census.recolored += u32::from(tint != color);
                }
                _ => census.moved += 1,
            }
            self.lights.insert(*key, **light);
        }
        for (sort, ..) in before.values().filter_map(parts) {
            out.lights[sort as usize].moved += 1;
        }
        hues
    }
}

/// Counts a scene. Returns its state, the colors of its sky and emission, and `true` if all its
/// surfaces are gray.
fn count_scene(
    scene: &SceneSnapshot<'_>,
    was: Option<PreviousScene>,
    out: &mut Inventory,
) -> (PreviousScene, Chromaticity, bool) {
    let differ = |a: &[f32], b: &[f32]| {
        let same = a.iter().zip(b).filter(|(x, y)| x == y).count();
        (a.len() - same) as u32
    };
    let sky =
        Chromaticity::from_colors(scene.sky.terms).with(Chromaticity::from_color(scene.sky.mean));
    let skies = match (sky, scene.sky.is_uniform()) {
        (Chromaticity::None, _) => SkyKind::None,
        (_, true) => SkyKind::Uniform,
        (_, false) => SkyKind::Varied,
    };
    out.skies = out.skies.max(skies);
    out.dynamic_materials += scene.materials.len() as u32;
    out.doors += scene.transmittances.len() as u32;
    let bake_colors = match (scene.bake, was.as_ref().and_then(|w| w.bake_colors.clone())) {
        (Some(bake), Some(bake_colors)) if bake_colors.bake.as_ptr() == Arc::as_ptr(bake) => {
            Some(bake_colors)
        }
        (Some(bake), _) => Some(BakeColors::from_bake(bake)),
        (None, _) => None,
    };
    let [reflected, emitted] = bake_colors
        .as_ref()
        .map_or([Chromaticity::None; 2], |f| f.surface_hues(scene.materials));
    let glow = match scene.emission <= 0.0 {
        true => Chromaticity::None,
        false => emitted,
    };
    out.emissive_scenes += u32::from(glow != Chromaticity::None);
    let gray = reflected.is_gray();
    match &was {
        Some(was) => {
            out.bakes_moved += u32::from(was.transform != scene.transform);
            out.skies_changed += u32::from(was.sky != scene.sky);
            out.emissions_changed +=
                u32::from(was.emission != scene.emission && glow != Chromaticity::None);
            let same = was.materials.iter().zip(scene.materials);
            let same = same.filter(|(a, b)| a == b).count();
            out.materials_changed += (scene.materials.len() - same) as u32;
            out.doors_moved += differ(scene.transmittances, &was.transmittances);
        }
        None => {
            out.bakes_moved += 1;
            out.doors_moved += scene.transmittances.len() as u32;
            out.materials_changed += scene.materials.len() as u32;
            out.skies_changed += u32::from(skies != SkyKind::None);
            out.emissions_changed += u32::from(glow != Chromaticity::None);
        }
    }
    let now = PreviousScene {
        transform: scene.transform,
        sky: scene.sky,
        emission: scene.emission,
        materials: scene.materials.to_vec(),
        transmittances: scene.transmittances.to_vec(),
        bake_colors,
    };
    // A bake for a uniform sky uses the mean of any other sky.
    let sky = match scene.bake.is_some_and(|bake| bake.data().sky.is_none()) {
        true => Chromaticity::from_color(scene.sky.mean),
        false => sky,
    };
    (now, sky.with(glow), gray)
}

#[cfg(test)]
mod tests;

//! Counts of the parts of the world that affect indirect light. The plan prints them first.
//! [`InventoryTracker`](super::InventoryTracker) updates them in each frame.
//!
//! The inventory lists the objects that exist, not the passes that run. A light that moves out of
//! view is in the inventory, and no pass is in the plan.

use super::LightKind;
use std::fmt;

/// Counts of one kind of object, and of its changes since the previous frame. Added and removed
/// objects count as moved.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ChangeCounts {
    /// Number of objects.
    pub all: u32,
    /// Number of objects that are on.
    pub on: u32,
    /// Number of objects with another position, direction or range, and of added and removed ones.
    pub moved: u32,
    /// Number of objects with another color or intensity, or that were turned on or off.
    pub recolored: u32,
}

/// Kind of the skies of the baked scenes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub enum SkyKind {
    /// All skies are black.
    #[default]
    None,
    /// All skies with radiance are uniform.
    Uniform,
    /// One sky or more varies with the direction.
    Varied,
}

/// Numbers of cameras that draw in three dimensions, without those of reflective shadow maps.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Cameras {
    /// Cameras that show indirect light over a G-buffer.
    pub deferred: u32,
    /// Cameras without a G-buffer, with one sample per pixel.
    pub forward: u32,
    /// Cameras without a G-buffer, with several samples per pixel.
    pub sampled: u32,
    /// Cameras with indirect light that is turned off by their settings.
    pub off: u32,
}

/// Uniformity of the colors of all light. One channel suffices for a single color.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ColorUniformity {
    /// Nothing shines.
    #[default]
    Dark,
    /// All surfaces that reflect are gray, and all light has one chromaticity.
    One,
    /// A baked surface, or a dynamic material that covers one, is colored.
    Surfaces,
    /// All surfaces are gray, and the light has several chromaticities.
    Lights,
}

/// Inventory of the world in one frame.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct Inventory {
    /// Lights of each kind, as [`LightKind::ALL`] orders them.
    pub lights: [ChangeCounts; 4],
    /// Number of baked scenes.
    pub bakes: u32,
    /// Kind of their skies.
    pub skies: SkyKind,
    /// Number of scenes with a changed sky.
    pub skies_changed: u32,
    /// Number of scenes with emissive surfaces, by the bake and the settings.
    pub emissive_scenes: u32,
    /// Number of scenes with changed emission.
    pub emissions_changed: u32,
    /// Number of materials that may change
    /// ([`dynamic_materials`](meshless_gi::Recipe::dynamic_materials)).
    pub dynamic_materials: u32,
    /// Number of materials that changed.
    pub materials_changed: u32,
    /// Number of occluders, such as doors and lifts.
    pub doors: u32,
    /// Number of occluders that moved.
    pub doors_moved: u32,
    /// Number of roots of baked scenes that moved.
    pub bakes_moved: u32,
    /// Number of dynamic objects that reflect light.
    pub reflectors: u32,
    /// Number of lights that request a bounce off dynamic objects.
    pub bouncing_lights: u32,
    /// Numbers of cameras.
    pub cameras: Cameras,
    /// Number of materials with a normal map.
    pub normal_maps: u32,
    /// Number of fog volumes.
    pub fogs: u32,
    /// Uniformity of the colors of all light.
    pub colors: ColorUniformity,
}

impl Inventory {
    /// Returns the counts of the lights of one kind.
    #[must_use]
    pub fn lights_of(&self, sort: LightKind) -> ChangeCounts {
        self.lights[sort as usize]
    }

    /// Returns `true` if nothing that affects the light changed since the previous frame.
    #[must_use]
    pub fn at_rest(&self) -> bool {
        let lights = |c: &ChangeCounts| c.moved == 0 && c.recolored == 0;
        self.lights.iter().all(lights)
            && [
                self.skies_changed,
                self.emissions_changed,
                self.materials_changed,
                self.doors_moved,
                self.bakes_moved,
            ] == [0; 5]
    }
}

impl fmt::Display for ChangeCounts {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let counts = [
            (self.all - self.on.min(self.all), "off"),
            (self.moved, "moved"),
            (self.recolored, "changed color"),
        ];
        let parts: Vec<String> = (counts.iter().filter(|(n, _)| *n > 0))
            .map(|(n, what)| format!("{n} {what}"))
            .collect();
        match parts.is_empty() {
            true => Ok(()),
            false => write!(f, " ({})", parts.join(", ")),
        }
    }
}

impl fmt::Display for ColorUniformity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Dark => "no light is on",
            Self::One => "surfaces are gray and all light has one color",
            Self::Surfaces => "surfaces are colored",
            Self::Lights => "surfaces are gray, lights differ in color",
        })
    }
}

impl fmt::Display for Inventory {
    /// Writes one line each for light sources, changes and cameras. Omits the empty ones.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let changed = |n: u32, what| match n {
            0 => String::new(),
            n => format!(" ({n} {what})"),
        };
        let mut shine: Vec<String> = (LightKind::ALL.iter().zip(&self.lights))
            .filter(|(_, census)| census.all > 0 || census.moved > 0)
            .map(|(sort, census)| format!("{} × {}{census}", census.all, sort.name()))
            .collect();
        let sky = match self.skies {
            SkyKind::None => None,
            SkyKind::Uniform => Some("a uniform sky"),
            SkyKind::Varied => Some("a sky that varies"),
        };
        shine.extend(sky.map(|sky| format!("{sky}{}", changed(self.skies_changed, "changed"))));
        if self.emissive_scenes > 0 {
            let glow = changed(self.emissions_changed, "changed");
            shine.push(format!("emissive surfaces{glow}"));
        }
        if shine.is_empty() {
            shine.push("no light sources".into());
        }
        writeln!(f, "have {}: {}", shine.join(", "), self.colors)?;
        let mut world = vec![format!(
            "{} × bake{}",
            self.bakes,
            changed(self.bakes_moved, "moved")
        )];
        let counted = [
            (
                self.dynamic_materials,
                "dynamic material",
                self.materials_changed,
                "changed",
            ),
            (self.doors, "door", self.doors_moved, "moved"),
            (self.reflectors, "dynamic reflector", 0, ""),
            (
                self.bouncing_lights,
                "light that casts reflective shadow maps",
                0,
                "",
            ),
            (self.normal_maps, "material with a normal map", 0, ""),
            (self.fogs, "fog volume", 0, ""),
        ];
        for (count, what, of, how) in counted {
            if count > 0 {
                world.push(format!("{count} × {what}{}", changed(of, how)));
            }
        }
        let cameras = self.cameras;
        let counted = [
            (cameras.deferred, "deferred camera"),
            (cameras.forward, "forward camera"),
            (cameras.sampled, "camera with several samples"),
            (cameras.off, "camera that is off"),
        ];
        for (count, what) in counted {
            if count > 0 {
                world.push(format!("{count} × {what}"));
            }
        }
        writeln!(f, "have {}", world.join(", "))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn inventory_lists_only_present_items() {
        let empty = Inventory::default();
        assert!(empty.at_rest());
        assert_eq!(
            empty.to_string(),
            "have no light sources: no light is on\nhave 0 × bake\n"
        );
        let mut full = Inventory {
            bakes: 1,
            skies: SkyKind::Varied,
            skies_changed: 1,
            doors: 2,
            doors_moved: 1,
            normal_maps: 3,
            fogs: 2,
            colors: ColorUniformity::Surfaces,
            ..empty
        };
        full.lights[LightKind::Point as usize] = ChangeCounts {
            all: 3,
            on: 2,
            moved: 1,
            recolored: 0,
        };
        full.cameras.deferred = 1;
        assert_eq!(
            full.to_string(),
            "have 3 × point light (1 off, 1 moved), a sky that varies (1 changed): surfaces are colored\n\
             have 1 × bake, 2 × door (1 moved), 3 × material with a normal map, 2 × fog volume, 1 × deferred camera\n"
        );
        assert_eq!(full.lights_of(LightKind::Point).on, 2);
        assert!(!full.at_rest());
    }
}

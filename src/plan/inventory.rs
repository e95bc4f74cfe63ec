//! What the world has that indirect light may have to follow, in counts: the plan's first words.
//! [`InventoryTracker`](super::InventoryTracker) makes it, frame by frame.
//!
//! It says what is there, not what runs: a light that moves out of view is in the inventory, and no
//! pass is in the plan.

use std::fmt;

/// How many of a kind, and what became of them since the frame before. What is new or gone counts
/// as moved.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ChangeCounts {
    /// There are so many.
    pub all: u32,
    /// So many of them are on.
    pub on: u32,
    /// So many stand, point or reach elsewhere, or are new.
    pub moved: u32,
    /// So many have another color or strength, or went on or off.
    pub recolored: u32,
}

/// A kind of light.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum LightKind {
    /// Point lights.
    Point,
    /// Spot lights.
    Spot,
    /// Suns.
    Directional,
    /// Rectangles.
    Rect,
}

impl LightKind {
    /// All kinds.
    pub const ALL: [Self; 4] = [Self::Point, Self::Spot, Self::Directional, Self::Rect];

    /// One of them in words.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Point => "point light",
            Self::Spot => "spot light",
            Self::Directional => "directional light",
            Self::Rect => "rectangle light",
        }
    }
}

/// What the skies of the baked scenes are.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub enum SkyKind {
    /// None shines.
    #[default]
    None,
    /// All that shine are uniform.
    Uniform,
    /// One varies with the direction.
    Varied,
}

/// The cameras that draw in three dimensions, captures of what moves aside.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Cameras {
    /// They show indirect light over a G-buffer.
    pub deferred: u32,
    /// They draw without one, one sample a pixel.
    pub forward: u32,
    /// They draw without one, several samples a pixel.
    pub sampled: u32,
    /// They ask for indirect light, and their settings turn it off.
    pub off: u32,
}

/// Whether all light of the world has one color, so that one channel would tell all of it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ColorUniformity {
    /// Nothing shines.
    #[default]
    Dark,
    /// Every surface that reflects is gray, and all that shines has one chromaticity.
    One,
    /// A baked surface is colored, or a material that covers one is now.
    Surfaces,
    /// Surfaces are gray, and what shines has several chromaticities.
    Lights,
}

/// What a frame's world has.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Inventory {
    /// Lights of each kind, as [`LightKind::ALL`] orders them.
    pub lights: [ChangeCounts; 4],
    /// Baked scenes.
    pub bakes: u32,
    /// What their skies are.
    pub skies: SkyKind,
    /// How many scenes' skies changed.
    pub skies_changed: u32,
    /// Scenes with surfaces that glow, as bake and settings have it.
    pub glowing: u32,
    /// How many scenes' emission changed.
    pub glow_changed: u32,
    /// Materials that may change ([`dynamic_materials`](meshless_gi::Recipe::dynamic_materials)).
    pub live_materials: u32,
    /// How many of them changed.
    pub materials_changed: u32,
    /// Doors, lifts and the like.
    pub doors: u32,
    /// How many of them moved.
    pub doors_moved: u32,
    /// Roots of baked scenes that moved.
    pub bakes_moved: u32,
    /// What moves and is marked to reflect light.
    pub bouncers: u32,
    /// Lights that ask for the bounce of what moves.
    pub bouncing_lights: u32,
    /// The cameras.
    pub cameras: Cameras,
    /// Materials with a normal map.
    pub normal_maps: u32,
    /// Fog volumes.
    pub fogs: u32,
    /// Whether one channel would do.
    pub colors: ColorUniformity,
}

impl Inventory {
    /// Lights of one kind.
    #[must_use]
    pub fn lights_of(&self, sort: LightKind) -> ChangeCounts {
        self.lights[sort as usize]
    }

    /// Nothing of what lights the scenes changed since the frame before.
    #[must_use]
    pub fn at_rest(&self) -> bool {
        let lights = |c: &ChangeCounts| c.moved == 0 && c.recolored == 0;
        self.lights.iter().all(lights)
            && [
                self.skies_changed,
                self.glow_changed,
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
        let said: Vec<String> = (counts.iter().filter(|(n, _)| *n > 0))
            .map(|(n, what)| format!("{n} {what}"))
            .collect();
        match said.is_empty() {
            true => Ok(()),
            false => write!(f, " ({})", said.join(", ")),
        }
    }
}

impl fmt::Display for ColorUniformity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Dark => "nothing shines",
            Self::One => "surfaces are gray and all light has one color",
            Self::Surfaces => "surfaces are colored",
            Self::Lights => "surfaces are gray, lights differ in color",
        })
    }
}

impl fmt::Display for Inventory {
    /// One line for each of: what shines, what changes, what is looked at; only what there is.
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
        if self.glowing > 0 {
            let glow = changed(self.glow_changed, "changed");
            shine.push(format!("surfaces that glow{glow}"));
        }
        if shine.is_empty() {
            shine.push("nothing that shines".into());
        }
        writeln!(f, "have {}: {}", shine.join(", "), self.colors)?;
        let mut world = vec![format!(
            "{} × bake{}",
            self.bakes,
            changed(self.bakes_moved, "elsewhere")
        )];
        let counted = [
            (
                self.live_materials,
                "live material",
                self.materials_changed,
                "changed",
            ),
            (self.doors, "door", self.doors_moved, "moved"),
            (self.bouncers, "thing to bounce light", 0, ""),
            (self.bouncing_lights, "light asks for that bounce", 0, ""),
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
            "have nothing that shines: nothing shines\nhave 0 × bake\n"
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

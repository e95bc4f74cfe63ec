//! Which light sits in which slot, and what changed about it since the device last computed it.
//!
//! A slot is one column of the projection g[slot][point]: a light of unit colour. A rectangle takes several slots, one a
//! patch. A light keeps its slots as long as it lives, so that a light that moves costs its own slots and no others.
//! Changes are measured against what was last *projected*, never against the last frame: a slow drift adds up until it
//! counts, and frames in which the scene was out of view are caught up by themselves.

use super::SlotChange;
use crate::scene::{Bounds, Light};
use glam::Vec3;
use std::collections::BTreeMap;

/// A light without its colour: everything that its projection depends on. Metres, local space of the bake.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum LightGeometry {
    /// A point light of 1 W/sr.
    Point {
        /// Metres.
        position: Vec3,
        /// Metres; infinite for none.
        range: f32,
    },
    /// A spot light of 1 W/sr on its axis.
    Spot {
        /// Metres.
        position: Vec3,
        /// Unit, where the light goes.
        direction: Vec3,
        /// Half angle of the full cone, radians.
        inner: f32,
        /// Half angle where it ends, radians.
        outer: f32,
        /// Metres; infinite for none.
        range: f32,
    },
    /// A directional light of 1 W/m².
    Directional {
        /// Unit, where the light goes.
        direction: Vec3,
    },
    /// A patch of a rectangle, of 1 W/sr along its normal.
    Patch {
        /// Metres.
        position: Vec3,
        /// Unit, the side that it emits to.
        normal: Vec3,
    },
}

impl LightGeometry {
    /// True when the two project alike: lengths within `tolerance` metres, directions and angles within 1e-5.
    #[must_use]
    pub fn same(&self, other: &Self, tolerance: f32) -> bool {
        const ANGLE: f32 = 1e-5;
        let near = |a: Vec3, b: Vec3, t: f32| (a - b).abs().max_element() <= t;
        // Equal infinities are alike.
        let length = |a: f32, b: f32| a == b || (a - b).abs() <= tolerance;
        let angle = |a: f32, b: f32| (a - b).abs() <= ANGLE;
        match (*self, *other) {
            (
                Self::Point {
                    position: p,
                    range: r,
                },
                Self::Point {
                    position: q,
                    range: s,
                },
            ) => near(p, q, tolerance) && length(r, s),
            (
                Self::Spot {
                    position: p,
                    direction: d,
                    inner: i,
                    outer: o,
                    range: r,
                },
                Self::Spot {
                    position: q,
                    direction: e,
                    inner: j,
                    outer: u,
                    range: s,
                },
            ) => {
                near(p, q, tolerance)
                    && near(d, e, ANGLE)
                    && angle(i, j)
                    && angle(o, u)
                    && length(r, s)
            }
            (Self::Directional { direction: d }, Self::Directional { direction: e }) => {
                near(d, e, ANGLE)
            }
            (
                Self::Patch {
                    position: p,
                    normal: n,
                },
                Self::Patch {
                    position: q,
                    normal: m,
                },
            ) => near(p, q, tolerance) && near(n, m, ANGLE),
            _ => false,
        }
    }

    /// False when no light can arrive in the box: it ends before.
    #[must_use]
    pub fn reaches(&self, bounds: Bounds) -> bool {
        match *self {
            Self::Point { position, range }
            | Self::Spot {
                position, range, ..
            } => {
                let nearest = position.clamp(bounds.min.min(bounds.max), bounds.max);
                range.is_infinite() || nearest.distance_squared(position) < range * range
            }
            _ => true,
        }
    }
}

/// A light as it goes into slots: geometry and the colour that multiplies its projection.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SlotLight {
    /// What is projected.
    pub geometry: LightGeometry,
    /// W/sr (point, spot, patch) or W/m² (directional), linear RGB.
    pub colour: Vec3,
}

impl SlotLight {
    /// The slots of a light; none for the sky, which needs no projection. A rectangle becomes `patches` × `patches`.
    #[must_use]
    pub fn of(light: &Light, patches: u32) -> Vec<Self> {
        let one = |geometry, colour| vec![Self { geometry, colour }];
        match *light {
            Light::Point {
                position,
                intensity,
                range,
            } => one(LightGeometry::Point { position, range }, intensity),
            Light::Spot {
                position,
                direction,
                intensity,
                inner,
                outer,
                range,
            } => one(
                LightGeometry::Spot {
                    position,
                    direction,
                    inner,
                    outer,
                    range,
                },
                intensity,
            ),
            Light::Directional {
                direction,
                irradiance,
            } => one(LightGeometry::Directional { direction }, irradiance),
            Light::Rect {
                center,
                u,
                v,
                radiance,
            } => {
                let n = patches.max(1);
                let cross = u.cross(v);
                let (area, normal) = (4.0 * cross.length(), cross.normalize_or(Vec3::Y));
                let at = |i: u32| (2 * i + 1) as f32 / n as f32 - 1.0;
                (0..n * n)
                    .map(|i| Self {
                        geometry: LightGeometry::Patch {
                            position: center + at(i % n) * u + at(i / n) * v,
                            normal,
                        },
                        colour: radiance * area / (n * n) as f32,
                    })
                    .collect()
            }
            Light::Sky { .. } => Vec::new(),
        }
    }
}

/// One slot in use.
#[derive(Clone, Debug)]
struct Slot {
    /// What the world says now.
    wanted: SlotLight,
    /// What the device's projection was made for.
    projected: Option<LightGeometry>,
}

/// What the table says about a frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Slots {
    /// One entry a slot.
    pub changes: Vec<SlotChange>,
    /// A slot that shone was freed.
    pub stale: bool,
}

/// The slots of one scene.
#[derive(Clone, Debug, Default)]
pub struct SlotTable {
    /// First come, first slot; a freed slot is taken again.
    slots: Vec<Option<Slot>>,
    /// The colours that the device's transport was computed with, slot by slot.
    applied: Vec<Vec3>,
    /// The slots of each light, by the caller's key.
    owners: BTreeMap<u64, Vec<u32>>,
}

impl SlotTable {
    /// An empty table.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// How many slots, free ones within included.
    #[must_use]
    pub fn len(&self) -> usize {
        self.slots.len()
    }

    /// True without slots.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.slots.is_empty()
    }

    /// Takes the frame's lights, in the bake's local space, and says what changed. Lights are known by their key; a key
    /// that is missing has gone. A light that is black or does not reach `bounds` keeps its slots and its projection.
    /// Moves by less than 1e-5 of the box's diagonal do not count (a scene root that moves together with its lights
    /// gives that much rounding).
    pub fn update(&mut self, lights: &[(u64, Vec<SlotLight>)], bounds: Bounds) -> Slots {
        let tolerance = 1e-5 * bounds.size().length();
        let gone: Vec<u64> = self
            .owners
            .iter()
            .filter(|(key, held)| {
                !lights
                    .iter()
                    .any(|(k, s)| k == *key && s.len() == held.len())
            })
            .map(|(&key, _)| key)
            .collect();
        for key in gone {
            for slot in self.owners.remove(&key).unwrap_or_default() {
                self.slots[slot as usize] = None;
            }
        }
        for (key, parts) in lights {
            if !self.owners.contains_key(key) {
                let taken = parts.iter().map(|&part| self.take(part)).collect();
                self.owners.insert(*key, taken);
            }
            for (&slot, &part) in self.owners[key].iter().zip(parts) {
                let slot = self.slots[slot as usize]
                    .as_mut()
                    .expect("an owned slot is in use");
                slot.wanted = part;
                if !part.geometry.reaches(bounds) {
                    slot.wanted.colour = Vec3::ZERO;
                }
            }
        }
        self.applied.resize(self.slots.len(), Vec3::ZERO);
        let mut stale = false;
        let changes = self
            .slots
            .iter()
            .zip(&self.applied)
            .map(|(slot, &applied)| {
                let Some(slot) = slot else {
                    stale |= applied != Vec3::ZERO;
                    return SlotChange::None;
                };
                let valid = |p: LightGeometry| p.same(&slot.wanted.geometry, tolerance);
                if slot.wanted.colour == Vec3::ZERO {
                    // Dark: whatever its projection says is multiplied by zero.
                    if applied == Vec3::ZERO {
                        SlotChange::None
                    } else {
                        SlotChange::Colour
                    }
                } else if !slot.projected.is_some_and(valid) {
                    SlotChange::Geometry
                } else if slot.wanted.colour != applied {
                    SlotChange::Colour
                } else {
                    SlotChange::None
                }
            })
            .collect();
        Slots { changes, stale }
    }

    /// The light that slot `i` should hold now; `None` for a free slot.
    #[must_use]
    pub fn light(&self, i: u32) -> Option<SlotLight> {
        self.slots.get(i as usize)?.as_ref().map(|s| s.wanted)
    }

    /// The colour of every slot, black for free ones.
    #[must_use]
    pub fn colours(&self) -> Vec<Vec3> {
        self.slots
            .iter()
            .map(|s| s.as_ref().map_or(Vec3::ZERO, |s| s.wanted.colour))
            .collect()
    }

    /// The device has projected these slots as they are wanted.
    pub fn mark_projected(&mut self, slots: &[u32]) {
        for &i in slots {
            if let Some(slot) = self.slots.get_mut(i as usize).and_then(Option::as_mut) {
                slot.projected = Some(slot.wanted.geometry);
            }
        }
    }

    /// The device has run the transport with the wanted colours.
    pub fn mark_applied(&mut self) {
        self.applied = self.colours();
    }

    /// The device holds nothing any more.
    pub fn forget(&mut self) {
        for slot in self.slots.iter_mut().flatten() {
            slot.projected = None;
        }
        self.applied.fill(Vec3::ZERO);
    }

    fn take(&mut self, part: SlotLight) -> u32 {
        let slot = Some(Slot {
            wanted: part,
            projected: None,
        });
        match self.slots.iter().position(Option::is_none) {
            Some(free) => {
                self.slots[free] = slot;
                free as u32
            }
            None => {
                self.slots.push(slot);
                self.slots.len() as u32 - 1
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const BOX: Bounds = Bounds {
        min: Vec3::ZERO,
        max: Vec3::splat(10.0),
    };

    fn lamp(x: f32, colour: f32) -> Vec<SlotLight> {
        SlotLight::of(
            &Light::Point {
                position: Vec3::new(x, 1.0, 1.0),
                intensity: Vec3::splat(colour),
                range: 20.0,
            },
            1,
        )
    }

    fn settle(table: &mut SlotTable, changes: &[SlotChange]) {
        let moved: Vec<u32> = (0..changes.len())
            .filter(|&i| changes[i] == SlotChange::Geometry)
            .map(|i| i as u32)
            .collect();
        table.mark_projected(&moved);
        table.mark_applied();
    }

    #[test]
    fn a_light_keeps_its_slot_while_others_come_and_go() {
        use SlotChange::{Colour, Geometry, None};
        let mut table = SlotTable::new();
        let first = table.update(&[(9, lamp(1.0, 1.0)), (4, lamp(2.0, 1.0))], BOX);
        assert_eq!(first.changes, [Geometry, Geometry]);
        settle(&mut table, &first.changes);
        // 9 leaves: its slot is free, its light is still in the transport.
        let second = table.update(&[(4, lamp(2.0, 1.0))], BOX);
        assert_eq!((second.changes, second.stale), (vec![None, None], true));
        assert_eq!(table.colours(), [Vec3::ZERO, Vec3::ONE]);
        table.mark_applied();
        // 5 takes the free slot; 4 changes colour in its own.
        let third = table.update(&[(4, lamp(2.0, 3.0)), (5, lamp(3.0, 1.0))], BOX);
        assert_eq!(
            (third.changes, third.stale),
            (vec![Geometry, Colour], false)
        );
    }

    #[test]
    fn a_drift_counts_when_it_has_added_up() {
        let mut table = SlotTable::new();
        let start = table.update(&[(1, lamp(1.0, 1.0))], BOX);
        settle(&mut table, &start.changes);
        let mut moved = 0;
        for i in 1..=100 {
            let slots = table.update(&[(1, lamp(1.0 + 2e-5 * i as f32, 1.0))], BOX);
            if slots.changes == [SlotChange::Geometry] {
                moved += 1;
                settle(&mut table, &slots.changes);
            }
        }
        // 2 mm in all, 0.17 mm at a time.
        assert!((8..=13).contains(&moved), "projected {moved} times");
    }

    #[test]
    fn a_dark_light_is_not_projected_wherever_it_goes() {
        let mut table = SlotTable::new();
        let on = table.update(&[(1, lamp(1.0, 1.0))], BOX);
        settle(&mut table, &on.changes);
        let off = table.update(&[(1, lamp(1.0, 0.0))], BOX);
        assert_eq!(off.changes, [SlotChange::Colour]);
        settle(&mut table, &off.changes);
        assert_eq!(
            table.update(&[(1, lamp(4.0, 0.0))], BOX).changes,
            [SlotChange::None]
        );
        // Back where it was: the old projection still holds; elsewhere: it does not.
        assert_eq!(
            table.update(&[(1, lamp(1.0, 1.0))], BOX).changes,
            [SlotChange::Colour]
        );
        assert_eq!(
            table.update(&[(1, lamp(4.0, 1.0))], BOX).changes,
            [SlotChange::Geometry]
        );
        // Out of reach is dark.
        assert_eq!(
            table.update(&[(1, lamp(400.0, 1.0))], BOX).changes,
            [SlotChange::None]
        );
    }

    #[test]
    fn a_rectangle_takes_a_slot_a_patch_and_keeps_its_power() {
        let rect = Light::Rect {
            center: Vec3::ZERO,
            u: Vec3::X * 0.5,
            v: Vec3::Z,
            radiance: Vec3::splat(3.0),
        };
        let parts = SlotLight::of(&rect, 3);
        assert_eq!(parts.len(), 9);
        let total: Vec3 = parts.iter().map(|p| p.colour).sum();
        assert!((total - Vec3::splat(6.0)).abs().max_element() < 1e-5);
        let LightGeometry::Patch { position, normal } = parts[0].geometry else {
            panic!("a rectangle becomes patches");
        };
        assert!((position - Vec3::new(-1.0 / 3.0, 0.0, -2.0 / 3.0)).length() < 1e-6);
        assert_eq!(normal, Vec3::X.cross(Vec3::Z));
        assert!(
            SlotLight::of(
                &Light::Sky {
                    radiance: Vec3::ONE
                },
                3
            )
            .is_empty()
        );
    }

    #[test]
    fn what_differs_is_not_the_same() {
        let spot = |direction, inner, range| LightGeometry::Spot {
            position: Vec3::ONE,
            direction,
            inner,
            outer: 0.5,
            range,
        };
        let base = spot(Vec3::X, 0.2, f32::INFINITY);
        assert!(base.same(&base, 1e-4));
        for other in [
            spot(Vec3::Y, 0.2, f32::INFINITY),
            spot(Vec3::X, 0.3, f32::INFINITY),
            spot(Vec3::X, 0.2, 5.0),
            LightGeometry::Directional { direction: Vec3::X },
        ] {
            assert!(!base.same(&other, 1e-4));
        }
    }

    #[test]
    fn forgetting_projects_everything_again() {
        let mut table = SlotTable::new();
        let start = table.update(&[(1, lamp(1.0, 1.0)), (2, lamp(2.0, 1.0))], BOX);
        settle(&mut table, &start.changes);
        table.forget();
        assert_eq!(
            table
                .update(&[(1, lamp(1.0, 1.0)), (2, lamp(2.0, 1.0))], BOX)
                .changes,
            start.changes
        );
    }
}

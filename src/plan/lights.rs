//! Which light sits in which slot, and what changed about it since the device last computed it.
//!
//! A slot is one column of the projection g[slot][point]: a light of unit color. A rectangle takes
//! several slots, one a patch. A light keeps its slots as long as it lives, so that a light that
//! moves costs its own slots and no others. Changes are measured against what was last *projected*,
//! never against the last frame: a slow drift adds up until it counts, and frames in which the
//! scene was out of view are caught up by themselves.

use super::SlotChange;
use glam::Vec3;
use meshless_gi::internals::frame::SoftLight;
use meshless_gi::{Bounds, FrameLight};
use std::collections::BTreeMap;

/// True when a projection made for `a` serves `b`: lengths alike within `tolerance` meters,
/// directions and the numbers of a cone within 1e-5 of their size. Colors do not matter.
#[must_use]
pub fn same_projection(a: &FrameLight, b: &FrameLight, tolerance: f32) -> bool {
    let near = |p: [f32; 3], q: [f32; 3], t: f32| {
        (Vec3::from_array(p) - Vec3::from_array(q))
            .abs()
            .max_element()
            <= t
    };
    let like = |x: f32, y: f32| (x - y).abs() <= 1e-5 * x.abs().max(y.abs());
    // 1/r² changes twice as much as r, relatively.
    let range = |x: f32, y: f32| x == y || (x.powf(-0.5) - y.powf(-0.5)).abs() <= tolerance;
    a.kind == b.kind
        && near(a.position, b.position, tolerance)
        && near(a.direction, b.direction, 1e-5)
        && range(a.inverse_square_range, b.inverse_square_range)
        && like(a.spot_scale, b.spot_scale)
        && like(a.spot_offset, b.spot_offset)
}

/// True when a transport computed with color `a` serves color `b`: alike within 1e-5 of the larger
/// one, channel by channel. A scene root that turns together with its lights gives that much
/// rounding.
#[must_use]
pub fn same_color(a: [f32; 3], b: [f32; 3]) -> bool {
    a.iter()
        .zip(b)
        .all(|(x, y)| (x - y).abs() <= 1e-5 * x.abs().max(y.abs()))
}

/// True when what lights `a` do not reach is what lights `b` do not reach: the same lights in the
/// same order, lengths alike within `tolerance` meters, colors as in [`same_color`].
#[must_use]
pub fn same_soft_shadow(a: &[SoftLight], b: &[SoftLight], tolerance: f32) -> bool {
    let near = |p: [f32; 3], q: [f32; 3]| {
        let apart = (Vec3::from_array(p) - Vec3::from_array(q)).abs();
        apart.max_element() <= tolerance
    };
    let range = |x: f32, y: f32| x == y || (x.powf(-0.5) - y.powf(-0.5)).abs() <= tolerance;
    let alike = |(a, b): (&SoftLight, &SoftLight)| {
        (a.kind, a.columns, a.rows) == (b.kind, b.columns, b.rows)
            && near(a.center, b.center)
            && near(a.u, b.u)
            && near(a.v, b.v)
            && (a.radius - b.radius).abs() <= tolerance
            && range(a.inverse_square_range, b.inverse_square_range)
            && same_color(a.color, b.color)
    };
    a.len() == b.len() && a.iter().zip(b).all(alike)
}

/// False when no light of `light` can arrive in the box: it is black, or ends before.
#[must_use]
pub fn soft_light_affects(light: &SoftLight, bounds: Bounds) -> bool {
    let center = Vec3::from_array(light.center);
    let nearest = center.max(bounds.min).min(bounds.max);
    light.kind != SoftLight::NONE
        && light.color != [0.0; 3]
        && nearest.distance_squared(center) * light.inverse_square_range < 1.0
}

/// False when no light of `light` can arrive in the box: it ends before.
#[must_use]
pub fn light_affects(light: &FrameLight, bounds: Bounds) -> bool {
    match light.kind {
        FrameLight::NONE => false,
        FrameLight::POINT | FrameLight::SPOT => {
            let position = Vec3::from_array(light.position);
            let nearest = position.max(bounds.min).min(bounds.max);
            nearest.distance_squared(position) * light.inverse_square_range < 1.0
        }
        _ => true,
    }
}

/// One slot in use.
#[derive(Clone, Debug)]
struct Slot {
    /// What the world says now.
    wanted: FrameLight,
    /// What the device's projection was made for.
    projected: Option<FrameLight>,
    /// What the last update found.
    change: SlotChange,
}

/// What the table says about a frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Slots {
    /// One entry a slot.
    pub changes: Vec<SlotChange>,
    /// A slot that shone was freed.
    pub stale: bool,
}

/// The slots of one scene. `K` is what the caller knows a light by.
#[derive(Clone, Debug)]
pub struct SlotTable<K = u64> {
    /// First come, first slot; a freed slot is taken again.
    slots: Vec<Option<Slot>>,
    /// The colors that the device's transport was computed with, slot by slot.
    applied: Vec<[f32; 3]>,
    /// The slots of each light, by the caller's key.
    owners: BTreeMap<K, Vec<u32>>,
    /// A slot that the device's transport counted is no longer in the table.
    lost: bool,
}

impl<K> Default for SlotTable<K> {
    fn default() -> Self {
        Self {
            slots: Vec::new(),
            applied: Vec::new(),
            owners: BTreeMap::new(),
            lost: false,
        }
    }
}

impl<K: Copy + Ord> SlotTable<K> {
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

    /// Takes the frame's lights, in the bake's local space, and says what changed. Lights are known
    /// by their key, each of which comes once; a key that is missing has gone. A light that is
    /// black or does not reach `bounds` keeps its slots and its projection. Moves by less than 1e-5
    /// of the box's diagonal do not count (a scene root that moves together with its lights gives
    /// that much rounding).
    pub fn update(&mut self, lights: &[(K, Vec<FrameLight>)], bounds: Bounds) -> Slots {
        let tolerance = 1e-5 * bounds.size().length();
        let here: BTreeMap<K, usize> = lights.iter().map(|(k, s)| (*k, s.len())).collect();
        let gone: Vec<K> = self
            .owners
            .iter()
            .filter(|(key, held)| here.get(*key) != Some(&held.len()))
            .map(|(&key, _)| key)
            .collect();
        for key in gone {
            for slot in self.owners.remove(&key).unwrap_or_default() {
                self.slots[slot as usize] = None;
            }
        }
        let used = self.slots.iter().rposition(Option::is_some);
        self.slots.truncate(used.map_or(0, |last| last + 1));
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
                if !light_affects(&part, bounds) {
                    slot.wanted.color = [0.0; 3];
                }
            }
        }
        self.lost |= self
            .applied
            .iter()
            .skip(self.slots.len())
            .any(|c| *c != [0.0; 3]);
        self.applied.resize(self.slots.len(), [0.0; 3]);
        let mut stale = self.lost;
        let changes = self
            .slots
            .iter_mut()
            .zip(&self.applied)
            .map(|(slot, &applied)| {
                let Some(slot) = slot else {
                    stale |= applied != [0.0; 3];
                    return SlotChange::None;
                };
                let valid = |p: FrameLight| same_projection(&p, &slot.wanted, tolerance);
                let color = slot.wanted.color;
                slot.change = if color == [0.0; 3] {
                    // Dark: whatever its projection says is multiplied by zero.
                    if applied == [0.0; 3] {
                        SlotChange::None
                    } else {
                        SlotChange::Color
                    }
                } else if !slot.projected.is_some_and(valid) {
                    SlotChange::Geometry
                } else if !same_color(color, applied) {
                    SlotChange::Color
                } else {
                    SlotChange::None
                };
                slot.change
            })
            .collect();
        Slots { changes, stale }
    }

    /// The light of every slot, for the device: one that is to be projected as it is now, one that
    /// is not with the geometry that its projection was made for and its color of now.
    /// [`FrameLight::NONE`] where there is nothing to multiply.
    #[must_use]
    pub fn lights(&self) -> Vec<FrameLight> {
        let light = |slot: &Slot| match (slot.change, slot.projected) {
            (SlotChange::Geometry, _) => slot.wanted,
            (_, Some(projected)) => FrameLight {
                color: slot.wanted.color,
                ..projected
            },
            (_, None) => FrameLight::default(),
        };
        self.slots
            .iter()
            .map(|s| s.as_ref().map_or_else(FrameLight::default, light))
            .collect()
    }

    /// The device has projected these slots from [`lights`](Self::lights). One that did not ask for
    /// it was not given its geometry, so nothing is known about its projection.
    pub fn mark_projected(&mut self, slots: &[u32]) {
        for &i in slots {
            if let Some(slot) = self.slots.get_mut(i as usize).and_then(Option::as_mut)
                && slot.change == SlotChange::Geometry
            {
                slot.projected = Some(slot.wanted);
            }
        }
    }

    /// The device has run the transport with the wanted colors.
    pub fn mark_applied(&mut self) {
        self.applied = self.lights().iter().map(|l| l.color).collect();
        self.lost = false;
    }

    /// What casts shadows changed: no projection is of use any more.
    pub fn unproject(&mut self) {
        for slot in self.slots.iter_mut().flatten() {
            slot.projected = None;
        }
    }

    /// The device holds nothing any more.
    pub fn forget(&mut self) {
        self.unproject();
        self.applied.fill([0.0; 3]);
        self.lost = false;
    }

    fn take(&mut self, part: FrameLight) -> u32 {
        let slot = Some(Slot {
            wanted: part,
            projected: None,
            change: SlotChange::None,
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
mod tests;

//! Assignment of lights to slots, and changes of a slot since the device last computed it.
//!
//! A slot is one column of the projection g[slot][point] and holds a light of unit color. A
//! rectangle takes several slots, one per patch. A light keeps its slots while it exists, so a
//! light that moves costs its own slots only. Changes are measured against the last *projected*
//! values, never against the last frame. A slow drift thus adds up until it counts, and a scene
//! that was out of view catches up.

use super::SlotChange;
use glam::Vec3;
use meshless_gi::internals::frame::SoftLight;
use meshless_gi::{Bounds, FrameLight};
use std::collections::BTreeMap;

/// Length below which moves in a scene with these bounds are ignored, meters.
pub(super) fn tolerance(bounds: Bounds) -> f32 {
    1e-5 * bounds.size().length()
}

/// Returns `true` if a projection made for `a` is valid for `b`. Lengths may differ by `tolerance`
/// meters, directions by 1e-5, and cone parameters by 1e-5 of their value. Colors are ignored.
#[must_use]
pub fn same_projection(a: &FrameLight, b: &FrameLight, tolerance: f32) -> bool {
    let near = |p: [f32; 3], q: [f32; 3], t: f32| {
        (Vec3::from_array(p) - Vec3::from_array(q))
            .abs()
            .max_element()
            <= t
    };
    let like = |x: f32, y: f32| (x - y).abs() <= 1e-5 * x.abs().max(y.abs());
    // The relative change of 1/r² is twice that of r.
    let range = |x: f32, y: f32| x == y || (x.powf(-0.5) - y.powf(-0.5)).abs() <= tolerance;
    a.kind == b.kind
        && near(a.position, b.position, tolerance)
        && near(a.direction, b.direction, 1e-5)
        && range(a.inverse_square_range, b.inverse_square_range)
        && like(a.spot_scale, b.spot_scale)
        && like(a.spot_offset, b.spot_offset)
}

/// Returns `true` if a transport computed with color `a` is valid for color `b`. Channels may
/// differ by 1e-5 of the larger value: a scene root that rotates with its lights causes such
/// rounding.
#[must_use]
pub fn same_color(a: [f32; 3], b: [f32; 3]) -> bool {
    a.iter()
        .zip(b)
        .all(|(x, y)| (x - y).abs() <= 1e-5 * x.abs().max(y.abs()))
}

/// Returns `true` if the shadows of lights `a` are valid for lights `b`. Both must have the same
/// lights in the same order. Lengths may differ by `tolerance` meters, and colors as in
/// [`same_color`].
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

/// Returns `false` if no light of `light` can arrive in the box: it is black, or its range ends
/// before.
#[must_use]
pub fn soft_light_affects(light: &SoftLight, bounds: Bounds) -> bool {
    let center = Vec3::from_array(light.center);
    let nearest = center.max(bounds.min).min(bounds.max);
    light.kind != SoftLight::NONE
        && light.color != [0.0; 3]
        && nearest.distance_squared(center) * light.inverse_square_range < 1.0
}

/// Returns `false` if no light of `light` can arrive in the box: its range ends before.
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

/// Slot in use.
#[derive(Clone, Debug)]
struct Slot {
    /// Light in the current frame.
    current: FrameLight,
    /// Light that the device's projection was made for.
    projected: Option<FrameLight>,
    /// Change found by the last update.
    change: SlotChange,
}

/// Changes of the table in one frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Slots {
    /// Changes, one entry per slot.
    pub changes: Vec<SlotChange>,
    /// `true` if a slot with light was freed.
    pub stale: bool,
}

/// Light slots of one scene. `K` identifies a light.
#[derive(Clone, Debug)]
pub struct SlotTable<K = u64> {
    /// Slots in order of assignment. A freed slot is reused.
    slots: Vec<Option<Slot>>,
    /// Colors that the device's transport was computed with, per slot.
    applied: Vec<[f32; 3]>,
    /// Slots of each light, by the caller's key.
    owners: BTreeMap<K, Vec<u32>>,
    /// `true` if a slot that the device's transport includes is no longer in the table.
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
    /// Creates an empty table.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Returns the number of slots, including free ones.
    #[must_use]
    pub fn len(&self) -> usize {
        self.slots.len()
    }

    /// Returns `true` if there are no slots.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.slots.is_empty()
    }

    /// Sets the frame's lights, in the bake's local space, and returns the changes. Each key occurs
    /// once, and a light whose key is missing is removed. A light that is black or does not reach
    /// `bounds` keeps its slots and its projection. Moves by less than 1e-5 of the box's diagonal
    /// are ignored: a scene root that moves with its lights causes such rounding.
    pub fn update(&mut self, lights: &[(K, Vec<FrameLight>)], bounds: Bounds) -> Slots {
        let tolerance = tolerance(bounds);
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
                slot.current = part;
                if !light_affects(&part, bounds) {
                    slot.current.color = [0.0; 3];
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
                let valid = |p: FrameLight| same_projection(&p, &slot.current, tolerance);
                let color = slot.current.color;
                slot.change = if color == [0.0; 3] {
                    // The projection of a dark slot is multiplied by zero.
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

    /// Returns the light of every slot, for the device. A slot to be projected has its current
    /// light. Any other has the geometry of its projection and its current color.
    /// [`FrameLight::NONE`] if there is no projection.
    #[must_use]
    pub fn lights(&self) -> Vec<FrameLight> {
        let light = |slot: &Slot| match (slot.change, slot.projected) {
            (SlotChange::Geometry, _) => slot.current,
            (_, Some(projected)) => FrameLight {
                color: slot.current.color,
                ..projected
            },
            (_, None) => FrameLight::default(),
        };
        self.slots
            .iter()
            .map(|s| s.as_ref().map_or_else(FrameLight::default, light))
            .collect()
    }

    /// Marks slots as projected from [`lights`](Self::lights). Ignores slots without
    /// [`SlotChange::Geometry`], because their current geometry was not on the device.
    pub fn mark_projected(&mut self, slots: &[u32]) {
        for &i in slots {
            if let Some(slot) = self.slots.get_mut(i as usize).and_then(Option::as_mut)
                && slot.change == SlotChange::Geometry
            {
                slot.projected = Some(slot.current);
            }
        }
    }

    /// Marks the transport as computed with the current colors.
    pub fn mark_applied(&mut self) {
        self.applied = self.lights().iter().map(|l| l.color).collect();
        self.lost = false;
    }

    /// Discards all projections, after a shadow caster changed.
    pub fn unproject(&mut self) {
        for slot in self.slots.iter_mut().flatten() {
            slot.projected = None;
        }
    }

    /// Discards all values, after the device released the scene.
    pub fn reset(&mut self) {
        self.unproject();
        self.applied.fill([0.0; 3]);
        self.lost = false;
    }

    fn take(&mut self, part: FrameLight) -> u32 {
        let slot = Some(Slot {
            current: part,
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

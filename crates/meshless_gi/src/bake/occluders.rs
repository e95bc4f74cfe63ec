//! Occluders of a recipe: nodes of the scene by name, or boxes. Indexes the link terms that cross
//! them.

use super::BakeError;
use super::recipe::RecipeError;
use crate::asset::Occluders;
use crate::scene::{Bounds, BoxPlanes, Bvh, Geometry, Occluder};
use crate::transport::{PackedLinkTerm, UnindexedLinkTerm, number_sets};
#[cfg(feature = "bevy_reflect")]
use bevy_reflect::std_traits::ReflectDefault;
use glam::Vec3;
use serde::{Deserialize, Serialize};

/// Largest number of boxes of an occluder.
const MAX_BOXES: usize = 4096;
/// Length of the longest name, in bytes.
const MAX_NAME_BYTES: usize = 256;

/// Part of the scene that a game opens and closes, such as a door or a lift.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(
    feature = "bevy_reflect",
    derive(bevy_reflect::Reflect),
    reflect(Default, Clone, Debug, PartialEq)
)]
#[serde(deny_unknown_fields)]
pub struct OccluderDesc {
    /// Name of the occluder. Without boxes the occluder is the subtree of the scene node with this
    /// name.
    pub name: String,
    /// Boxes of an occluder without a scene node. Empty by default.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub boxes: Vec<OccluderBox>,
}

/// Axis-aligned box in the space of the bake.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(
    feature = "bevy_reflect",
    derive(bevy_reflect::Reflect),
    reflect(Default, Clone, Debug, PartialEq)
)]
#[serde(deny_unknown_fields)]
pub struct OccluderBox {
    /// Center, in meters.
    pub center: [f32; 3],
    /// Half of the edge lengths, in meters.
    pub half_edges: [f32; 3],
}

impl From<&str> for OccluderDesc {
    /// Creates the occluder of the node with this name.
    fn from(name: &str) -> Self {
        Self::node(name)
    }
}

impl OccluderDesc {
    /// Creates the occluder of the node with this name.
    #[must_use]
    pub fn node(name: impl Into<String>) -> Self {
        Self {
            name: name.into(),
            boxes: Vec::new(),
        }
    }
}

impl OccluderBox {
    fn bounds(&self) -> Bounds {
        let (center, half) = (Vec3::from(self.center), Vec3::from(self.half_edges));
        Bounds {
            min: center - half,
            max: center + half,
        }
    }
}

/// Checks everything that does not depend on the scene.
pub(super) fn check_occluders(shapes: &[OccluderDesc]) -> Result<(), RecipeError> {
    let wrong = |value: String, allowed| RecipeError::out_of_range("occluders", value, allowed);
    if shapes.len() > Bvh::MAX_OCCLUDERS {
        let value = format!("a list of {} entries", shapes.len());
        return Err(wrong(value, "a list of at most 64 entries"));
    }
    for (i, shape) in shapes.iter().enumerate() {
        if !(1..=MAX_NAME_BYTES).contains(&shape.name.len()) {
            let value = format!("a list with a name of {} bytes", shape.name.len());
            return Err(wrong(value, "a list with names of 1 to 256 bytes"));
        }
        if shapes[..i].iter().any(|other| other.name == shape.name) {
            let value = format!("a list with two occluders `{}`", shape.name);
            return Err(wrong(value, "a list with unique names"));
        }
        if shape.boxes.len() > MAX_BOXES {
            let value = format!("a list of {} boxes for `{}`", shape.boxes.len(), shape.name);
            return Err(wrong(value, "a list with at most 4096 boxes per occluder"));
        }
        let sound = |b: &OccluderBox| {
            b.center.iter().all(|c| c.abs() < 1e9)
                && b.half_edges.iter().all(|h| (1e-9..1e9).contains(h))
        };
        if let Some(b) = shape.boxes.iter().find(|b| !sound(b)) {
            let value = format!("a list in which `{}` has {b:?}", shape.name);
            let allowed = "a list of boxes with centers within 1e9 m and half edges 1e-9 to 1e9 m";
            return Err(wrong(value, allowed));
        }
    }
    Ok(())
}

/// Returns the names of the nodes that occluders without boxes refer to.
pub(super) fn node_names(shapes: &[OccluderDesc]) -> Vec<&str> {
    let nodes = shapes.iter().filter(|s| s.boxes.is_empty());
    nodes.map(|s| s.name.as_str()).collect()
}

/// Returns the geometry of each occluder: its boxes, or the triangles of its node. `geometry` is
/// the scene without the occluders.
pub(super) fn find(
    shapes: &[OccluderDesc],
    parts: &[Occluder],
    geometry: &dyn Geometry,
) -> Result<Vec<Occluder>, BakeError> {
    let one = |shape: &OccluderDesc| {
        let part = parts.iter().find(|p| p.name == shape.name);
        let part = part.filter(|_| shape.boxes.is_empty());
        let occluder = Occluder {
            name: shape.name.clone(),
            triangles: part.map_or_else(Vec::new, |p| p.triangles.clone()),
            boxes: (shape.boxes.iter())
                .map(|b| BoxPlanes::new(b.bounds(), geometry))
                .collect(),
        };
        match occluder.shapes().is_empty() {
            true => Err(BakeError::UnknownOccluder {
                name: occluder.name,
            }),
            false => Ok(occluder),
        }
    };
    shapes.iter().map(one).collect()
}

/// Returns the occluder data of the scene: the terms of the operator's links and of the probes'
/// links that cross them. Returns `None` without occluders.
pub(super) fn index_terms(
    occluders: &[Occluder],
    link_terms: &[UnindexedLinkTerm],
    space: &[UnindexedLinkTerm],
) -> Result<Option<Occluders>, BakeError> {
    if occluders.is_empty() {
        return Ok(None);
    }
    let max = PackedLinkTerm::MAX_SETS;
    let (sets, [links, probes]) =
        number_sets([link_terms, space]).ok_or(BakeError::TooManyOccluderSets { max })?;
    Ok(Some(Occluders {
        names: occluders.iter().map(|o| o.name.clone()).collect(),
        sets,
        links,
        probes,
    }))
}

//! Occluders: doors and lifts of a bake that a game opens and shuts, in the frame in which they
//! move.

use bevy::ecs::prelude::*;
use bevy::reflect::prelude::*;
use meshless_gi::internals::asset::Occluders;

/// How far an occluder of a bake stands open. Goes on any entity, the door's own as a rule; it
/// lights nothing and is found by its name in every bake that knows it. Needs a bake whose recipe
/// names it (`occluders: [(name: "door")]`, or `--occluder door`).
///
/// What passes it is a share, the same all over it: a door half open lets half of the light
/// through. Where several entities have the same name, the least open of them counts; an occluder
/// that no entity names stands open. The indirect light follows; direct light and its shadows are
/// Bevy's own, of the mesh that is drawn.
#[derive(Component, Reflect, Clone, Debug, PartialEq)]
#[reflect(Component, Default, Clone, Debug, PartialEq)]
pub struct GiOccluder {
    /// Its name in the recipe.
    pub name: String,
    /// From 0, shut, to 1, open. What is no number is shut.
    pub transmittance: f32,
}

impl Default for GiOccluder {
    fn default() -> Self {
        Self {
            name: String::new(),
            transmittance: 1.0,
        }
    }
}

/// What passes the occluders of a bake now: the least of all that is said of each.
pub(crate) fn gains<'a>(known: &Occluders, said: impl Iterator<Item = &'a GiOccluder>) -> Vec<f32> {
    let mut gains = vec![1.0f32; known.names.len()];
    for occluder in said {
        let called = known.names.iter().position(|name| *name == occluder.name);
        if let Some(gain) = called.and_then(|k| gains.get_mut(k)) {
            let open = match occluder.transmittance.is_nan() {
                true => 0.0,
                false => occluder.transmittance.clamp(0.0, 1.0),
            };
            *gain = gain.min(open);
        }
    }
    gains
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn occluder_with_lowest_transmittance_wins() {
        let known = Occluders {
            names: vec!["door".into(), "lift".into(), "gate".into()],
            ..Occluders::default()
        };
        let said = [
            ("door", 0.75),
            ("gate", f32::NAN),
            ("door", 0.25),
            ("window", 0.0),
            ("lift", 3.0),
        ]
        .map(|(name, transmittance)| GiOccluder {
            name: name.into(),
            transmittance,
        });
        assert_eq!(gains(&known, said.iter()), [0.25, 1.0, 0.0]);
        assert_eq!(gains(&known, [].iter()), [1.0; 3]);
    }
}

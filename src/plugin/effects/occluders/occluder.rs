//! [`GiOccluder`]: doors and other occluders of a bake that a game opens and closes.

use bevy::ecs::prelude::*;
use bevy::reflect::prelude::*;
use meshless_gi::internals::asset::Occluders;

/// Transmittance of an occluder of a bake. Goes on any entity, usually the door itself. The
/// occluder is identified by its name, in every bake that has it.
///
/// The recipe of the bake must list the occluder (`occluders: [(name: "door")]`, or
/// `--occluder door`). Indirect light follows in the frame of the change. Direct light and its
/// shadows come from the mesh that Bevy draws.
///
/// If several entities have the same name, the smallest transmittance applies. An occluder without
/// an entity is open.
#[derive(Component, Reflect, Clone, Debug, PartialEq)]
#[reflect(Component, Default, Clone, Debug, PartialEq)]
pub struct GiOccluder {
    /// Name of the occluder in the recipe.
    pub name: String,
    /// Fraction of the light that passes, the same everywhere on the occluder: 0 (closed) to 1
    /// (open). Values outside are clamped, NaN counts as 0. Default: 1.
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

/// Transmittances of a bake's occluders: the smallest value of all components with the name.
pub(crate) fn transmittances<'a>(
    occluders: &Occluders,
    components: impl Iterator<Item = &'a GiOccluder>,
) -> Vec<f32> {
    let mut transmittances = vec![1.0f32; occluders.names.len()];
    for occluder in components {
        let index = occluders.names.iter().position(|n| *n == occluder.name);
        if let Some(smallest) = index.and_then(|k| transmittances.get_mut(k)) {
            let transmittance = match occluder.transmittance.is_nan() {
                true => 0.0,
                false => occluder.transmittance.clamp(0.0, 1.0),
            };
            *smallest = smallest.min(transmittance);
        }
    }
    transmittances
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn occluders_with_same_name_use_lowest_transmittance() {
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
        assert_eq!(transmittances(&known, said.iter()), [0.25, 1.0, 0.0]);
        assert_eq!(transmittances(&known, [].iter()), [1.0; 3]);
    }
}

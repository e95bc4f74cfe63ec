//! Shader module for irradiance volumes. When a scene has a [`GiIrradianceVolume`], it replaces
//! Bevy's module and takes walls between voxels into account
//! (`shaders/engine/irradiance_volume.wgsl`; twin:
//! [`read_volume`](meshless_gi::internals::frame::volume_sample::read_volume)). Volumes of the game
//! do not change.
//!
//! Bevy supports this at run time: the asset is replaced, and pipelines that import it are rebuilt.
//! A module that differs from the supported release is kept, with a warning. Light then leaks
//! through walls.

use crate::plugin::effects::volume::irradiance_volume::GiIrradianceVolume;
use crate::plugin::forward_camera::GiForwardCamera;
use crate::plugin::validation::{GiWarning, GiWarnings, add_warnings};
use bevy::asset::Assets;
use bevy::ecs::prelude::*;
use bevy::shader::{Shader, ShaderImport, Source};

/// Source of the plugin's module.
const PLUGIN_SHADER: &str = include_str!("../../../../shaders/engine/irradiance_volume.wgsl");
/// Import name of the module in Bevy's shaders.
const MODULE: &str = "bevy_pbr::irradiance_volume";
/// Call in Bevy's module, without spaces.
const BEVY_SIGNATURE: &str = "fnirradiance_volume_light(world_position:vec3<f32>,N:vec3<f32>,clusterable_object_index_ranges:ptr<function,ClusterableObjectIndexRanges>,)->vec3<f32>{";
/// Lookup in Bevy's module, without spaces.
const BEVY_LOOKUP: &str = "light_probe_iterator_next(&iterator)";

/// Definition of the module for cameras with a display ([`crate::plugin::forward_display`]).
const DISPLAY: &str = "MESHLESS_GI_DISPLAY";

/// State of the module.
#[derive(Clone, Copy, Default, PartialEq, Eq)]
pub(crate) enum Module {
    /// Bevy's module.
    #[default]
    Bevy,
    /// Bevy's module, kept because it differs from the supported release.
    Unknown,
    /// The plugin's module, with or without the display of forward cameras.
    Plugin { display: bool },
}

/// Replaces the module when Bevy has loaded it and a scene has a volume, and once more for the
/// first display of a forward camera. Runs in
/// [`GiSystems::UpdateVolumes`](crate::plugin::GiSystems::UpdateVolumes).
pub(crate) fn replace(
    volumes: Query<(), With<GiIrradianceVolume>>,
    displays: Query<(), With<GiForwardCamera>>,
    shaders: Option<ResMut<Assets<Shader>>>,
    mut findings: ResMut<GiWarnings>,
    mut module: Local<Module>,
) {
    let display = !displays.is_empty();
    let needed = match *module {
        Module::Bevy => true,
        Module::Unknown => false,
        Module::Plugin { display: has } => display && !has,
    };
    let Some(mut shaders) = shaders.filter(|_| needed && !volumes.is_empty()) else {
        return;
    };
    let found = shaders.iter().find(|(_, shader)| is_module(shader));
    let Some((id, theirs)) = found else {
        return;
    };
    if *module == Module::Bevy && !is_known(theirs) {
        *module = Module::Unknown;
        add_warnings(vec![GiWarning::VolumeShader], &mut findings);
        return;
    }
    let ours = replace_shader(theirs, display);
    *module = Module::Plugin { display };
    // The id exists, so the insertion cannot fail.
    let _ = shaders.insert(id, ours);
}

fn replace_shader(theirs: &Shader, display: bool) -> Shader {
    let mut defs = theirs.shader_defs.clone();
    defs.extend(display.then(|| DISPLAY.into()));
    Shader::from_wgsl_with_defs(PLUGIN_SHADER, &theirs.path, defs)
}

fn is_module(shader: &Shader) -> bool {
    matches!(&shader.import_path, ShaderImport::Custom(name) if name == MODULE)
}

/// Returns `true` if the module is called and looks up probes like the plugin's module.
fn is_known(shader: &Shader) -> bool {
    let Source::Wgsl(text) = &shader.source else {
        return false;
    };
    let dense: String = text.split_whitespace().collect();
    dense.contains(BEVY_SIGNATURE) && dense.contains(BEVY_LOOKUP)
}

#[cfg(test)]
mod tests {
    use super::*;
    use bevy::ecs::system::RunSystemOnce;

    const HEAD: &str = "#define_import_path bevy_pbr::irradiance_volume\n";

    /// Returns a module with this text as it is in a world with a volume, and whether a warning is
    /// reported.
    fn replaced_module(text: &str, volume: bool) -> (String, bool) {
        let mut world = World::new();
        world.init_resource::<Assets<Shader>>();
        world.init_resource::<GiWarnings>();
        let shader = Shader::from_wgsl(format!("{HEAD}{text}"), "a.wgsl");
        let handle = world.resource_mut::<Assets<Shader>>().add(shader);
        if volume {
            world.spawn(GiIrradianceVolume::default());
        }
        world.run_system_once(replace).expect("it runs");
        let shaders = world.resource::<Assets<Shader>>();
        let Source::Wgsl(text) = &shaders.get(&handle).expect("still there").source else {
            panic!("no WGSL");
        };
        let has_warned = !world.resource::<GiWarnings>().0.is_empty();
        (text.to_string(), has_warned)
    }

    #[test]
    fn shader_module_is_replaced_if_known_and_requested() {
        let known = "fn irradiance_volume_light(world_position: vec3<f32>, N: vec3<f32>,\n    clusterable_object_index_ranges: ptr<function, ClusterableObjectIndexRanges>,) -> vec3<f32> {\n    let found = light_probe_iterator_next(&iterator);\n}";
        assert_eq!(
            replaced_module(known, true),
            (PLUGIN_SHADER.to_owned(), false)
        );
        assert_eq!(
            replaced_module(known, false),
            (format!("{HEAD}{known}"), false)
        );
        for (from, to) in [
            ("N: vec3<f32>", "N: vec4<f32>"),
            ("(&iterator)", "(iterator)"),
        ] {
            let other = known.replace(from, to);
            assert_ne!(other, known);
            assert_eq!(
                replaced_module(&other, true),
                (format!("{HEAD}{other}"), true)
            );
        }
    }
}

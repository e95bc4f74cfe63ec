//! Inspectors: every component, settings resource and loader setting of the plugin is in the type
//! registry, with all its fields.

use crate::support::app::{app, camera, run, target};
use crate::support::scenes::cornell;
use crate::support::stage::{spawn_baked, spawn_light_source, view};
use bevy::ecs::reflect::{AppTypeRegistry, ReflectComponent, ReflectResource};
use bevy::prelude::*;
use bevy::reflect::std_traits::ReflectDefault;
use bevy::reflect::{PartialReflect, ReflectMut, ReflectRef, TypeRegistration, TypeRegistry};
use bevy_meshless_gi::internals::plugin::GiPointCloudPart;
use bevy_meshless_gi::point_cloud::GiPointCloud;
use bevy_meshless_gi::prelude::*;
use meshless_gi::{Preset, Recipe, cornell_box, mesh_of_quads};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// Public types that hold no settings, and what they hold.
const STATE: [(&str, &str); 3] = [
    ("GiBakeTask", "a thread"),
    ("SharedCoefficients", "a channel between the worlds"),
    ("GiFrameStats", "a channel between the worlds"),
];

/// Types without a default: only the plugin makes them.
const MADE: [&str; 1] = ["GiRsmCamera"];

fn files_below(folder: &Path, out: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        match path.is_dir() {
            true => files_below(&path, out),
            false => out.push(path),
        }
    }
}

/// The plugin's sources.
fn sources() -> Vec<String> {
    let mut files = Vec::new();
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    files_below(&root.join("src/plugin"), &mut files);
    files.push(root.join("src/plan/settings.rs"));
    let texts = files.iter().map(|f| std::fs::read_to_string(f).unwrap());
    texts.collect()
}

/// Names of the public types whose source derives `of`.
fn deriving(of: &str) -> BTreeSet<String> {
    let mut found = BTreeSet::new();
    for text in sources() {
        let mut derived = false;
        for line in text.lines().map(str::trim) {
            let item = ["pub", "struct", "enum", "impl", "fn"];
            if let Some(list) = line.trim_start_matches("#[").strip_prefix("derive(") {
                let mut names = list.split([',', ')', ' ', '(', ':']);
                derived |= names.any(|name| name == of);
            } else if item.iter().any(|word| line.starts_with(word)) {
                let public = line.strip_prefix("pub struct ");
                let public = public.or(line.strip_prefix("pub enum "));
                if let Some(name) = public.filter(|_| derived) {
                    let end = name.find(|c: char| !c.is_alphanumeric());
                    found.insert(name[..end.unwrap_or(name.len())].to_string());
                }
                derived = false;
            }
        }
    }
    let state = STATE.map(|(name, _)| name.to_string());
    found.retain(|name| !state.contains(name));
    found
}

/// An app without renderer. Its registry holds what plugins registered by name, and nothing that
/// the compiler collected.
fn app_of_registrations() -> App {
    let mut app = App::new();
    app.insert_resource(AppTypeRegistry::default())
        .add_plugins((
            MinimalPlugins,
            AssetPlugin::default(),
            TransformPlugin,
            MeshlessGiPlugin::default(),
        ));
    app
}

fn registration<'a>(registry: &'a TypeRegistry, name: &str) -> &'a TypeRegistration {
    let found = registry.get_with_short_type_path(name);
    let found = found.unwrap_or_else(|| panic!("{name} is not registered"));
    let path = found.type_info().type_path();
    assert!(path.starts_with("bevy_meshless_gi::"), "{path}");
    found
}

#[test]
fn component_resource_and_setting_types_are_registered() {
    let app = app_of_registrations();
    let registry = app.world().resource::<AppTypeRegistry>().read();
    let components = deriving("Component");
    let resources = deriving("Resource");
    let mut settings = deriving("Deserialize");
    settings.extend(deriving("GizmoConfigGroup"));
    println!("{components:?}\n{resources:?}\n{settings:?}");
    assert!(components.len() >= 17 && resources.len() >= 3 && settings.len() >= 4);
    for name in &components {
        let found = registration(&registry, name).data::<ReflectComponent>();
        assert!(
            found.is_some(),
            "{name} is registered without ReflectComponent"
        );
    }
    for name in &resources {
        let found = registration(&registry, name).data::<ReflectResource>();
        assert!(
            found.is_some(),
            "{name} is registered without ReflectResource"
        );
    }
    for name in components.iter().chain(&resources).chain(&settings) {
        let default = registration(&registry, name).data::<ReflectDefault>();
        let made = MADE.contains(&name.as_str());
        assert_eq!(default.is_none(), made, "default of {name}");
    }
    // No field is hidden.
    let hidden = sources()
        .iter()
        .filter(|t| t.contains("reflect(ignore"))
        .count();
    assert_eq!(hidden, 0);
}

/// Adds every value below `value` with its path.
fn walk(value: &dyn PartialReflect, path: &str, out: &mut BTreeMap<String, String>) {
    let mut below = |name: String, field: Option<&dyn PartialReflect>| {
        let field = field.unwrap_or_else(|| panic!("{path}.{name} is counted, and not there"));
        walk(field, &format!("{path}.{name}"), out);
    };
    match value.reflect_ref() {
        ReflectRef::Struct(of) => (0..of.field_len()).for_each(|i| {
            let name = of.name_at(i).expect("a field has a name");
            below(name.into(), of.field_at(i));
        }),
        ReflectRef::TupleStruct(of) => {
            (0..of.field_len()).for_each(|i| below(i.to_string(), of.field(i)));
        }
        ReflectRef::Tuple(of) => {
            (0..of.field_len()).for_each(|i| below(i.to_string(), of.field(i)));
        }
        ReflectRef::List(of) => (0..of.len()).for_each(|i| below(i.to_string(), of.get(i))),
        ReflectRef::Array(of) => (0..of.len()).for_each(|i| below(i.to_string(), of.get(i))),
        ReflectRef::Enum(of) => {
            let name = of.variant_name().to_string();
            (0..of.field_len()).for_each(|i| below(format!("{name}.{i}"), of.field_at(i)));
            out.insert(path.into(), name);
        }
        _ => {
            out.insert(path.into(), format!("{value:?}"));
        }
    }
}

/// An app with a scene, a camera, lights, and everything else that has a component of the plugin.
fn full_world() -> App {
    let mut app = app();
    let (room, bake) = cornell();
    let root = spawn_baked(&mut app, &room, &bake, Transform::IDENTITY);
    let image = target(&mut app);
    let eye = (camera(&image, view()), GiCamera::default());
    let light_source = spawn_light_source(&mut app, Vec3::new(-0.3, 1.5, 0.3));
    let ball = Mesh::from(Sphere::new(0.2));
    let ball = app.world_mut().resource_mut::<Assets<Mesh>>().add(ball);
    let baked = Mesh3d(ball.clone());
    let mut materials = app.world_mut().resource_mut::<Assets<StandardMaterial>>();
    let material = materials.add(StandardMaterial::default());
    let gray = material.clone();
    let recipe = Recipe {
        preset: Preset::High,
        rays_per_point: Some(60_000),
        ..default()
    };
    let world = app.world_mut();
    world.entity_mut(root).insert((
        GiDynamicMaterials(vec![("wall".into(), Handle::default())]),
        GiVolumetricFog::default(),
    ));
    world.spawn((eye, GiSpecular::default()));
    world.entity_mut(light_source).insert((
        GiLight::default(),
        GiReflectiveShadowMap::default(),
        GiSoftShadow::default(),
    ));
    world.spawn((
        GiReflector,
        Mesh3d(ball),
        MeshMaterial3d(material),
        Transform::from_xyz(0.0, 0.5, 0.5),
    ));
    world.spawn(GiOccluder::default());
    world.spawn(GiPointCloud::default());
    // The point cloud has one part: its own. This one has no cloud.
    world.spawn(GiPointCloudPart);
    world.spawn(GiBakeExclude);
    let forward = (camera(&image, view()), GiForwardCamera::default());
    world.spawn(forward);
    // Bakes that last longer than the test.
    let mesh = mesh_of_quads(&cornell_box());
    world.spawn(GiBakeTask::spawn(mesh, recipe.clone()));
    let request = GiBakeRequest {
        recipe,
        ..default()
    };
    world.spawn((request, baked, MeshMaterial3d(gray)));
    run(&mut app, 3);
    app
}

#[test]
fn reflected_components_expose_every_field() {
    let mut app = full_world();
    let world = app.world_mut();
    let entities: Vec<Entity> = {
        let mut all = world.query::<Entity>();
        all.iter(world).collect()
    };
    let world = app.world();
    let registry = world.resource::<AppTypeRegistry>().read();
    let mut seen: BTreeMap<String, BTreeMap<String, String>> = BTreeMap::new();
    let found = world.components().iter_registered();
    for registration in found.filter_map(|info| registry.get(info.type_id()?)) {
        let table = registration.type_info().type_path_table();
        let Some(component) = registration
            .data::<ReflectComponent>()
            .filter(|_| table.path().starts_with("bevy_meshless_gi::"))
        else {
            continue;
        };
        let name = table.short_path();
        for entity in &entities {
            if let Some(value) = component.reflect(world.entity(*entity)) {
                let fields = seen.entry(name.into()).or_default();
                walk(value.as_partial_reflect(), name, fields);
            }
        }
    }
    let names: BTreeSet<String> = seen.keys().cloned().collect();
    let wanted = deriving("Component");
    let missing: Vec<_> = wanted.difference(&names).collect();
    assert!(missing.is_empty(), "not in the world: {missing:?}");
    // Values of all depths: settings, an element of a list, an output.
    for (path, value) in [
        ("GiCamera.intensity", "1.0"),
        ("GiSolver.bounces", "Fixed"),
        ("GiActiveTier.why", "\"nothing less was asked for\""),
        ("GiDynamicMaterials.0.0.0", "\"wall\""),
    ] {
        let component = path.split('.').next().expect("a first part");
        let fields = &seen[component];
        let found = fields.get(path).map(String::as_str);
        assert_eq!(found, Some(value), "{path}: {fields:?}");
    }
}

#[test]
fn field_written_by_reflection_changes_component() {
    let mut app = app();
    let root = app.world_mut().spawn(GiEnvironment::default()).id();
    let registry = app.world().resource::<AppTypeRegistry>().clone();
    let registry = registry.read();
    let component = registration(&registry, "GiEnvironment").data::<ReflectComponent>();
    let component = component.expect("a component");
    let mut value = component
        .reflect_mut(app.world_mut().entity_mut(root))
        .expect("it is there");
    let ReflectMut::Struct(fields) = value.reflect_mut() else {
        panic!("GiEnvironment is a struct");
    };
    let field = fields.field_mut("emissive_luminance").expect("a field");
    field.apply(&0.25f32);
    let environment = app.world().get::<GiEnvironment>(root).unwrap();
    assert_eq!(environment.emissive_luminance, 0.25);
}

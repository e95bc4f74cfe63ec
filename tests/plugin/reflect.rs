//! Reflection for inspectors: every component, resource, event and setting of the plugin is in the
//! type registry with all fields. The lists of types come from the plugin's sources and from the
//! world that it builds.

use crate::support::app::{app, camera, run, target};
use crate::support::scenes::cornell;
use crate::support::stage::{spawn_baked, spawn_light_source, view};
use bevy::ecs::reflect::{
    AppTypeRegistry, ReflectComponent, ReflectEvent, ReflectMessage, ReflectResource,
};
use bevy::prelude::*;
use bevy::reflect::std_traits::ReflectDefault;
use bevy::reflect::{
    PartialReflect, ReflectMut, ReflectRef, TypePath, TypeRegistration, TypeRegistry,
};
use bevy_meshless_gi::internals::plugin::PointCloudPart;
use bevy_meshless_gi::point_cloud::GiPointCloud;
use bevy_meshless_gi::prelude::*;
use meshless_gi::{Preset, Quad, Recipe, TriangleMesh};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// Types without a default. Only the plugin or a function creates them.
const TYPES_WITHOUT_DEFAULT: [&str; 4] = [
    "GiRsmCamera",
    "GiBakeTask",
    "GiBakeFinished",
    "GiRecipeProgress",
];

/// Returns `true` if the root of the library exports the type `name`.
fn is_public(name: &str) -> bool {
    let root = include_str!("../../src/lib.rs");
    let mut words = root.split(|c: char| !c.is_alphanumeric() && c != '_');
    words.any(|word| word == name)
}

fn files_below(folder: &Path, out: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        match path.is_dir() {
            true => files_below(&path, out),
            false => out.push(path),
        }
    }
}

/// Returns the texts of the plugin's source files.
fn sources() -> Vec<String> {
    let mut files = Vec::new();
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    files_below(&root.join("src/plugin"), &mut files);
    files.push(root.join("src/plan/settings.rs"));
    let texts = files.iter().map(|f| std::fs::read_to_string(f).unwrap());
    texts.collect()
}

/// Adds the names of the public types of a source file that derive `of` to `out`.
fn add_types_deriving(text: &str, of: &str, out: &mut BTreeSet<String>) {
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
                out.insert(name[..end.unwrap_or(name.len())].to_string());
            }
            derived = false;
        }
    }
}

/// Returns the names of the exported types with a source that derives one of `traits`.
fn types_deriving(traits: &[&str]) -> BTreeSet<String> {
    let mut found = BTreeSet::new();
    for text in sources() {
        for of in traits {
            add_types_deriving(&text, of, &mut found);
        }
    }
    found.retain(|name| is_public(name));
    found
}

/// Counts the components and resources of this crate in the world, and returns the names missing
/// from its registry. `prefix` starts the type paths of the crate. The compiler collects the
/// types that derive `Reflect`. Types that do not derive it have no name without Bevy's feature
/// `debug`.
fn unregistered_types(
    world: &World,
    prefix: &str,
    is_public: impl Fn(&str) -> bool,
) -> (usize, Vec<String>) {
    let mut reflected = TypeRegistry::new();
    reflected.register_derived_types();
    let registry = world.resource::<AppTypeRegistry>().read();
    let (mut count, mut missing) = (0, Vec::new());
    for info in world.components().iter_registered() {
        let Some(found) = info.type_id().and_then(|id| reflected.get(id)) else {
            continue;
        };
        let table = found.type_info().type_path_table();
        if table.path().starts_with(prefix) && is_public(table.short_path()) {
            count += 1;
            if !registry.contains(found.type_id()) {
                missing.push(table.short_path().to_string());
            }
        }
    }
    (count, missing)
}

/// Creates an app without renderer. Its registry contains only types that plugins register by name,
/// and none that the compiler collected.
fn app_with_registered_types() -> App {
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
fn component_resource_event_and_setting_types_are_registered() {
    let app = app_with_registered_types();
    let registry = app.world().resource::<AppTypeRegistry>().read();
    let components = types_deriving(&["Component"]);
    let resources = types_deriving(&["Resource"]);
    let events = types_deriving(&["Event", "EntityEvent"]);
    let messages = types_deriving(&["Message"]);
    let settings = types_deriving(&["Deserialize", "GizmoConfigGroup"]);
    println!("{components:?}\n{resources:?}\n{events:?}\n{messages:?}\n{settings:?}");
    assert!(components.len() >= 19 && resources.len() >= 4 && settings.len() >= 5);
    assert!(!events.is_empty() && !messages.is_empty());
    let with = |names: &BTreeSet<String>, has: fn(&TypeRegistration) -> bool, data: &str| {
        for name in names {
            let found = has(registration(&registry, name));
            assert!(found, "{name} is registered without {data}");
        }
    };
    with(
        &components,
        |r| r.contains::<ReflectComponent>(),
        "ReflectComponent",
    );
    with(
        &resources,
        |r| r.contains::<ReflectResource>(),
        "ReflectResource",
    );
    with(&events, |r| r.contains::<ReflectEvent>(), "ReflectEvent");
    with(
        &messages,
        |r| r.contains::<ReflectMessage>(),
        "ReflectMessage",
    );
    let lists = [components, resources, events, messages, settings];
    for name in lists.iter().flatten() {
        let default = registration(&registry, name).data::<ReflectDefault>();
        let made = TYPES_WITHOUT_DEFAULT.contains(&name.as_str());
        assert_eq!(default.is_none(), made, "default of {name}");
    }
    // Only fields of a running bake are hidden.
    let hidden = sources().into_iter();
    let hidden: Vec<String> = hidden.filter(|t| t.contains("reflect(ignore")).collect();
    assert!(hidden.len() == 1 && hidden[0].contains("pub struct GiBakeTask"));
}

/// Component that no code registers.
#[derive(Component, Reflect)]
#[reflect(Component)]
struct GiUnregistered;

#[test]
fn components_and_resources_of_the_world_are_registered() {
    let mut app = app_with_registered_types();
    app.finish();
    app.update();
    let ours = |world: &World| unregistered_types(world, "bevy_meshless_gi::", is_public);
    let (count, missing) = ours(app.world());
    println!("{count} components and resources");
    assert!(count >= 15 && missing.is_empty(), "{count}: {missing:?}");
    // Must fail: a component of another crate that no code registers.
    app.world_mut().spawn(GiUnregistered);
    let path = GiUnregistered::type_path();
    let (_, missing) = unregistered_types(app.world(), path, |_| true);
    assert_eq!(missing, ["GiUnregistered"]);
    // Must fail: a registry without the plugin's types.
    app.insert_resource(AppTypeRegistry::default());
    assert_eq!(ours(app.world()).1.len(), count);
    // A source with a component that derives no `Reflect` is found by its name.
    let mut found = BTreeSet::new();
    add_types_deriving(
        "#[derive(Component, Clone)]\npub struct GiNew;",
        "Component",
        &mut found,
    );
    let registry = app.world().resource::<AppTypeRegistry>().read();
    assert!(found.contains("GiNew") && registry.get_with_short_type_path("GiNew").is_none());
}

/// Adds all values below `value` with their paths to `out`.
fn collect_values(value: &dyn PartialReflect, path: &str, out: &mut BTreeMap<String, String>) {
    let mut below = |name: String, field: Option<&dyn PartialReflect>| {
        let field = field.unwrap_or_else(|| panic!("{path}.{name} has no value"));
        collect_values(field, &format!("{path}.{name}"), out);
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

/// Creates an app with a scene, a camera, lights, and all other components of the plugin.
fn full_world() -> App {
    let mut app = app();
    let (room, bake) = cornell();
    let root = spawn_baked(&mut app, &room, &bake, Transform::IDENTITY);
    let image = target(&mut app);
    let camera_entity = (camera(&image, view()), GiCamera::default());
    let forward_image = target(&mut app);
    let forward = (camera(&forward_image, view()), GiForwardCamera::default());
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
    world.spawn((camera_entity, GiSpecular::default()));
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
    // The point cloud draws its only part itself. This part has no cloud.
    world.spawn(PointCloudPart);
    world.spawn(GiBakeExclude);
    world.spawn(forward);
    // These bakes last longer than the test.
    let mesh = TriangleMesh::from_quads(&Quad::cornell_box());
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
    let mut values: BTreeMap<String, BTreeMap<String, String>> = BTreeMap::new();
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
                let fields = values.entry(name.into()).or_default();
                collect_values(value.as_partial_reflect(), name, fields);
            }
        }
    }
    let names: BTreeSet<String> = values.keys().cloned().collect();
    let expected = types_deriving(&["Component"]);
    let missing: Vec<_> = expected.difference(&names).collect();
    assert!(missing.is_empty(), "not in the world: {missing:?}");
    // Values at several depths: settings, an element of a list, an output.
    for (path, value) in [
        ("GiCamera.intensity", "1.0"),
        ("GiSolver.bounces", "Fixed"),
        ("GiActiveTier.reason", "\"full quality is requested\""),
        ("GiDynamicMaterials.0.0.0", "\"wall\""),
    ] {
        let component = path.split('.').next().expect("a first part");
        let fields = &values[component];
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

//! Dependencies between folders and crates.

use crate::{code_only, files, none, read};

/// Folders of libraries: each has a `lib.rs` with a table of its modules.
const LIBRARIES: [&str; 3] = [
    "src",
    "crates/meshless_gi/src",
    "crates/meshless_gi_lab/src",
];

/// The modules in the order of the table in `lib.rs`: each may use those above it.
fn order(lib: &str) -> Vec<String> {
    lib.lines()
        .filter_map(|l| l.strip_prefix("//! | "))
        .map(|l| l.split('|').next().unwrap_or_default().trim())
        .map(|cell| cell.trim_matches(['[', ']', '`']))
        .filter(|name| !name.is_empty() && *name != "module")
        .map(String::from)
        .collect()
}

/// Returns the module of a file of a `src/`. Returns `None` for `lib.rs`.
fn module_of(path: &str) -> Option<&str> {
    let (_, path) = path.split_once("src/")?;
    let first = path.split('/').next()?;
    let name = first.strip_suffix(".rs").unwrap_or(first);
    (name != "lib").then_some(name)
}

/// Identifiers that follow `prefix` in `code`, those in a group of braces too, with their lines.
fn named_after<'a>(code: &'a str, prefix: &str) -> Vec<(usize, &'a str)> {
    let mut names = Vec::new();
    for (start, _) in code.match_indices(prefix) {
        let before = code[..start].chars().next_back();
        if before.is_some_and(|c| c.is_alphanumeric() || c == '_' || c == ':') {
            continue;
        }
        let rest = &code[start + prefix.len()..];
        let line = 1 + code[..start].matches('\n').count();
        let word = |t: &'a str| {
            let t = t.trim_start();
            &t[..t
                .find(|c: char| !(c.is_alphanumeric() || c == '_'))
                .unwrap_or(t.len())]
        };
        let Some(group) = rest.trim_start().strip_prefix('{') else {
            names.push((line, word(rest)));
            continue;
        };
        // A group: its items at nesting depth 0.
        let mut depth = 0;
        let mut item = 0;
        for (i, c) in group.char_indices() {
            match c {
                '{' => depth += 1,
                '}' if depth > 0 => depth -= 1,
                ',' if depth > 0 => {}
                ',' | '}' => {
                    names.push((line, word(&group[item..i])));
                    item = i + 1;
                    if c == '}' {
                        break;
                    }
                }
                _ => {}
            }
        }
    }
    names.retain(|(_, name)| !name.is_empty());
    names
}

/// Returns uses of a module further down in `order`. Unit tests may use any module.
fn imports_upwards(path: &str, text: &str, order: &[String]) -> Vec<String> {
    let Some(own) = module_of(path).filter(|_| !path.ends_with("/tests.rs")) else {
        return Vec::new();
    };
    let text = text.split("#[cfg(test)]\nmod tests {").next().unwrap_or("");
    let rank = |name: &str| order.iter().position(|m| m == name);
    let Some(own_rank) = rank(own) else {
        return vec![format!(
            "{path}: module `{own}` is not in the table of lib.rs"
        )];
    };
    let code = code_only(text);
    let mut used = named_after(&code, "crate::");
    if path.ends_with("/mod.rs") {
        used.extend(named_after(&code, "super::"));
    }
    used.extend(named_after(&code, "super::super::"));
    used.into_iter()
        .filter(|(_, name)| rank(name).is_some_and(|r| r > own_rank))
        .map(|(line, name)| format!("{path}:{line}: `{own}` uses `{name}`, which stands below it"))
        .collect()
}

/// Names of the graphics interface or the engine where they do not belong.
fn forbidden_imports(path: &str, text: &str) -> Vec<String> {
    let module = module_of(path).unwrap_or_default();
    let code = code_only(text);
    let mut found = Vec::new();
    for (number, line) in code.lines().enumerate() {
        for word in line.split(|c: char| !(c.is_alphanumeric() || c == '_')) {
            let device = (word == "wgpu" || word.starts_with("wgpu_"))
                && !matches!(module, "gpu" | "plugin");
            let engine = (word == "bevy" || word.starts_with("bevy_"))
                && word != "bevy_meshless_gi"
                && module != "plugin"
                // Settings are components, and they and the kinds of lights are reflected, behind
                // the feature.
                && !matches!(path, "src/plan/settings.rs" | "src/plan/light_kind.rs");
            if device || engine {
                found.push(format!("{path}:{}: names `{word}`", number + 1));
            }
        }
    }
    found
}

/// Dependencies of a manifest that draw in an engine or a graphics interface. The optional
/// reflection of the core's settings is allowed.
fn forbidden_dependencies(manifest: &str) -> Vec<&str> {
    manifest
        .lines()
        .filter(|line| !line.starts_with("bevy_reflect = "))
        .filter(|line| {
            ["bevy", "wgpu", "naga"].iter().any(|word| {
                line.starts_with(word) || line.contains(&format!("dependencies.{word}"))
            })
        })
        .collect()
}

#[test]
fn module_dependencies_are_acyclic() {
    let mut found = Vec::new();
    for folder in LIBRARIES {
        let order = order(&read(&format!("{folder}/lib.rs")));
        assert!(
            order.len() > 2,
            "{folder}/lib.rs has no table of its modules"
        );
        for (path, text) in files(folder, &["rs"]) {
            found.extend(imports_upwards(&path, &text, &order));
        }
    }
    none(found);
}

#[test]
fn import_check_detects_violations() {
    let order: Vec<String> = ["scene", "frame", "gpu"].map(String::from).into();
    let check = |path: &str, text: &str| imports_upwards(path, text, &order).len();
    assert_eq!(check("src/scene/a.rs", "use crate::frame::X;"), 1);
    assert_eq!(check("src/scene/a.rs", "fn f() { crate::gpu::run() }"), 1);
    assert_eq!(
        check(
            "src/scene/a.rs",
            "use crate::{\n    scene::{B, C}, frame,\n    gpu::D,\n};"
        ),
        2
    );
    assert_eq!(check("src/scene/mod.rs", "use super::frame::X;"), 1);
    assert_eq!(check("src/scene/b/c.rs", "use super::super::frame::X;"), 1);
    assert_eq!(check("src/elsewhere/a.rs", ""), 1);
    // Allowed imports, or text that is not code.
    assert_eq!(check("src/gpu/a.rs", "use crate::frame::X;"), 0);
    assert_eq!(
        check(
            "src/scene/a.rs",
            "// crate::frame\n/* a /* crate::gpu */ b */"
        ),
        0
    );
    assert_eq!(
        check("src/scene/a.rs", r##"let s = r#"crate::gpu "quoted""#;"##),
        0
    );
    assert_eq!(
        check("src/scene/a.rs", r#"let s = "\"crate::gpu"; let c = '"'; "#),
        0
    );
    // Quotes and lifetimes do not hide the code after them.
    assert_eq!(
        check(
            "src/scene/a.rs",
            "fn f<'a>(c: &'a u8) { let q = '\\''; crate::gpu::f() }"
        ),
        1
    );
    assert_eq!(check("src/lib.rs", "use crate::gpu::X;"), 0);
    assert_eq!(check("src/scene/tests.rs", "use crate::gpu::X;"), 0);
    let inline = "#[cfg(test)]\nmod tests {\n    use crate::gpu::X;\n}\n";
    assert_eq!(check("src/scene/a.rs", inline), 0);
    let outside = "#[cfg(test)]\nmod tests;\nuse crate::gpu::X;\n";
    assert_eq!(check("src/scene/a.rs", outside), 1);
}

#[test]
fn only_plugin_uses_bevy_and_only_gpu_uses_wgpu() {
    let found = files("src", &["rs"])
        .iter()
        .flat_map(|(path, text)| forbidden_imports(path, text))
        .collect();
    none(found);
}

#[test]
fn forbidden_dependency_check_detects_violations() {
    assert_eq!(
        forbidden_imports("src/frame/a.rs", "use wgpu::Device;").len(),
        1
    );
    assert_eq!(
        forbidden_imports("src/gpu/a.rs", "use bevy::prelude::*;").len(),
        1
    );
    assert_eq!(forbidden_imports("src/plan/a.rs", "bevy_ecs::x()").len(), 1);
    assert_eq!(
        forbidden_imports("src/gpu/a.rs", "use wgpu::Device; // bevy").len(),
        0
    );
    assert_eq!(
        forbidden_imports("src/plugin/a.rs", "use bevy::x; use wgpu::y;").len(),
        0
    );
    assert_eq!(
        forbidden_imports("src/lib.rs", "#[cfg(feature = \"bevy\")] fn f() {}").len(),
        0
    );
    assert_eq!(
        forbidden_imports("src/plan/a.rs", "use meshless_gi::internals::bake;").len(),
        0
    );
}

#[test]
fn core_lab_and_tool_manifests_have_no_engine_and_no_device() {
    for member in ["meshless_gi", "meshless_gi_lab", "meshless_gi_cli"] {
        let manifest = read(&format!("crates/{member}/Cargo.toml"));
        assert_eq!(forbidden_dependencies(&manifest), [""; 0], "{member}");
    }
    assert_eq!(
        forbidden_dependencies("[dependencies]\nwgpu = \"29\"\n").len(),
        1
    );
    assert_eq!(forbidden_dependencies("[dependencies.bevy]\n").len(), 1);
    assert_eq!(
        forbidden_dependencies("bevy_reflect = { optional = true }\n").len(),
        0
    );
    assert_eq!(
        forbidden_dependencies("bevy_ecs = { optional = true }\n").len(),
        1
    );
}

//! Tests of `meshless_gi report`, and of its sweep with smaller bakes.

use crate::support::data;
use meshless_gi::internals::bake::BakeSettings;
use meshless_gi::{
    Material, PcaRecipe, Preset, Progress, Quad, Recipe, TransportMethod, TriangleMesh,
};
use meshless_gi_lab::report::{
    Factor, Ratio, Report, Run, Sweep, TestSetSize, Variant, baseline, choice, compare, figures,
    full, quick, sweep, text,
};
use serde_json::Value;
use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::Mutex;
use std::time::Duration;

/// Runs the tool's `report` and returns exit code, standard output and standard error.
fn report(arguments: &[&str]) -> (Option<i32>, String, String) {
    let ran = Command::new(env!("CARGO_BIN_EXE_meshless_gi"))
        .arg("report")
        .args(arguments)
        .stdin(Stdio::null())
        .output()
        .expect("the tool starts");
    let out = String::from_utf8(ran.stdout).expect("text");
    let err = String::from_utf8(ran.stderr).expect("text");
    assert!(!err.contains("panicked"), "{arguments:?}: {err}");
    (ran.status.code(), out, err)
}

/// Checks that a picture is XML and that all coordinates are finite.
fn check_svg(text: &str) {
    let svg = roxmltree::Document::parse(text).unwrap_or_else(|error| panic!("{error}: {text}"));
    assert_eq!(svg.root_element().tag_name().name(), "svg");
    for node in svg.descendants() {
        for name in ["x", "y", "cx", "cy"] {
            if let Some(value) = node.attribute(name) {
                assert!(value.parse::<f64>().is_ok_and(f64::is_finite), "{value}");
            }
        }
    }
}

#[test]
fn quick_report_is_complete() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path().join("new/report");
    // The time limit excludes the most expensive bakes.
    let (code, out, err) = report(&[
        &data("cornell/cornell.glb"),
        "-o",
        folder.to_str().unwrap(),
        "--quick",
        "--minutes",
        "0.15",
    ]);
    assert_eq!((code, err.as_str()), (Some(0), ""), "{out}");
    assert!(
        out.contains("% error") && out.contains("report.md"),
        "{out}"
    );

    let json: Value =
        serde_json::from_slice(&fs::read(folder.join("report.json")).unwrap()).unwrap();
    assert_eq!(json.as_object().unwrap().len(), 1);
    let rows = json["rows"].as_array().unwrap();
    // The baseline, and its frames with other numbers of bounces.
    assert!(rows.len() >= 4);
    for row in rows {
        assert!(row["settings"].as_object().unwrap().len() > 10, "{row}");
        for name in [
            "bake_seconds",
            "frame_ms",
            "bytes",
            "links",
            "nrmse",
            "p99",
            "bias",
            "nrmse_all",
            "estimated_nrmse",
        ] {
            // NaN is written as null.
            assert!(
                row[name].as_f64().is_some_and(f64::is_finite),
                "{name}: {row}"
            );
        }
        for name in ["bake_seconds", "frame_ms", "bytes", "links", "p99"] {
            assert!(row[name].as_f64() > Some(0.0), "{name}: {row}");
        }
    }
    let of = |k: usize, name: &str| rows[k][name].as_f64().unwrap();
    let bounces = |k: usize| rows[k]["settings"]["bounces"].as_u64().unwrap();
    assert_eq!((bounces(0), bounces(1)), (4, 1));
    let tier = rows.iter().find(|r| r["settings"]["factor"] == "tier");
    assert!(tier.unwrap()["links"].as_u64() < rows[0]["links"].as_u64());
    assert!(of(0, "nrmse") < 0.1 && of(1, "nrmse_all") > 3.0 * of(0, "nrmse_all"));

    let md = fs::read_to_string(folder.join("report.md")).unwrap();
    let second = md.lines().nth(2).unwrap();
    assert!(
        second.starts_with("**Recommendation for a release with at most 5 % error"),
        "{second}"
    );
    let mut pictures = 0;
    for entry in fs::read_dir(&folder).unwrap().flatten() {
        let name = entry.file_name().into_string().unwrap();
        if name.ends_with(".svg") {
            check_svg(&fs::read_to_string(entry.path()).unwrap());
            assert!(
                md.contains(&format!("({name})")),
                "{name} is not in the text"
            );
            pictures += 1;
        } else {
            assert!(
                ["report.json", "report.md"].contains(&name.as_str()),
                "{name} is left"
            );
        }
    }
    assert_eq!(pictures, 5);
}

#[test]
fn report_invalid_input_fails_before_baking() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).to_str().unwrap().to_string();
    let scene_file = data("cornell/cornell.glb");
    fs::write(at("no.glb"), "this is not a scene").unwrap();
    fs::write(at("points.ply"), "ply\n").unwrap();
    fs::write(at("bad.gi.ron"), "(scene: \"no.glb\", rays: 3)").unwrap();
    let new = at("new");
    for (code, arguments, word) in [
        (1, vec![at("no.glb"), "-o".into(), new.clone()], "no.glb"),
        (1, vec![at("points.ply"), "-o".into(), new.clone()], "ply"),
        (1, vec![at("bad.gi.ron"), "-o".into(), new.clone()], "rays"),
        (2, vec![scene_file.clone()], "--output"),
        (2, vec!["-o".into(), new.clone()], "SCENE"),
        (
            2,
            vec![
                scene_file.clone(),
                "-o".into(),
                new.clone(),
                "--minutes=-1".into(),
            ],
            "minutes",
        ),
        (
            2,
            vec![
                scene_file.clone(),
                "-o".into(),
                new.clone(),
                "--minutes=nan".into(),
            ],
            "minutes",
        ),
        (
            3,
            vec![at("nothing.glb"), "-o".into(), new.clone()],
            "nothing.glb",
        ),
        (
            3,
            vec![scene_file.clone(), "-o".into(), scene_file.clone()],
            "cornell.glb",
        ),
    ] {
        let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
        let (found, out, err) = report(&arguments);
        assert_eq!(found, Some(code), "{arguments:?}: {out}{err}");
        assert!(err.contains(word) && out.is_empty(), "{arguments:?}: {err}");
    }
    assert!(!Path::new(&new).join("report.json").exists());
}

/// Returns a recipe that bakes in a very short time.
fn tiny() -> Recipe {
    Recipe {
        preset: Preset::Draft,
        rays_per_point: Some(64),
        levels: Some(3),
        refinement_levels: Some(0),
        coarse_radius: Some(0.8),
        ..Recipe::default()
    }
}

fn variant(factor: Factor, name: &str, cost: f64, recipe: Recipe) -> Variant {
    Variant {
        factor,
        name: name.into(),
        recipe,
        run: Run::default(),
        cost,
    }
}

fn tiny_variants(base: &BakeSettings) -> Vec<Variant> {
    assert_eq!(base.rays_per_point, 64);
    let l08 = |epsilon| Recipe {
        transport: TransportMethod::L08,
        truncation_error: Some(epsilon),
        ..tiny()
    };
    let pca = Recipe {
        transport: TransportMethod::Pca(PcaRecipe {
            training_lights: 64,
            ..PcaRecipe::default()
        }),
        ..tiny()
    };
    let more = Recipe {
        rays_per_point: Some(512),
        truncation_error: Some(0.005),
        ..tiny()
    };
    vec![
        Variant {
            run: Run {
                bounces: 1,
                ..Run::default()
            },
            ..variant(Factor::Bounces, "1 reflection", 0.0, tiny())
        },
        Variant {
            run: Run {
                tier: 1,
                ..Run::default()
            },
            ..variant(Factor::Tier, "tier 1", 0.0, tiny())
        },
        variant(Factor::RuleL08, "l08 ε 0.1", 1.0, l08(0.1)),
        variant(Factor::RuleL08, "l08 ε 0.01", 1.0, l08(0.01)),
        variant(Factor::RulePca, "pca", 1.0, pca),
        variant(Factor::Rays, "512 rays", 1.0, more),
        variant(Factor::Preset, "for ever", 1e12, Recipe::default()),
    ]
}

fn tiny_sweep() -> Sweep {
    Sweep {
        test_set: TestSetSize {
            light_sources: 2,
            positions: 100,
            paths: 2048,
        },
        baseline: variant(Factor::Preset, "tiny", 1.0, tiny()),
        create_variants: tiny_variants,
        ..Sweep::quick()
    }
}

#[test]
fn report_errors_fall_with_quality_on_common_axes() {
    let mesh = TriangleMesh::from_quads(&Quad::cornell_box());
    let steps = Mutex::new(Vec::new());
    let made = sweep(&mesh, &tiny_sweep(), &Progress::default(), &|step| {
        assert!(step.done < step.steps);
        steps.lock().unwrap().push(step.what.clone());
    })
    .unwrap();
    assert_eq!(
        steps.into_inner().unwrap(),
        [
            "reference",
            "tiny",
            "l08 ε 0.1",
            "l08 ε 0.01",
            "pca",
            "512 rays"
        ]
    );
    assert_eq!(made.left_out, ["for ever"]);
    let [tiny, once, tier, coarse, fine, pca, more] = &made.rows[..] else {
        panic!("{:?}", made.rows);
    };
    assert!(made.noise.0 < 0.05, "{:?}", made.noise);
    assert!(
        more.nrmse < tiny.nrmse && tiny.nrmse < 0.3,
        "{tiny:?} {more:?}"
    );
    assert!(
        pca.nrmse < 0.5 && pca.links > 0 && pca.frame_ms > 0.0,
        "{pca:?}"
    );
    assert!(fine.nrmse < coarse.nrmse && fine.links > coarse.links);
    // Frames of one bake differ in their settings, not in the bake.
    assert_eq!((once.bytes, once.settings.baked.bounces), (tiny.bytes, 1));
    assert!(tier.links < tiny.links && tier.nrmse > tiny.nrmse && tier.bytes == tiny.bytes);
    assert!(tier.settings.tier == 1 && tiny.settings.tier > 1);
    assert!(once.bias < -0.2 && once.nrmse > tiny.nrmse);

    let figures = figures("A & B", &made);
    assert_eq!(figures.len(), 5);
    for figure in &figures {
        check_svg(&figure.chart.svg());
    }
    let links = figures.iter().find(|f| f.file == "error_links.svg");
    let [bounded, _, l08, _, bases, _] = &links.unwrap().chart.series[..] else {
        panic!("three methods and their fronts");
    };
    assert_eq!((bounded.points.len(), l08.points.len()), (3, 2));
    assert_eq!(bases.points.len(), 1);
    let all = text("A & B", &made, &figures);
    for word in [
        "for ever",
        "l08 ε 0.01",
        "error_links.svg",
        "Links at equal error",
        "Error at equal links",
        "Methods `bounded` and `pca`",
        "Conclusion",
    ] {
        assert!(all.contains(word), "no {word}: {all}");
    }
}

#[test]
fn report_of_dark_or_empty_scene_fails() {
    let nothing = TriangleMesh::new(Vec::new(), Vec::new(), vec![Material::default()]);
    let made = sweep(&nothing, &tiny_sweep(), &Progress::default(), &|_| ());
    assert!(made.unwrap_err().to_string().contains("no light"));
    let stopped = Progress::default();
    stopped.cancel();
    let mesh = TriangleMesh::from_quads(&Quad::cornell_box());
    assert!(sweep(&mesh, &tiny_sweep(), &stopped, &|_| ()).is_err());
}

/// Returns a report with given rows: method, links, error, seconds.
fn report_of_rows(rows: &[(TransportMethod, u64, f64, f64)]) -> Report {
    let one = Sweep {
        test_set: TestSetSize {
            light_sources: 1,
            positions: 20,
            paths: 64,
        },
        create_variants: |_| Vec::new(),
        ..tiny_sweep()
    };
    let mesh = TriangleMesh::from_quads(&Quad::cornell_box());
    let mut report = sweep(&mesh, &one, &Progress::default(), &|_| ()).unwrap();
    let template = report.rows.remove(0);
    for &(rule, links, error, seconds) in rows {
        let mut row = template.clone();
        row.settings.baked.transport = rule;
        row.settings.name = format!("{rule:?} {links}");
        (row.links, row.nrmse, row.bake_seconds) = (links, error, seconds);
        row.nrmse_interval = 0.001;
        row.bytes = 8 * links;
        row.frame_ms = links as f64 * 1e-3;
        report.rows.push(row);
    }
    report
}

#[test]
fn report_compares_methods_at_equal_error_and_links() {
    let (b, l) = (TransportMethod::Bounded, TransportMethod::L08);
    let report = report_of_rows(&[
        (b, 1_000, 0.1, 3.0),
        (b, 100_000, 0.01, 9.0),
        // Not on the front.
        (b, 50_000, 0.2, 1.0),
        (l, 4_000, 0.2, 2.0),
        (l, 40_000, 0.1, 2.0),
        (l, 400_000, 0.05, 2.0),
        (l, 4_000_000, 0.005, 2.0),
    ]);
    let found = compare(&report.rows);
    let is = |r: Ratio, right: f64| matches!(r, Ratio::Is(v) if (v - right).abs() < 1e-3 * right);
    let at_most =
        |r: Ratio, right: f64| matches!(r, Ratio::AtMost(v) if (v - right).abs() < 1e-3 * right);
    // The row with the fewest links has a smaller error, so the ratio is an upper bound.
    assert!(at_most(found[0].links_ratio, 0.25), "{found:?}");
    assert!(is(found[0].error_ratio, 0.05 / 0.2), "{found:?}");
    assert!(is(found[1].links_ratio, 1_000.0 / 40_000.0), "{found:?}");
    // 0.05 is reached at 1000 · 2² links.
    assert!(is(found[2].links_ratio, 0.01), "{found:?}");
    assert!(at_most(found[2].error_ratio, 0.2), "{found:?}");
    assert_eq!(found[3].links_ratio, Ratio::NotReached);
    assert!(at_most(found[3].error_ratio, 2.0), "{found:?}");
    let all = text("x", &report, &figures("x", &report));
    assert!(
        all.contains("Links at equal error: × 0.01 to × 0.25.\n  Goal: a third, met in 3 of 4 rows, not reached in 1."),
        "{all}"
    );

    // The cheapest row below an error, for each kind of cost.
    let chosen = choice(&report.rows);
    let row = |start: &str| {
        let line = chosen.lines().find(|l| l.starts_with(start));
        line.unwrap_or_else(|| panic!("{chosen}")).to_string()
    };
    assert!(row("| 10 %").contains("Bounded 1000: 3.00 s") && !row("| 10 %").contains("L08"));
    assert!(!chosen.contains("The published method"), "{chosen}");
    assert!(row("| 2 %").contains("Bounded 100000"));
    assert!(
        row("**Recommendation for a release").contains("100 ms"),
        "{chosen}"
    );
    let cheap = choice(&report_of_rows(&[(b, 90, 0.04, 1.0), (l, 80, 0.04, 1.0)]).rows);
    assert!(cheap.contains("The published method has a faster frame here"));
    let far = choice(&report_of_rows(&[(b, 10, 0.5, 1.0)]).rows);
    assert!(
        far.contains("No measured bake of this scene has an error below 5 %")
            && far.contains("not reached")
    );
    let none = report_of_rows(&[]);
    assert!(text("x", &none, &figures("x", &none)).contains("Nothing was measured"));
}

#[test]
fn report_variants_bake_and_write_recipes() {
    let base = baseline().recipe.settings(30.0).unwrap();
    let (quick, full) = (quick(&base), full(&base));
    assert!(quick.len() >= 6 && full.len() > 2 * quick.len());
    for list in [&quick, &full] {
        for (i, v) in list.iter().enumerate() {
            v.recipe.settings(30.0).unwrap();
            assert_eq!(
                Recipe::from_ron(&v.recipe_text()).unwrap(),
                v.recipe,
                "{}",
                v.name
            );
            assert!(v.cost.is_finite() && v.cost >= 0.0);
            let same = |w: &Variant| w.name == v.name || (w.recipe == v.recipe && w.run == v.run);
            assert!(!list[..i].iter().any(same), "{} twice", v.name);
        }
        for rule in [
            TransportMethod::Bounded,
            TransportMethod::L08,
            TransportMethod::pca(),
        ] {
            assert!(list.iter().any(|v| v.recipe.transport == rule));
        }
        // Runs of the baseline come first, because they need no bake.
        let runs = list.iter().position(|v| v.factor != Factor::Bounces);
        assert!(runs.is_some_and(|n| n >= 3));
    }
    assert!(
        Sweep::quick().limit < Sweep::full().limit
            && Sweep::full().limit <= Duration::from_mins(25)
    );
}

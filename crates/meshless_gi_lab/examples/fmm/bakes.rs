//! Comparison of the transport methods `fmm`, `bounded` and `pca`: error, frame time, bytes and
//! bake time. The scenes are the Cornell box as triangles and as points, and a statue of points in
//! a room of triangles.

use glam::Vec3;
use meshless_gi::internals::bake::BakeSettings;
use meshless_gi::internals::samples::scatter;
use meshless_gi::internals::scene::{PlyEncoding, parse_ply, statue_room, write_ply};
use meshless_gi::{
    CpuFrame, FmmRecipe, FrameLight, FrameSettings, Light, PointCloud, Preset, Progress, Quad,
    Recipe, TransportMethod, TriangleMesh, bake_scene,
};
use meshless_gi_lab::report::{
    Factor, Figure, Report, Run, Sweep, Variant, figures, fmm_comparison, sweep,
};
use std::error::Error;
use std::fmt::Write;
use std::path::Path;
use std::time::{Duration, Instant};

/// Latest time at which a bake may be predicted to end.
const LIMIT: Duration = Duration::from_mins(5);
/// Minimum distance between points, in meters. The room has an edge of two meters.
const SPACING: f32 = 0.035;

/// Returns variants of the methods at preset values, and variants of the settings of method `fmm`.
fn create_variants(_: &BakeSettings) -> Vec<Variant> {
    let of = |name: &str, factor, cost, recipe| Variant {
        factor,
        name: name.into(),
        recipe,
        run: Run::default(),
        cost,
    };
    let draft = Recipe {
        preset: Preset::Draft,
        ..Recipe::default()
    };
    let rule = |rule| Recipe {
        transport: rule,
        ..draft.clone()
    };
    let epsilon = |e| Recipe {
        truncation_error: Some(e),
        receiver_tolerance: Some(2.0 * e),
        ..draft.clone()
    };
    let fmm = rule(TransportMethod::fmm());
    let sources = |k| Recipe {
        transport: TransportMethod::Fmm(FmmRecipe {
            samples_per_sender: k,
            ..FmmRecipe::default()
        }),
        ..fmm.clone()
    };
    let order = |k| Recipe {
        transport: TransportMethod::Fmm(FmmRecipe {
            order: k,
            ..FmmRecipe::default()
        }),
        ..fmm.clone()
    };
    let levels = |k, recipe: &Recipe| Recipe {
        sender_levels: Some(k),
        ..recipe.clone()
    };
    let finer = |e, rays| Recipe {
        rays_per_point: Some(rays),
        ..levels(5, &epsilon(e))
    };
    vec![
        of("bounded, ε 0.1", Factor::Epsilon, 0.8, epsilon(0.1)),
        of("fmm", Factor::RuleFmm, 0.8, fmm.clone()),
        of(
            "fmm, 5 sender levels",
            Factor::RuleFmm,
            2.0,
            levels(5, &fmm),
        ),
        of(
            "bounded, 5 sender levels, 1024 rays, ε 0.015",
            Factor::Several,
            5.0,
            finer(0.015, 1024),
        ),
        of("fmm, 1 source", Factor::RuleFmm, 0.6, sources(1)),
        of("fmm, 16 sources", Factor::RuleFmm, 1.2, sources(16)),
        of(
            "fmm, 3 sender levels",
            Factor::RuleFmm,
            0.7,
            levels(3, &fmm),
        ),
        of("fmm, order 1", Factor::RuleFmm, 0.6, order(1)),
        of("fmm, order 4", Factor::RuleFmm, 1.0, order(4)),
        of(
            "bounded, 5 sender levels",
            Factor::Several,
            1.5,
            finer(0.03, 256),
        ),
        of("pca", Factor::RulePca, 1.3, rule(TransportMethod::pca())),
    ]
}

/// Returns the mesh of the cells of scattered points, of which `keep` selects some.
fn cloud(
    mesh: &TriangleMesh,
    spacing: f32,
    keep: impl Fn(Vec3) -> bool,
) -> Result<TriangleMesh, Box<dyn Error>> {
    let mut all = scatter(mesh, spacing, 1).ok_or("no points")?;
    let kept: Vec<bool> = all.positions.iter().map(|&p| keep(p)).collect();
    let part = |values: &mut Vec<Vec3>| {
        let mut kept = kept.iter();
        values.retain(|_| kept.next().copied().unwrap_or(false));
    };
    part(&mut all.positions);
    all.normals.iter_mut().for_each(part);
    all.albedo.iter_mut().for_each(part);
    Ok(PointCloud::new(all, &[])?.mesh().0)
}

/// Returns the result of a function and its time in seconds.
fn timed<T>(run: impl FnOnce() -> T) -> (T, f64) {
    let start = Instant::now();
    let made = run();
    (made, start.elapsed().as_secs_f64())
}

/// Returns the seconds of a bake, the minimum milliseconds of three solves under a light, and the
/// error estimate of the bake.
fn cost(mesh: &TriangleMesh, rule: TransportMethod) -> Result<[f64; 3], Box<dyn Error>> {
    let recipe = Recipe {
        preset: Preset::Draft,
        transport: rule,
        ..Recipe::default()
    };
    let (baked, seconds) = timed(|| bake_scene(mesh, &recipe, 0, &Progress::default()));
    let scene = baked?.scene;
    let light_source = Light::Point {
        position: Vec3::new(0.1, 1.7, 0.6),
        intensity: Vec3::ONE,
        range: 20.0,
    };
    let solves = (0..3).map(|_| {
        // An unchanged frame is not solved again.
        let mut frame = CpuFrame::new(&scene);
        frame.set_lights(&scene, &FrameLight::expand(&light_source, 1));
        timed(|| frame.solve(&scene, &FrameSettings::bounces(4))).1
    });
    let solve = solves.min_by(f64::total_cmp).unwrap_or_default();
    Ok([seconds, 1e3 * solve, scene.info().estimated_nrmse.into()])
}

/// Returns a table of times from reading a file of points to a frame, by number of points.
fn point_count_table() -> Result<String, Box<dyn Error>> {
    let mut out = "\n## Bakes by number of points\n\n\
     Scene: a statue in the Cornell box, as a `.ply` of points (`meshless_gi scatter`), preset `Draft`.\n\
     Read: from the bytes of the file to the triangles of the cells. Solve: four bounces of one light on the CPU without projection.\n\
     Errors are the bakes' own estimates.\n\n\
     | points | triangles of their cells | read, s | points/s | bake by `bounded`, s | solve, ms | error, % | bake by `fmm`, s | solve, ms | error, % |\n\
     |---|---|---|---|---|---|---|---|---|---|\n"
        .to_string();
    for spacing in [0.08, 0.04, 0.02, 0.01] {
        let points = scatter(&statue_room(), spacing, 1).ok_or("no points")?;
        let (normals, albedo) = (points.normals.as_deref(), points.albedo.as_deref());
        let mut file = Vec::new();
        let (normals, albedo) = (normals.unwrap_or_default(), albedo.unwrap_or_default());
        write_ply(
            &mut file,
            PlyEncoding::LittleEndian,
            &points.positions,
            normals,
            albedo,
        )?;
        let (read, seconds) = timed(|| -> Result<_, Box<dyn Error>> {
            let cloud = PointCloud::new(parse_ply(&file)?, &[])?;
            Ok((cloud.len(), cloud.mesh().0))
        });
        let (count, mesh) = read?;
        eprintln!("{count} points");
        let [bounded, fmm] = [
            cost(&mesh, TransportMethod::Bounded)?,
            cost(&mesh, TransportMethod::fmm())?,
        ];
        let _ = write!(
            out,
            "| {count} | {} | {seconds:.2} | {:.0} |",
            mesh.len(),
            count as f64 / seconds
        );
        for [bake, solve, error] in [bounded, fmm] {
            let _ = write!(out, " {bake:.1} | {solve:.1} | {:.1} |", 100.0 * error);
        }
        out += "\n";
    }
    Ok(out)
}

/// Returns the scenes with their names.
fn scenes() -> Result<Vec<(&'static str, TriangleMesh)>, Box<dyn Error>> {
    let solid = TriangleMesh::from_quads(&Quad::cornell_box());
    let points = cloud(&solid, SPACING, |_| true)?;
    // Walls of the room as triangles, everything else as points.
    let walls = TriangleMesh::from_quads(&Quad::cornell_box()[..5]);
    let statue = cloud(&statue_room(), 0.6 * SPACING, |p| {
        p.x.abs() < 0.95 && p.z.abs() < 0.95 && p.y > 0.01 && p.y < 1.95
    })?;
    Ok(vec![
        ("The Cornell box of triangles", solid),
        ("The Cornell box of points", points),
        (
            "A statue of points in a room of triangles",
            TriangleMesh::joined(vec![walls, statue]),
        ),
    ])
}

/// Returns the section of a scene.
fn section(name: &str, report: &Report, charts: &[Figure]) -> String {
    let mut out = format!(
        "\n## {name}\n\n\
         {} triangles. Error: NRMSE of indirect irradiance after {} bounces at {} points under {} lights, against the reference integrator.\n\
         Frame: time on the CPU for one light that has moved, all bounces, on {} threads.\n\
         The links of `fmm` are entries of its lists.\n\n\
         | method | settings | error, % | bias, % | links | file, MB | bake, s | frame, ms |\n\
         |---|---|---|---|---|---|---|---|\n",
        report.triangles, report.bounces, report.positions, report.light_sources, report.threads
    );
    for rule in [
        TransportMethod::Bounded,
        TransportMethod::pca(),
        TransportMethod::fmm(),
    ] {
        for r in (report.rows.iter()).filter(|r| r.has_method(&rule)) {
            let _ = writeln!(
                out,
                "| `{}` | {} | {:.1} ± {:.1} | {:.1} | {:.2} M | {:.1} | {:.1} | {:.1} |",
                rule.name().to_lowercase(),
                r.settings.name,
                100.0 * r.nrmse,
                100.0 * r.nrmse_interval,
                100.0 * r.bias,
                r.links as f64 / 1e6,
                r.bytes as f64 / 1e6,
                r.bake_seconds,
                r.frame_ms,
            );
        }
    }
    if !report.left_out.is_empty() {
        let left = report.left_out.join("; ");
        let _ = writeln!(out, "\nSkipped because of the time limit: {left}.");
    }
    for figure in charts {
        let _ = writeln!(out, "\n![{}](fmm/{})", figure.chart.title, figure.file);
    }
    let _ = writeln!(out, "\n{}", fmm_comparison(&report.rows));
    out
}

/// Measures the bakes, writes their charts and returns their section of the document.
pub fn measure(folder: &Path) -> Result<String, Box<dyn Error>> {
    let mut out = point_count_table()?;
    for (k, (name, scene)) in scenes()?.into_iter().enumerate() {
        let plan = Sweep {
            create_variants,
            limit: LIMIT,
            ..Sweep::quick()
        };
        let report = sweep(&scene, &plan, &Progress::default(), &|step| {
            eprintln!("{name}: {} of {}: {}", step.done + 1, step.steps, step.what);
        })?;
        let mut all = figures(name, &report);
        all.retain(|f| ["error_frame_time.svg", "error_bake_time.svg"].contains(&&*f.file));
        for figure in &mut all {
            figure.file = format!("bakes_{k}_{}", figure.file);
            std::fs::write(folder.join(&figure.file), figure.chart.svg())?;
        }
        out += &section(name, &report, &all);
    }
    Ok(out)
}

//! The whole chain again in double precision, from the same baked data. The tests count the digits
//! that single precision loses at each stage.
//!
//! Each stage gets the single-precision result of the stage before, so that its own loss is
//! isolated. At the end the chain runs in double precision from the light to the position. A digit
//! lost is a factor of ten over half a unit in the last position, 6e-8.

use super::support::{baked, cornell, irradiances, small};
use glam::{DVec3, DVec4, Vec3};
use meshless_gi::internals::samples::F_SQUASH;
use meshless_gi::{BakedScene, CpuFrame, FrameLight, FrameSettings, Recipe};

/// Half a unit in the last digit of single precision.
const ROUNDING: f64 = 5.960_464_5e-8;

/// Returns the root mean square of the difference and the largest difference, both relative to the
/// root mean square of `right`.
fn off(found: &[f64], right: &[f64]) -> (f64, f64) {
    assert_eq!(found.len(), right.len());
    let power: f64 = right.iter().map(|r| r * r).sum();
    assert!(power > 0.0, "nothing to compare");
    let pairs = || found.iter().zip(right);
    let squares: f64 = pairs().map(|(f, r)| (f - r).powi(2)).sum();
    let largest = pairs().map(|(f, r)| (f - r).abs()).fold(0.0, f64::max);
    let size = (power / right.len() as f64).sqrt();
    ((squares / power).sqrt(), largest / size)
}

/// Prints the loss of a stage and compares it with its bound in digits.
fn stage(name: &str, found: &[f64], right: &[f64], max: f64) {
    let (rms, largest) = off(found, right);
    let lost = (rms / ROUNDING).max(1.0).log10();
    eprintln!("{name:10} off by {rms:.1e} (rms), {largest:.1e} (largest): {lost:.1} digits lost");
    assert!(lost <= max, "{name}: {lost} digits lost, at most {max}");
}

/// Returns the red irradiance of the light at a position, without shadows.
fn unshadowed(light_source: DVec3, x: DVec3, n: DVec3) -> f64 {
    let to = light_source - x;
    n.dot(to).max(0.0) / to.length().powi(3)
}

/// The chain's data in double precision.
struct Exact<'a> {
    scene: &'a BakedScene,
}

impl Exact<'_> {
    fn albedo(&self, j: usize) -> f64 {
        f64::from(self.scene.data().surfaces[j].albedo[0])
    }

    fn normal(&self, i: usize) -> DVec3 {
        self.scene.data().points[i].n().as_dvec3()
    }

    /// Returns the light at the senders' positions. It is zero if `single` is dark.
    fn project(&self, light_source: DVec3, single: &[f32]) -> Vec<f64> {
        let scene = self.scene;
        let count = scene.data().light_samples.per_sender as usize;
        let finest = scene.data().finest_senders().start;
        (0..scene.data().senders())
            .map(|j| {
                if single[j] == 0.0 {
                    return 0.0;
                }
                if j < finest || count == 0 {
                    return unshadowed(
                        light_source,
                        scene.data().points[j].x().as_dvec3(),
                        self.normal(j),
                    );
                }
                let own = &scene.data().light_samples.list[(j - finest) * count..][..count];
                let all = own
                    .iter()
                    .map(|p| unshadowed(light_source, p.x().as_dvec3(), p.n().as_dvec3()));
                all.sum::<f64>() / count as f64
            })
            .collect()
    }

    fn pull(&self, senders: &mut [f64]) {
        let finest = self.scene.data().finest_senders().start;
        for k in (0..finest).rev() {
            let row = self.scene.data().pull.row(k);
            if !row.is_empty() {
                let parts = row
                    .iter()
                    .map(|w| f64::from(w.weight) * senders[w.index as usize]);
                senders[k] = parts.sum();
            }
        }
    }

    fn apply(&self, senders: &[f64]) -> Vec<DVec3> {
        let operator = &self.scene.data().operator;
        let row = |i: usize| {
            let r = &operator.rows[i];
            let links = &operator.links[r.start as usize..][..r.count as usize];
            let lit = links
                .iter()
                .filter(|l| (l.sender() as usize) < senders.len());
            let sum: DVec3 = lit
                .map(|l| l.vector().as_dvec3() * senders[l.sender() as usize])
                .sum();
            sum * f64::from(r.scale)
        };
        (0..operator.rows.len()).map(row).collect()
    }

    fn flatten(&self, values: &mut [DVec3]) {
        for i in 0..values.len() {
            if self.scene.data().operator.rows[i].tier == 0 {
                let row = self.scene.data().parents.row(i).iter();
                values[i] = row
                    .map(|w| f64::from(w.weight) * values[w.index as usize])
                    .sum();
            }
        }
    }

    /// \[L08\] Eqs. (3), (8)-(10) with the display's weights.
    fn splat(&self, values: &[DVec3], x: Vec3, n: Vec3) -> f64 {
        let display = &self.scene.data().display;
        let (position, normal) = (x.as_dvec3(), n.as_dvec3());
        let (mut numerator, mut denominator) = (DVec3::ZERO, 0.0);
        for &j in display.grid.indices_near(x) {
            let point = &self.scene.data().points[j as usize];
            let n_j = point.n().as_dvec3();
            let v = position - point.x().as_dvec3();
            let r = f64::from(point.radius);
            let t = (v + f64::from(F_SQUASH) * v.dot(n_j) * n_j).length() / r;
            let cosine = normal.dot(n_j).max(0.0);
            let behind = display.planes[point.plane_range()]
                .iter()
                .any(|p| DVec4::from_array(p.map(f64::from)).dot(position.extend(1.0)) < 0.0);
            if t < 1.0 && !behind {
                let w = ((2.0 * t - 3.0) * t * t + 1.0) * cosine * cosine / r;
                denominator += w * w;
                numerator += w * w * values[j as usize];
            }
        }
        (numerator / denominator).dot(normal).max(0.0)
    }

    /// Returns the light that the senders receive of their own light after one reflection.
    fn reflected(&self, senders: &[f64]) -> Vec<f64> {
        let mut values = self.apply(senders);
        self.flatten(&mut values);
        let each =
            (0..senders.len()).map(|j| self.albedo(j) * values[j].dot(self.normal(j)).max(0.0));
        each.collect()
    }
}

#[test]
fn single_precision_error_is_bounded() {
    let recipe = Recipe {
        levels: Some(4),
        receiver_tolerance: Some(0.5),
        ..small()
    };
    let scene = baked(&cornell(1.0, Vec3::ZERO), &recipe).scene;
    let inactive = scene.data().operator.rows.iter().filter(|r| r.tier == 0);
    assert!(inactive.count() > 100, "flatten has work");
    let exact = Exact { scene: &scene };
    let light_source = Vec3::new(0.1, 1.6, 0.3);
    let mut frame = CpuFrame::new(&scene);
    frame.set_lights(
        &scene,
        &[FrameLight::point(light_source, Vec3::ONE, f32::INFINITY)],
    );
    frame.solve(&scene, &FrameSettings::bounces(1));
    let red = |senders: &[[f32; 4]]| -> Vec<f64> {
        let real = senders[..scene.data().senders()].iter();
        real.map(|s| f64::from(s[0])).collect()
    };
    let vectors = |frame: &CpuFrame| -> Vec<DVec3> {
        let each = frame.vector_irradiance().iter();
        each.map(|v| Vec3::new(v.x[0], v.y[0], v.z[0]).as_dvec3())
            .collect()
    };
    let flat = |v: &[DVec3]| -> Vec<f64> { v.iter().flat_map(|v| v.to_array()).collect() };

    // Project: only fully lit senders, because a shadow's edge does not depend on digits.
    let single = frame.projected(0).to_vec();
    let light = exact.project(light_source.as_dvec3(), &single);
    let whole: Vec<usize> = (0..light.len())
        .filter(|&j| (f64::from(single[j]) / light[j] - 1.0).abs() < 1e-3)
        .collect();
    assert!(
        5 * whole.len() > 3 * light.len(),
        "{} of {}",
        whole.len(),
        light.len()
    );
    let pick = |all: &dyn Fn(usize) -> f64| -> Vec<f64> { whole.iter().map(|&j| all(j)).collect() };
    let project = [pick(&|j| f64::from(single[j])), pick(&|j| light[j])];
    stage("project", &project[0], &project[1], 1.5);

    // Radiosity and pull.
    let mut senders: Vec<f64> = (0..scene.data().senders())
        .map(|j| exact.albedo(j) * f64::from(single[j]))
        .collect();
    exact.pull(&mut senders);
    let first = red(frame.senders());
    stage("pull", &first, &senders, 1.0);

    // Apply, and flatten on top of it.
    let found = vectors(&frame);
    let applied = exact.apply(&first);
    let active = |v: &[DVec3]| -> Vec<f64> {
        let rows = scene.data().operator.rows.iter().zip(v);
        rows.filter(|(r, _)| r.tier != 0)
            .flat_map(|(_, v)| v.to_array())
            .collect()
    };
    stage("apply", &active(&found), &active(&applied), 1.0);
    let mut flattened = found.clone();
    exact.flatten(&mut flattened);
    stage("flatten", &flat(&found), &flat(&flattened), 1.0);

    // Splat.
    let positions: Vec<(Vec3, Vec3)> = (0..400)
        .map(|k| {
            let (a, b) = ((k % 20) as f32 / 10.5 - 0.9, (k / 20) as f32 / 10.5 - 0.9);
            match k % 2 {
                0 => (Vec3::new(a, 0.0, b), Vec3::Y),
                _ => (Vec3::new(a, 1.0 + b, -1.0), Vec3::Z),
            }
        })
        .filter(|&(x, n)| frame.irradiance(&scene, x, n).is_some())
        .collect();
    assert!(positions.len() > 300);
    let shown = |frame: &CpuFrame| -> Vec<f64> {
        let each = positions.iter();
        each.map(|&(x, n)| f64::from(frame.irradiance(&scene, x, n).unwrap().x))
            .collect()
    };
    let right = |values: &[DVec3]| -> Vec<f64> {
        positions
            .iter()
            .map(|&(x, n)| exact.splat(values, x, n))
            .collect()
    };
    stage("splat", &shown(&frame), &right(&found), 1.5);

    // The whole chain after 1, 8 and 256 reflections. Shadow edges come from single precision, so
    // the chain starts after them.
    for bounces in [1, 8, 256] {
        frame.solve(&scene, &FrameSettings::bounces(bounces));
        let mut direct: Vec<f64> = (0..scene.data().senders())
            .map(|j| exact.albedo(j) * f64::from(single[j]))
            .collect();
        exact.pull(&mut direct);
        let mut senders = direct.clone();
        for _ in 1..bounces {
            let further = exact.reflected(&senders);
            let finest = scene.data().finest_senders().start;
            for j in 0..senders.len() {
                if j >= finest || scene.data().pull.row(j).is_empty() {
                    senders[j] = direct[j] + further[j];
                }
            }
            exact.pull(&mut senders);
        }
        let mut values = exact.apply(&senders);
        exact.flatten(&mut values);
        stage(
            &format!("{bounces} in all"),
            &shown(&frame),
            &right(&values),
            1.5,
        );
    }
    irradiances(&frame, &scene);
}

/// The comparison must be able to fail: light with an error of one part in ten thousand has lost
/// three digits.
#[test]
fn precision_comparison_detects_lost_digit() {
    let right: Vec<f64> = (1..100).map(f64::from).collect();
    let wrong: Vec<f64> = right.iter().map(|r| r * 1.0001).collect();
    let (rms, _) = off(&wrong, &right);
    assert!((rms / ROUNDING).log10() > 3.0);
}

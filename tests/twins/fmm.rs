//! `fmm_up` and `fmm_down` against their twins, over a room with all four lists, parts of visibility, and several orders.

#[path = "../../examples/fmm/room.rs"]
#[allow(dead_code, reason = "the rooms serve several examples and tests")]
mod room;

use super::compare::{Scale, differing};
use super::harness;
use bevy_meshless_gi::frame::fmm_down::fmm_down;
use bevy_meshless_gi::frame::fmm_up::fmm_up;
use bevy_meshless_gi::gpu::{GpuError, GpuFmm, Kernels, Pass};
use bevy_meshless_gi::scene::{cornell_box, mesh_of_quads};
use bevy_meshless_gi::transport::fmm::passes::Field;
use bevy_meshless_gi::transport::fmm::{Fmm, FmmPoint, FmmSettings, Passes};
use glam::Vec3;

/// Sums of thousands of terms that cancel in part, derivatives by recurrence: hundreds of roundings.
const SUMS: f32 = 1e-4;

/// S-expansions, R-expansions and irradiance of the twins.
fn twin(fmm: &Fmm, radiosity: &[Vec3]) -> [Vec<f32>; 3] {
    let field = Field::<f32>::new(
        fmm.tree(),
        fmm.lists(),
        fmm.expansions(),
        fmm.settings().disks,
    );
    let sorted: Vec<_> = fmm
        .tree()
        .order
        .iter()
        .map(|&i| radiosity[i as usize].extend(0.0).to_array())
        .collect();
    let mut passes = Passes::new(field);
    fmm_up(&mut passes, &sorted);
    fmm_down(&mut passes, &sorted);
    [
        bytemuck::cast_slice(&passes.sources).to_vec(),
        bytemuck::cast_slice(&passes.locals).to_vec(),
        bytemuck::cast_slice(&passes.irradiance).to_vec(),
    ]
}

fn scene(order: usize, disks: bool) -> (Fmm, Vec<Vec3>) {
    let room = room::cornell(1500);
    let mut points = room.points.clone();
    // A ball without a part in the geometry: normals of all kinds. A heap in one place, more than a workgroup has threads.
    points.extend((0..400).map(|i| {
        let z = 1.0 - 2.0 * (i as f32 + 0.5) / 400.0;
        let phi = i as f32 * 2.399_963;
        let s = (1.0 - z * z).sqrt();
        let normal = Vec3::new(s * phi.cos(), s * phi.sin(), z);
        FmmPoint {
            position: Vec3::new(0.3, 1.2, 0.4) + 0.3 * normal,
            normal,
            weight: 0.003,
        }
    }));
    points.extend([points[700]; 100]);
    let settings = FmmSettings {
        order,
        disks,
        leaf: 12,
        ..FmmSettings::default()
    };
    let mesh = mesh_of_quads(&cornell_box());
    let fmm = Fmm::new(&points, &settings, Some(&mesh)).unwrap();
    let lists = fmm.lists();
    for list in [&lists.far, &lists.local, &lists.multipole, &lists.near] {
        assert!(list.entries.len() > 10, "a list is empty");
    }
    assert!(lists.counts.partial > 10);
    let radiosity = points
        .iter()
        .map(|p| Vec3::new(1.0, 0.3, 2.0) * (1.5 + (3.0 * p.position.x).sin()))
        .collect();
    (fmm, radiosity)
}

#[test]
fn fmm_up_and_down() {
    let Some(harness) = harness() else { return };
    let kernels = Kernels::new(&harness.device).unwrap();
    for (order, disks) in [(0, true), (3, false), (4, true), (6, true)] {
        let (fmm, mut radiosity) = scene(order, disks);
        let expected = twin(&fmm, &radiosity);
        let mut gpu = GpuFmm::new(&kernels, &harness.queue, &fmm).unwrap();
        gpu.set_radiosity(&harness.queue, &radiosity);
        harness
            .run(|encoder| {
                gpu.up(&kernels, encoder);
                gpu.down(&kernels, encoder);
            })
            .unwrap();
        let found: Vec<Vec<f32>> = gpu
            .outputs()
            .into_iter()
            .zip(&expected)
            .map(|(buffer, e)| harness.read(buffer, e.len()).unwrap())
            .collect();
        // One point that is half as bright again is noticed in all three.
        let at = fmm.tree().order[fmm.tree().points.len() / 2] as usize;
        radiosity[at] *= 1.5;
        let spoiled = twin(&fmm, &radiosity);
        for (k, what) in ["S-expansions", "R-expansions", "irradiance"]
            .into_iter()
            .enumerate()
        {
            let width = [12, 12, 4][k];
            let off = differing(&found[k], &expected[k], width, SUMS, Scale::Rms);
            assert!(
                off.is_empty(),
                "order {order}, {what}: {} of {} differ, first {:?} and not {:?}",
                off.len(),
                expected[k].len() / width,
                &found[k][off[0] * width..][..width],
                &expected[k][off[0] * width..][..width]
            );
            let off = differing(&found[k], &spoiled[k], width, SUMS, Scale::Rms);
            assert!(!off.is_empty(), "{what}: a brighter point is not noticed");
        }
        let levels = fmm.tree().levels() as u64;
        let counters = gpu.counters();
        let counts = [Pass::FmmUp, Pass::FmmReceive, Pass::FmmEvaluate].map(|p| counters.of(p));
        assert_eq!(counts, [levels, levels, 1]);
        // In the order of the points, and against the bake's own numbers.
        let irradiance: Vec<[f32; 4]> = bytemuck::cast_slice(&found[2]).to_vec();
        let e = gpu.sorted(&irradiance, radiosity.len());
        radiosity[at] /= 1.5;
        let (wide, _) = fmm.irradiance(&radiosity).unwrap();
        let narrow: Vec<f32> = e.iter().flat_map(|e| e.to_array()).collect();
        let wide: Vec<f32> = wide.iter().flat_map(|e| e.to_array()).collect();
        assert!(differing(&narrow, &wide, 3, 1e-3, Scale::Rms).is_empty());
    }
}

#[test]
fn an_order_too_high_and_nothing_at_all() {
    let Some(harness) = harness() else { return };
    let kernels = Kernels::new(&harness.device).unwrap();
    let settings = FmmSettings {
        order: 7,
        ..FmmSettings::default()
    };
    let fmm = Fmm::new(&[], &settings, None).unwrap();
    let error = GpuFmm::new(&kernels, &harness.queue, &fmm).unwrap_err();
    assert!(matches!(
        error,
        GpuError::Limit {
            have: 6,
            need: 7,
            ..
        }
    ));
    let fmm = Fmm::new(&[], &FmmSettings::default(), None).unwrap();
    let mut gpu = GpuFmm::new(&kernels, &harness.queue, &fmm).unwrap();
    harness
        .run(|encoder| {
            gpu.up(&kernels, encoder);
            gpu.down(&kernels, encoder);
        })
        .unwrap();
    assert!(gpu.sorted(&[], 0).is_empty());
}

//! Comparison of `fmm_up` and `fmm_down` with their twins, on a room with all four lists, partial
//! visibility, and several orders.

use meshless_gi_lab::fixtures::fmm as room;

use super::compare::{Scale, differing};
use super::harness;
use bevy_meshless_gi::gpu::{GpuError, HeadlessDevice, KernelPipelines};
use bevy_meshless_gi::internals::gpu::{EntryPoint, GpuCounters, GpuFmm};
use glam::Vec3;
use meshless_gi::internals::frame::VectorIrradiance;
use meshless_gi::internals::frame::fmm_down::fmm_down;
use meshless_gi::internals::frame::fmm_up::fmm_up;
use meshless_gi::internals::transport::fmm::passes::Field;
use meshless_gi::internals::transport::fmm::{Fmm, FmmOperator, FmmPoint, FmmSettings, Passes};
use meshless_gi::{Quad, TriangleMesh};

/// Tolerance of sums of thousands of terms that partly cancel, with derivatives by recurrence:
/// hundreds of roundings.
const SUM_TOLERANCE: f32 = 1e-4;

/// Returns the S-expansions, R-expansions and vector irradiance of the twins. The last item of
/// `radiosity` is the sky's coefficient.
fn twin(operator: &FmmOperator, radiosity: &[[f32; 4]]) -> [Vec<f32>; 3] {
    let mut passes = Passes::new(Field::from_operator(operator));
    let sky = radiosity.len() - 1;
    let mut values = vec![VectorIrradiance::default(); sky];
    fmm_up(&mut passes, radiosity);
    fmm_down(&mut passes, operator, radiosity, sky, &mut values);
    [
        bytemuck::cast_slice(&passes.sources).to_vec(),
        bytemuck::cast_slice(&passes.locals).to_vec(),
        bytemuck::cast_slice(&values).to_vec(),
    ]
}

/// Creates a buffer with this content.
fn create_storage_buffer<T: bytemuck::NoUninit>(
    harness: &HeadlessDevice,
    data: &[T],
) -> wgpu::Buffer {
    let buffer = harness.device.create_buffer(&wgpu::BufferDescriptor {
        label: None,
        size: size_of_val(data) as u64,
        usage: wgpu::BufferUsages::STORAGE
            | wgpu::BufferUsages::COPY_DST
            | wgpu::BufferUsages::COPY_SRC,
        mapped_at_creation: false,
    });
    let bytes = bytemuck::cast_slice(data);
    harness.queue.write_buffer(&buffer, 0, bytes);
    buffer
}

/// Returns the same results from the device, and the counters of the recorded passes.
fn device(
    harness: &HeadlessDevice,
    kernels: &KernelPipelines,
    operator: &FmmOperator,
    radiosity: &[[f32; 4]],
) -> ([Vec<f32>; 3], GpuCounters) {
    let points = radiosity.len() - 1;
    let gpu = GpuFmm::new(&harness.device, &harness.queue, operator, points as u32).unwrap();
    let light = create_storage_buffer(harness, radiosity);
    let values = create_storage_buffer(harness, &vec![VectorIrradiance::default(); points]);
    let mut counters = GpuCounters::default();
    harness
        .run(|encoder| {
            let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
            gpu.record_upward(kernels, &mut pass, &mut counters, &light);
            gpu.record_downward(kernels, &mut pass, &mut counters, &light, &values);
        })
        .unwrap();
    let terms = 12 * operator.terms() * operator.nodes.len();
    let [s, r] = gpu.expansions();
    let read = |buffer, count| harness.read::<f32>(buffer, count).unwrap();
    (
        [read(s, terms), read(r, terms), read(&values, 12 * points)],
        counters,
    )
}

fn scene(order: usize, disks: bool) -> (Fmm, Vec<Vec3>) {
    let room = room::cornell(1500);
    let mut points = room.points.clone();
    // Points on a sphere that is not part of the geometry, with normals in all directions. Then 100
    // points at one position, more than a workgroup has threads.
    points.extend((0..400).map(|i| {
        let z = 1.0 - 2.0 * (i as f32 + 0.5) / 400.0;
        let phi = i as f32 * 2.399_963;
        let s = (1.0 - z * z).sqrt();
        let normal = Vec3::new(s * phi.cos(), s * phi.sin(), z);
        FmmPoint {
            position: Vec3::new(0.3, 1.2, 0.4) + 0.3 * normal,
            normal,
            weight: 0.003,
            receives: true,
        }
    }));
    points.extend([points[700]; 100]);
    // Some points only send, and some only receive.
    for (i, p) in points.iter_mut().enumerate() {
        match i % 5 {
            0 => p.receives = false,
            1 => p.weight = 0.0,
            _ => {}
        }
    }
    let settings = FmmSettings {
        order,
        disks,
        leaf: 12,
        ..FmmSettings::default()
    };
    let mesh = TriangleMesh::from_quads(&Quad::cornell_box());
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
fn fmm_passes_match_twin() {
    let harness = harness();
    let kernels = KernelPipelines::new(&harness.device).unwrap();
    for (order, disks) in [(0, true), (3, false), (4, true), (6, true)] {
        let (fmm, radiosity) = scene(order, disks);
        let mut operator = fmm.operator(|at| at);
        for point in &mut operator.points {
            point.sky = [0.1, 0.02 * point.position[0], -0.1];
            point.factor = 1.0 + 0.1 * point.position[1];
        }
        let sky = Vec3::new(0.5, 0.7, 0.9);
        let light = radiosity.iter().chain([&sky]);
        let mut light: Vec<[f32; 4]> = light.map(|b| b.extend(0.0).to_array()).collect();
        let expected = twin(&operator, &light);
        let (found, counters) = device(&harness, &kernels, &operator, &light);
        // A point with 1.5 times the radiosity must change all three outputs. A brighter sky must
        // change the last one.
        let lit = |p: &&meshless_gi::internals::transport::fmm::FmmOperatorPoint| p.share > 0.0;
        let mut sources = operator.points.iter().filter(lit);
        let at = sources.nth(700).unwrap().point as usize;
        let perturb = |light: &mut [[f32; 4]], at: usize| {
            let b = &mut light[at];
            *b = b.map(|b| 1.5 * b);
        };
        let mut dark = light.clone();
        perturb(&mut dark, radiosity.len());
        perturb(&mut light, at);
        let perturbed = twin(&operator, &light);
        for (k, what) in ["S-expansions", "R-expansions", "irradiance"]
            .into_iter()
            .enumerate()
        {
            let off = differing(&found[k], &expected[k], 12, SUM_TOLERANCE, Scale::Rms);
            assert!(
                off.is_empty(),
                "order {order}, {what}: {} of {} differ, first {:?} and not {:?}",
                off.len(),
                expected[k].len() / 12,
                &found[k][off[0] * 12..][..12],
                &expected[k][off[0] * 12..][..12]
            );
            let off = differing(&found[k], &perturbed[k], 12, SUM_TOLERANCE, Scale::Rms);
            assert!(!off.is_empty(), "{what}: a brighter point is not detected");
        }
        let off = differing(
            &found[2],
            &twin(&operator, &dark)[2],
            12,
            SUM_TOLERANCE,
            Scale::Rms,
        );
        assert!(!off.is_empty(), "a brighter sky is not detected");
        let levels = operator.levels() as u64;
        let counts = [
            EntryPoint::FmmUp,
            EntryPoint::FmmReceive,
            EntryPoint::FmmEvaluate,
        ]
        .map(|p| counters.dispatches_of(p));
        assert_eq!(counts, [levels, levels, 1]);
        // Comparison with the irradiance of the bake.
        let (wide, _) = fmm.irradiance(&radiosity).unwrap();
        let plain = fmm.operator(|at| at);
        let narrow = radiosity.iter().chain([&sky]);
        let narrow: Vec<[f32; 4]> = narrow.map(|b| b.extend(0.0).to_array()).collect();
        let ([_, _, vectors], _) = device(&harness, &kernels, &plain, &narrow);
        let vectors: &[VectorIrradiance] = bytemuck::cast_slice(&vectors);
        let mut pairs = [Vec::new(), Vec::new()];
        for point in &plain.points {
            let i = point.point as usize;
            let e = vectors[i]
                .dot(Vec3::from_array(point.normal))
                .max(Vec3::ZERO);
            pairs[0].extend(e.to_array());
            pairs[1].extend(wide[i].to_array());
        }
        assert!(differing(&pairs[0], &pairs[1], 3, 1e-3, Scale::Rms).is_empty());
    }
}

#[test]
fn fmm_order_above_limit_and_empty_input_are_handled() {
    let harness = harness();
    let kernels = KernelPipelines::new(&harness.device).unwrap();
    let empty = |order| {
        let settings = FmmSettings {
            order,
            ..FmmSettings::default()
        };
        Fmm::new(&[], &settings, None).unwrap().operator(|at| at)
    };
    let error = GpuFmm::new(&harness.device, &harness.queue, &empty(7), 0).unwrap_err();
    assert!(matches!(
        error,
        GpuError::Limit {
            have: 6,
            need: 7,
            ..
        }
    ));
    let gpu = GpuFmm::new(&harness.device, &harness.queue, &empty(4), 0).unwrap();
    let buffer = create_storage_buffer(&harness, &[[0.0f32; 4]]);
    let values = create_storage_buffer(&harness, &[VectorIrradiance::default()]);
    let mut counters = GpuCounters::default();
    harness
        .run(|encoder| {
            let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
            gpu.record_upward(&kernels, &mut pass, &mut counters, &buffer);
            gpu.record_downward(&kernels, &mut pass, &mut counters, &buffer, &values);
        })
        .unwrap();
    assert_eq!(counters.total(), 0);
}

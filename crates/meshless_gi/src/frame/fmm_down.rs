//! Kernel `fmm_down`: downward pass of the fast multipole method (\[G08\] §3.1). It computes the
//! vector irradiance of the receiving points, including that of the sky. The twin is the bake's own
//! code in single precision. The sums differ by rounding only.
//!
//! | entry point | evaluates | \[G08\] |
//! |---|---|---|
//! | `receive` | far list, local list, parent | §3.1.1 to §3.1.3 |
//! | `evaluate` | R-expansion of a leaf, near list, multipole list | §3.1.4 to §3.1.6 |
//!
//! `receive` runs one dispatch per level from the root down, with one workgroup per node and one
//! thread per term. `evaluate` runs one workgroup per leaf and one thread per point.

use super::layout::VectorIrradiance;
use crate::transport::fmm::{FmmOperator, Passes};
use glam::{Vec3, Vec4};

/// Computes `passes.locals` and `passes.values` from the output of
/// [`fmm_up`](super::fmm_up::fmm_up()). Writes the values of the receiving positions of `operator`
/// to their points in `out`, W/m². `radiosity` has the radiosity of every point, W/m². Its entry
/// `sky` is the sky's coefficient, π times the sky's radiance.
pub fn fmm_down(
    passes: &mut Passes<'_, f32>,
    operator: &FmmOperator,
    radiosity: &[[f32; 4]],
    sky: usize,
    out: &mut [VectorIrradiance],
) {
    passes.down(radiosity);
    let leaves = operator.nodes.iter().filter(|n| n.is_leaf());
    for i in leaves.flat_map(|n| n.receiver_range()) {
        let point = &operator.points[i];
        let visible_sky = Vec3::from_array(point.sky);
        let light = match visible_sky == Vec3::ZERO {
            true => Vec4::ZERO,
            false => Vec4::from_array(radiosity[sky]),
        };
        let [x, y, z] = passes.values[i].map(Vec4::from_array);
        out[point.point as usize] = VectorIrradiance {
            x: (point.factor * x + visible_sky.x * light).to_array(),
            y: (point.factor * y + visible_sky.y * light).to_array(),
            z: (point.factor * z + visible_sky.z * light).to_array(),
        };
    }
}

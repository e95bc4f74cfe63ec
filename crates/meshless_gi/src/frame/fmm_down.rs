//! Kernel `fmm_down`: the downward pass of the fast multipole method (\[G08\] §3.1), to the vector
//! irradiance of the points that receive, the sky's share with it. The twin is the bake's own code
//! in single precision; the sums differ by rounding only.
//!
//! | entry | does | of \[G08\] |
//! |---|---|---|
//! | `receive` | a level a dispatch from the root down, a node a workgroup, a term a thread: far list, local list, parent | §3.1.1 to §3.1.3 |
//! | `evaluate` | a leaf a workgroup, a point a thread: its R-expansion, near list, multipole list | §3.1.4 to §3.1.6 |

use super::layout::VectorIrradiance;
use crate::transport::fmm::{FmmOperator, Passes};
use glam::{Vec3, Vec4};

/// Fills `passes.locals` and `passes.values` from what [`fmm_up`](super::fmm_up::fmm_up()) left,
/// and writes the values of the positions of `operator` that receive to their points in `out`,
/// W/m². `radiosity` is that of every point, W/m²; at `sky` the sky's coefficient, π times its
/// radiance.
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

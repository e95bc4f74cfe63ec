//! Kernel `fmm_down`: the downward pass of the fast multipole method (\[G08\] §3.1). The twin is the bake's own code
//! in single precision; the sums differ by rounding only.
//!
//! | entry | does | of \[G08\] |
//! |---|---|---|
//! | `receive` | a level a dispatch from the root down, a node a workgroup, a term a thread: far list, local list, parent | §3.1.1 to §3.1.3 |
//! | `evaluate` | a leaf a workgroup, a point a thread: its R-expansion, near list, multipole list | §3.1.4 to §3.1.6 |

use crate::transport::fmm::Passes;

/// Fills `passes.locals` and `passes.irradiance` (W/m²), from what [`fmm_up`](super::fmm_up::fmm_up()) left and radiosities in the tree's order.
pub fn fmm_down(passes: &mut Passes<'_, f32>, radiosity: &[[f32; 4]]) {
    passes.down(radiosity);
}

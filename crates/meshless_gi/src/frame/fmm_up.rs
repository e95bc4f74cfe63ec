//! Kernel `fmm_up`: the upward pass of the fast multipole method (\[G08\] §3.0.1, §3.0.2), a level
//! a dispatch from the deepest up, a node a workgroup and a term a thread: S-expansions of the
//! leaves from their points, of the others from their children. The twin is the bake's own code
//! ([`Field::leaf`](crate::transport::fmm::passes::Field::leaf),
//! [`Field::gather`](crate::transport::fmm::passes::Field::gather)) in single precision; the sums
//! differ by rounding only.

use crate::transport::fmm::Passes;

/// Fills `passes.sources`, from the radiosity of every point, W/m².
pub fn fmm_up(passes: &mut Passes<'_, f32>, radiosity: &[[f32; 4]]) {
    passes.up(radiosity);
}

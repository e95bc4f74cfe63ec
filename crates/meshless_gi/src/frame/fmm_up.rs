//! Kernel `fmm_up`: upward pass of the fast multipole method (\[G08\] §3.0.1, §3.0.2). It computes
//! the S-expansions of the leaves from their points, and those of the other nodes from their
//! children. The shader runs one dispatch per level from the deepest up, with one workgroup per
//! node and one thread per term. The twin is the bake's own code
//! ([`Field::leaf`](crate::transport::fmm::passes::Field::leaf),
//! [`Field::gather`](crate::transport::fmm::passes::Field::gather)) in single precision. The sums
//! differ by rounding only.

use crate::transport::fmm::Passes;

/// Computes `passes.sources` from the radiosity of every point, W/m².
pub fn fmm_up(passes: &mut Passes<'_, f32>, radiosity: &[[f32; 4]]) {
    passes.up(radiosity);
}

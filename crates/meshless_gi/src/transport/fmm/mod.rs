//! Light between points by the fast multipole method (\[G08\]). It has neither mesh nor basis, only
//! positions, normals and the surface area of each point.
//!
//! | file | contents |
//! |---|---|
//! | `settings` | points, settings, errors |
//! | [`harmonics`] | \[G08\] Eqs. (5)-(9) as printed |
//! | [`terms`], [`tensor`] | the same polynomials as monomials, and the derivatives of the kernel |
//! | [`expansion`] | S-expansion, S→S, S→R, R→R, evaluation |
//! | [`tree`] | adaptive octree |
//! | [`facing`], [`visibility`] | tests if nodes light each other |
//! | [`lists`] | the four interaction lists |
//! | [`passes`] | upward and downward pass per node, in single and double precision |
//! | `threads` | the passes on several threads |
//! | `solve` | solver |
//! | `operator` | octree as a bake stores it |
//! | [`direct()`] | reference: the sum over all pairs |
//!
//! Deviations from \[G08\]:
//! - Cartesian terms (the same space, tested degree by degree).
//! - One vector per term instead of source and receiver matrices.
//! - Nodes with one direction, so that the kernel's max(0, ·) is kept.
//! - Lists by division of pairs.
//! - Visibility as a fraction between nodes, by rays.
//! - All colors together.

mod direct;
pub mod expansion;
pub mod facing;
pub mod harmonics;
pub mod lists;
mod operator;
pub mod passes;
pub mod real;
mod settings;
mod solve;
pub mod tensor;
pub mod terms;
mod threads;
pub mod tree;
pub mod visibility;

pub use direct::direct;
pub use operator::{FmmNode, FmmOperator, FmmOperatorPoint};
pub use settings::{FmmError, FmmPoint, FmmSettings, check_points};
pub use solve::{Fmm, FmmSolution};
pub use threads::{PassTimes, Passes};

//! Light between points by the fast multipole method (\[G08\]): no mesh, no basis, only positions,
//! normals and the surface that each point stands for.
//!
//! | file | what |
//! |---|---|
//! | `settings` | points, settings, errors |
//! | [`harmonics`] | \[G08\] Eqs. (5)-(9) as they stand |
//! | [`terms`], [`tensor`] | the same polynomials as monomials, and the derivatives of the kernel |
//! | [`expansion`] | S-expansion, S→S, S→R, R→R, evaluation |
//! | [`tree`] | the adaptive octree |
//! | [`facing`], [`visibility`] | which nodes light each other |
//! | [`lists`] | the four interaction lists |
//! | [`passes`] | upward and downward, node by node, in either precision |
//! | `threads` | the same, shared out to threads |
//! | `solve` | the solver |
//! | `operator` | the octree as a bake stores it |
//! | [`direct()`] | the sum over all pairs that it stands in for |
//!
//! Deviations from \[G08\]: Cartesian terms (the same space, tested degree by degree); one vector
//! a term for source and receiver matrices; nodes that face one way, so that the kernel's max(0, ·)
//! is kept; lists by division of pairs; visibility as a part between nodes, by rays; colors
//! together.

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

//! How light travels: the sparse operator from sender coefficients to vector irradiance.

mod operator;

pub use operator::{BounceLink, BounceOperator, Link, Operator, Row, SenderForm};

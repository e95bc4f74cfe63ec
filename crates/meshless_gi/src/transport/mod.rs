//! Light transport: the gather, refinement and truncation of rows, and the sparse operator.

mod added_level;
mod baked_bounces;
pub mod bounded_truncation;
pub mod fmm;
mod gather;
pub mod l08_truncation;
mod link_quantization;
mod moved_mass;
mod occluded_links;
mod operator;
mod pack;
pub mod pca;
mod probes;
mod quantized_row;
mod receiver;
mod receiver_rays;
mod refine;
mod residual;
mod tiers;
mod training;

pub use baked_bounces::{BounceScene, bounce_operator};
pub use bounded_truncation::SenderTree;
pub use gather::{
    Deposit, GatherScene, GatherSettings, Gathered, gather, gather_sky_harmonics,
    gather_sky_visibility, trace_gather_rays,
};
pub use link_quantization::{MAX_CODE, RowQuantizer, precision_of};
pub use moved_mass::TruncationMass;
pub use occluded_links::{
    LinkTerm, PackedLinkTerm, UnindexedLinkTerm, link_of_parts, merge_parts, number_sets,
};
pub use operator::{
    BounceLink, BounceOperator, Link, Operator, Row, SenderForm, place_links, row_order,
};
pub use pack::{PackSettings, Packed, pack};
pub use probes::{PROBE_ROWS, ProbeGather, probe_rows};
pub use receiver_rays::{ReceiverRay, ReceiverRays};
pub use refine::{BoundedSettings, RawRow, Receivers, RefinedOperator, refine_bounded};
pub use tiers::{TIERS, assign_tiers};
pub use training::{
    NormalRow, TRAINING_LIGHTS, Training, TrainingRadiosity, coarse_rows, mean_squares,
};

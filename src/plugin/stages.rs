//! Which stage of the plan each kernel belongs to: what counters are summed by.

use crate::gpu::Pass;
use crate::plan::Stage;

/// The stage of the plan that a dispatch belongs to.
pub(super) fn stage_of(pass: Pass) -> Stage {
    match pass {
        Pass::Occlude => Stage::Occlude,
        Pass::Project => Stage::Project,
        Pass::Radiosity
        | Pass::Pull
        | Pass::Push
        | Pass::Compress
        | Pass::Sweep
        | Pass::Gather
        | Pass::Spread
        | Pass::Add => Stage::PullPush,
        Pass::Apply | Pass::ApplyOne => Stage::Apply,
        Pass::Averages | Pass::Differences => Stage::Flatten,
        Pass::SoftShadow => Stage::SoftShadow,
        Pass::Splat
        | Pass::SplatOver
        | Pass::SplatNodes
        | Pass::PyramidBase
        | Pass::PyramidReduce
        | Pass::RefineStart
        | Pass::Refine
        | Pass::Upsample
        | Pass::Resolve
        | Pass::Fill => Stage::Splat,
        Pass::ProbeNodes | Pass::ProbeOver => Stage::Probe,
        Pass::Volume => Stage::Volume,
        Pass::RsmTexels | Pass::RsmShadow | Pass::RsmChoose => Stage::Rsm,
        // Light between points stands in for the operator.
        Pass::FmmUp | Pass::FmmReceive | Pass::FmmEvaluate => Stage::Apply,
        Pass::Vpl | Pass::VplOver | Pass::VplNodes => Stage::Vpl,
        Pass::VplSpecular | Pass::VplSpecularPixels => Stage::VplSpecular,
        Pass::SubtractShadow | Pass::SubtractShadowOver => Stage::SubtractShadow,
        Pass::FogInscatter => Stage::Fog,
    }
}

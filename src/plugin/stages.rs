//! Which stage of the plan each kernel belongs to: what counters are summed by.

use crate::gpu::Pass;
use crate::plan::FrameStage;

/// The stage of the plan that a dispatch belongs to.
pub(super) fn stage_of(pass: Pass) -> FrameStage {
    match pass {
        Pass::Occlude => FrameStage::OCCLUDE,
        Pass::Project => FrameStage::PROJECT,
        Pass::Radiosity
        | Pass::Pull
        | Pass::Push
        | Pass::Compress
        | Pass::Sweep
        | Pass::Gather
        | Pass::Spread
        | Pass::Add => FrameStage::PULL_PUSH,
        Pass::Apply | Pass::ApplyOne => FrameStage::APPLY,
        Pass::Averages | Pass::Differences => FrameStage::FLATTEN,
        Pass::SoftShadow => FrameStage::SOFT_SHADOW,
        Pass::Splat
        | Pass::SplatOver
        | Pass::SplatNodes
        | Pass::PyramidBase
        | Pass::PyramidReduce
        | Pass::RefineStart
        | Pass::Refine
        | Pass::Upsample
        | Pass::Resolve
        | Pass::Fill => FrameStage::SPLAT,
        Pass::ProbeNodes | Pass::ProbeOver => FrameStage::PROBE,
        Pass::Volume => FrameStage::VOLUME,
        Pass::RsmTexels | Pass::RsmShadow | Pass::RsmSelect => FrameStage::RSM,
        // Light between points stands in for the operator.
        Pass::FmmUp | Pass::FmmReceive | Pass::FmmEvaluate => FrameStage::APPLY,
        Pass::Vpl | Pass::VplOver | Pass::VplNodes => FrameStage::VPL,
        Pass::VplSpecular | Pass::VplSpecularPixels => FrameStage::VPL_SPECULAR,
        Pass::SubtractShadow | Pass::SubtractShadowOver => FrameStage::SUBTRACT_SHADOW,
        Pass::FogInscatter => FrameStage::FOG,
    }
}

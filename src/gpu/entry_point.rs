//! Compute entry points by name, for dispatches and their counters.

use super::kernel::ComputeEntry;
use super::kernels::KERNELS;

/// Compute entry point.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum EntryPoint {
    /// `occlude`.
    Occlude,
    /// `project`.
    Project,
    /// `radiosity`.
    Radiosity,
    /// `pull`.
    Pull,
    /// `push`.
    Push,
    /// `compress`.
    Compress,
    /// `apply`.
    Apply,
    /// `apply_one`.
    ApplyOne,
    /// `bounce`, one Jacobi step.
    Sweep,
    /// `bounce`, baked, the coarsest points.
    Gather,
    /// `bounce`, baked, one finer level.
    Interpolate,
    /// `bounce`, baked, the sum.
    Add,
    /// `flatten`, one level of averages.
    Averages,
    /// `flatten`, differences.
    Differences,
    /// `soft_shadow`.
    SoftShadow,
    /// `splat`, the first scene of a view.
    Splat,
    /// `splat`, a further scene of a view.
    SplatOver,
    /// `probe`, the subsplats of a list.
    ProbeNodes,
    /// `probe`, at every pixel.
    ProbeOver,
    /// `volume`.
    Volume,
    /// `rsm`, the lit texels of one map.
    RsmTexels,
    /// `rsm`, shadows of one baked scene on a light's texels.
    RsmShadow,
    /// `rsm`, the virtual point lights of one light.
    RsmSelect,
    /// `vpl`, in a view without earlier light.
    Vpl,
    /// `vpl`, added to the output of baked scenes.
    VplOver,
    /// `vpl`, the subsplats of a list.
    VplNodes,
    /// `splat`, the subsplats of a list.
    SplatNodes,
    /// `pyramid`, pixels to level 1.
    PyramidBase,
    /// `pyramid`, a level from the next finer one.
    PyramidReduce,
    /// `refine`, the cells of the coarsest level.
    RefineStart,
    /// `refine`, the children of the cells of one level.
    Refine,
    /// `upsample`, a level from the next coarser one.
    Upsample,
    /// `upsample`, the pixels.
    Resolve,
    /// `upsample`, the pixels that are evaluated directly.
    Fill,
    /// `vpl_specular`, the nodes of a level.
    VplSpecular,
    /// `vpl_specular`, the pixels.
    VplSpecularPixels,
    /// `subtract_shadow`, the first scene of a view.
    SubtractShadow,
    /// `subtract_shadow`, a further scene of a view.
    SubtractShadowOver,
    /// `fmm_up`, a level.
    FmmUp,
    /// `fmm_down`, a level.
    FmmReceive,
    /// `fmm_down`, the points.
    FmmEvaluate,
    /// `fog_inscatter`.
    FogInscatter,
}

impl EntryPoint {
    /// Number of entry points.
    pub const COUNT: usize = 42;

    /// All entry points, in the order of the table.
    pub const ALL: [Self; Self::COUNT] = [
        Self::Occlude,
        Self::Project,
        Self::Radiosity,
        Self::Pull,
        Self::Push,
        Self::Compress,
        Self::Apply,
        Self::ApplyOne,
        Self::Sweep,
        Self::Gather,
        Self::Interpolate,
        Self::Add,
        Self::Averages,
        Self::Differences,
        Self::SoftShadow,
        Self::Splat,
        Self::SplatOver,
        Self::ProbeNodes,
        Self::ProbeOver,
        Self::Volume,
        Self::RsmTexels,
        Self::RsmShadow,
        Self::RsmSelect,
        Self::Vpl,
        Self::VplOver,
        Self::VplNodes,
        Self::SplatNodes,
        Self::PyramidBase,
        Self::PyramidReduce,
        Self::RefineStart,
        Self::Refine,
        Self::Upsample,
        Self::Resolve,
        Self::Fill,
        Self::VplSpecular,
        Self::VplSpecularPixels,
        Self::SubtractShadow,
        Self::SubtractShadowOver,
        Self::FmmUp,
        Self::FmmReceive,
        Self::FmmEvaluate,
        Self::FogInscatter,
    ];

    /// Returns the index of its kernel, and its row in the kernel's table.
    #[must_use]
    pub fn entry(self) -> (usize, &'static ComputeEntry) {
        for (at, kernel) in KERNELS.iter().enumerate() {
            if let Some(entry) = kernel.entries.iter().find(|e| e.id == self) {
                return (at, entry);
            }
        }
        unreachable!("every entry point is in the table; a test counts them")
    }
}

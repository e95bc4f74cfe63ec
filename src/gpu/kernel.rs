//! Types of a row of the [table of kernels](super::KERNELS): bindings, entry points, and functions
//! that construct them.

use super::Pass;

/// Kind of resource of a binding.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// A uniform buffer of this size in bytes.
    Uniform(usize),
    /// A [`Span`](meshless_gi::internals::frame::Span) at a dynamic offset of a uniform buffer.
    Span,
    /// A storage buffer that is read: an array of elements of this size in bytes.
    Read(usize),
    /// A storage buffer that is read and written.
    Write(usize),
    /// A depth texture.
    Depth,
    /// A texture of unsigned integers.
    Uint,
    /// A texture of floats, not filtered.
    Float,
    /// An array of such textures.
    Layers,
    /// An `Rgba16Float` storage texture that is written.
    Output,
    /// Such a texture in three dimensions.
    Voxels,
    /// A depth texture with several samples per pixel.
    Samples,
    /// A texture of floats in three dimensions, filtered.
    Space,
    /// A sampler of a texture.
    Sampler,
}

/// Binding of a shader. All bindings are in group 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Binding {
    /// Its number.
    pub index: u32,
    /// Its name in the shader.
    pub name: &'static str,
    /// Kind of resource.
    pub kind: Kind,
}

/// An entry point of a compute shader.
#[derive(Clone, Copy, Debug)]
pub struct Entry {
    /// Pass that runs this entry point.
    pub pass: Pass,
    /// Its name in the shader.
    pub name: &'static str,
    /// Threads of a workgroup.
    pub workgroup: [u32; 3],
    /// Number of points, rows or pixels that a workgroup handles.
    pub items: u32,
    /// The bindings that it uses.
    pub bindings: &'static [u32],
}

/// A kernel: a shader of this name, and a CPU twin of this name.
#[derive(Clone, Copy, Debug)]
pub struct Kernel {
    /// Its name.
    pub name: &'static str,
    /// Its shader with the library parts in front.
    pub source: &'static str,
    /// Everything that the shader binds.
    pub bindings: &'static [Binding],
    /// Compute entry points of the kernel. Empty if it draws.
    pub entries: &'static [Entry],
}

impl Kernel {
    /// Its entry points where it draws: vertex, and then fragments.
    #[must_use]
    pub fn draws(&self) -> &'static [&'static str] {
        match self.name {
            "composite" => &COMPOSITE_ENTRIES,
            "fog" => &FOG_ENTRIES,
            _ => &[],
        }
    }
}

/// Entry points of `composite`: vertex, and the fragments of irradiance, of gloss and of soft
/// shadows.
pub const COMPOSITE_ENTRIES: [&str; 4] = [
    "whole_screen",
    "composite",
    "composite_specular",
    "composite_shadow",
];

/// Entry points of `fog`: vertex, and the fragments of views with one and with several samples per
/// pixel.
pub const FOG_ENTRIES: [&str; 3] = ["fog_screen", "fog", "fog_sampled"];

pub(super) const fn bind(index: u32, name: &'static str, kind: Kind) -> Binding {
    Binding { index, name, kind }
}

/// An entry point with 64 threads, a thread an item.
pub(super) const fn each(pass: Pass, name: &'static str, bindings: &'static [u32]) -> Entry {
    Entry {
        pass,
        name,
        workgroup: [64, 1, 1],
        items: 64,
        bindings,
    }
}

/// An entry point of 8 × 8 pixels.
pub(super) const fn tile(pass: Pass, name: &'static str, bindings: &'static [u32]) -> Entry {
    Entry {
        pass,
        name,
        workgroup: [8, 8, 1],
        items: 64,
        bindings,
    }
}

/// An entry point with a workgroup of 64 threads a node of an octree.
pub(super) const fn node(pass: Pass, name: &'static str, bindings: &'static [u32]) -> Entry {
    Entry {
        pass,
        name,
        workgroup: [64, 1, 1],
        items: 1,
        bindings,
    }
}

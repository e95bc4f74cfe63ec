//! Types of a row of the [table of kernels](super::KERNELS): bindings, entry points, and functions
//! that construct them.

use super::EntryPoint;

/// Kind of resource of a binding.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BindingKind {
    /// Uniform buffer of this size in bytes.
    Uniform(usize),
    /// A [`Span`](meshless_gi::internals::frame::Span) at a dynamic offset of a uniform buffer.
    Span,
    /// Storage buffer that is read: an array of elements of this size in bytes.
    Read(usize),
    /// Storage buffer that is read and written.
    Write(usize),
    /// Depth texture.
    Depth,
    /// Texture of unsigned integers.
    Uint,
    /// Texture of floats, not filtered.
    Float,
    /// Array of `Float` textures.
    Layers,
    /// `Rgba16Float` storage texture that is written.
    Output,
    /// Three-dimensional `Output` texture.
    Voxels,
    /// Depth texture with several samples per pixel.
    Samples,
    /// Three-dimensional texture of floats, filtered.
    Space,
    /// Sampler of a texture.
    Sampler,
}

/// Binding of a shader. All bindings are in group 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Binding {
    /// Number of the binding.
    pub index: u32,
    /// Name in the shader.
    pub name: &'static str,
    /// Kind of resource.
    pub kind: BindingKind,
}

/// Entry point of a compute shader.
#[derive(Clone, Copy, Debug)]
pub struct ComputeEntry {
    /// Identifier of the entry point.
    pub id: EntryPoint,
    /// Name in the shader.
    pub name: &'static str,
    /// Number of threads of a workgroup in each dimension.
    pub workgroup: [u32; 3],
    /// Number of points, rows or pixels per workgroup.
    pub items: u32,
    /// Bindings that it uses.
    pub bindings: &'static [u32],
}

/// Kernel: a shader and a CPU twin with the same name.
#[derive(Clone, Copy, Debug)]
pub struct Kernel {
    /// Name of the kernel.
    pub name: &'static str,
    /// Source of the shader, preceded by its library parts.
    pub source: &'static str,
    /// All bindings of the shader.
    pub bindings: &'static [Binding],
    /// Compute entry points of the kernel. Empty if it draws.
    pub entries: &'static [ComputeEntry],
}

impl Kernel {
    /// Returns the entry points of a kernel that draws: vertex, then fragments.
    #[must_use]
    pub fn draws(&self) -> &'static [&'static str] {
        match self.name {
            "composite" => &COMPOSITE_ENTRIES,
            "fog" => &FOG_ENTRIES,
            _ => &[],
        }
    }
}

/// Entry points of `composite`: vertex, then the fragments of irradiance, of specular reflection
/// and of soft shadows.
pub const COMPOSITE_ENTRIES: [&str; 4] = [
    "whole_screen",
    "composite",
    "composite_specular",
    "composite_shadow",
];

/// Entry points of `fog`: vertex, then the fragments of views with one and with several samples per
/// pixel.
pub const FOG_ENTRIES: [&str; 3] = ["fog_screen", "fog", "fog_sampled"];

pub(super) const fn bind(index: u32, name: &'static str, kind: BindingKind) -> Binding {
    Binding { index, name, kind }
}

/// Creates an entry point with workgroups of 64 threads, one thread per item.
pub(super) const fn each(
    id: EntryPoint,
    name: &'static str,
    bindings: &'static [u32],
) -> ComputeEntry {
    ComputeEntry {
        id,
        name,
        workgroup: [64, 1, 1],
        items: 64,
        bindings,
    }
}

/// Creates an entry point with workgroups of 8 × 8 pixels.
pub(super) const fn tile(
    id: EntryPoint,
    name: &'static str,
    bindings: &'static [u32],
) -> ComputeEntry {
    ComputeEntry {
        id,
        name,
        workgroup: [8, 8, 1],
        items: 64,
        bindings,
    }
}

/// Creates an entry point with a workgroup of 64 threads per node of an octree.
pub(super) const fn node(
    id: EntryPoint,
    name: &'static str,
    bindings: &'static [u32],
) -> ComputeEntry {
    ComputeEntry {
        id,
        name,
        workgroup: [64, 1, 1],
        items: 1,
        bindings,
    }
}

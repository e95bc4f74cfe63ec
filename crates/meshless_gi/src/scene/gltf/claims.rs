//! Sizes that a file states, counted before any allocation for them.

use super::accessor::{Buffers, MAX_ZEROS};
use ::gltf::json::mesh::{Mesh, Mode, Primitive, Semantic};
use ::gltf::json::validation::Checked;
use ::gltf::json::{Accessor, Index};

/// Returns an upper bound on the number of objects of a JSON text.
pub(super) fn objects(json: &[u8]) -> u64 {
    json.iter().filter(|byte| **byte == b'{').count() as u64
}

/// Returns the number of triangles of the nodes `first` and of all nodes below them. Accessors that
/// do not fit into their buffer views count as zero, because they are refused when they are read.
pub(super) fn triangles(buffers: &Buffers<'_>, first: &[usize]) -> u64 {
    let root = buffers.root;
    let meshes: Vec<u64> = root.meshes.iter().map(|m| mesh(buffers, m)).collect();
    let mut visited = vec![false; root.nodes.len()];
    let mut open = first.to_vec();
    let mut sum = 0u64;
    while let Some(index) = open.pop() {
        let Some(node) = root.nodes.get(index) else {
            continue;
        };
        if std::mem::replace(&mut visited[index], true) {
            continue;
        }
        let mesh = node.mesh.and_then(|m| meshes.get(m.value()));
        sum = sum.saturating_add(mesh.copied().unwrap_or(0));
        open.extend(node.children.iter().flatten().map(|child| child.value()));
    }
    sum
}

fn mesh(buffers: &Buffers<'_>, mesh: &Mesh) -> u64 {
    let all = mesh.primitives.iter().map(|p| primitive(buffers, p));
    all.fold(0, u64::saturating_add)
}

fn primitive(buffers: &Buffers<'_>, primitive: &Primitive) -> u64 {
    let positions = || {
        let positions = Checked::Valid(Semantic::Positions);
        primitive.attributes.get(&positions).copied()
    };
    let corners = primitive.indices.or_else(positions);
    let corners = corners.map_or(0, |accessor| elements(buffers, accessor));
    match primitive.mode {
        Checked::Valid(Mode::Triangles) => corners / 3,
        Checked::Valid(Mode::TriangleStrip | Mode::TriangleFan) => corners.saturating_sub(2),
        _ => 0,
    }
}

fn elements(buffers: &Buffers<'_>, accessor: Index<Accessor>) -> u64 {
    let Some(accessor) = buffers.root.accessors.get(accessor.value()) else {
        return 0;
    };
    let held = match accessor.buffer_view {
        // An element takes at least one byte.
        Some(view) => buffers.view(view).map_or(0, <[u8]>::len),
        None => MAX_ZEROS,
    };
    match accessor.count.0 {
        count if count <= held as u64 => count,
        _ => 0,
    }
}

//! Triangles, texture coordinates and vertex colors of a Bevy mesh.

use bevy::math::{Vec2, Vec3};
use bevy::mesh::{Indices, Mesh, MeshAccessError, PrimitiveTopology, VertexAttributeValues};

/// Reason why a mesh can't be read.
#[derive(Debug, PartialEq)]
pub(super) enum MeshProblem {
    /// Its data is in the render world alone.
    InRenderWorld,
    /// The mesh consists of points or lines.
    NoTriangles(PrimitiveTopology),
    /// Other reason.
    Unreadable(String),
}

/// Data of a mesh that a bake reads.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct MeshData {
    pub(super) positions: Vec<Vec3>,
    /// Indices of positions, all of them valid.
    pub(super) triangles: Vec<[u32; 3]>,
    /// `ATTRIBUTE_UV_0` and `ATTRIBUTE_UV_1`. Empty if missing.
    pub(super) uvs: [Vec<Vec2>; 2],
    /// Linear RGBA. Empty if missing.
    pub(super) colors: Vec<[f32; 4]>,
    /// Triangles that were dropped because an index was out of range.
    pub(super) bad_indices: u64,
}

impl MeshData {
    /// Copies the data of `mesh`.
    pub(super) fn read(mesh: &Mesh) -> Result<Self, MeshProblem> {
        let topology = mesh.primitive_topology();
        let strip = match topology {
            PrimitiveTopology::TriangleList => false,
            PrimitiveTopology::TriangleStrip => true,
            other => return Err(MeshProblem::NoTriangles(other)),
        };
        let positions = match mesh.try_attribute(Mesh::ATTRIBUTE_POSITION) {
            Ok(VertexAttributeValues::Float32x3(positions)) => positions,
            Ok(other) => {
                let format = wgpu_name(other);
                return Err(MeshProblem::Unreadable(format!(
                    "positions of format {format} are not supported, `Float32x3` is"
                )));
            }
            Err(MeshAccessError::ExtractedToRenderWorld) => return Err(MeshProblem::InRenderWorld),
            Err(_) => return Err(MeshProblem::Unreadable("it has no positions".into())),
        };
        let indices = match mesh.try_indices_option() {
            Ok(indices) => indices,
            Err(MeshAccessError::ExtractedToRenderWorld) => return Err(MeshProblem::InRenderWorld),
            Err(error) => return Err(MeshProblem::Unreadable(error.to_string())),
        };
        let count = positions.len() as u32;
        let mut triangles = match indices {
            Some(indices) => assemble(indices, strip),
            None if strip => strip_triangles(&(0..count).collect::<Vec<_>>()),
            None => list_triangles(0..count),
        };
        let all = triangles.len();
        triangles.retain(|corners| corners.iter().all(|&v| v < count));
        let uvs = [Mesh::ATTRIBUTE_UV_0, Mesh::ATTRIBUTE_UV_1].map(|attribute| {
            match mesh.try_attribute_option(attribute) {
                Ok(Some(VertexAttributeValues::Float32x2(uvs))) => {
                    uvs.iter().map(|uv| Vec2::from_array(*uv)).collect()
                }
                _ => Vec::new(),
            }
        });
        Ok(Self {
            positions: positions.iter().map(|p| Vec3::from_array(*p)).collect(),
            bad_indices: (all - triangles.len()) as u64,
            triangles,
            uvs,
            colors: colors(mesh),
        })
    }
}

/// Vertex colors in the formats that Bevy's shaders read.
fn colors(mesh: &Mesh) -> Vec<[f32; 4]> {
    match mesh.try_attribute_option(Mesh::ATTRIBUTE_COLOR) {
        Ok(Some(VertexAttributeValues::Float32x4(colors))) => colors.clone(),
        Ok(Some(VertexAttributeValues::Unorm8x4(colors))) => {
            let unorm = |c: &[u8; 4]| c.map(|v| f32::from(v) / 255.0);
            colors.iter().map(unorm).collect()
        }
        _ => Vec::new(),
    }
}

fn assemble(indices: &Indices, strip: bool) -> Vec<[u32; 3]> {
    let restart = match indices {
        Indices::U16(_) => u32::from(u16::MAX),
        Indices::U32(_) => u32::MAX,
    };
    let order = indices.iter().map(|i| i as u32);
    if !strip {
        return list_triangles(order);
    }
    let order: Vec<u32> = order.collect();
    let strips = order.split(|&i| i == restart);
    strips.flat_map(strip_triangles).collect()
}

fn list_triangles(order: impl Iterator<Item = u32>) -> Vec<[u32; 3]> {
    let order: Vec<u32> = order.collect();
    let triangles = order.chunks_exact(3);
    triangles.map(|c| [c[0], c[1], c[2]]).collect()
}

/// Triangles of a strip, all with the winding of the first.
fn strip_triangles(order: &[u32]) -> Vec<[u32; 3]> {
    let wound = |(i, w): (usize, &[u32])| match i % 2 {
        0 => [w[0], w[1], w[2]],
        _ => [w[1], w[0], w[2]],
    };
    order.windows(3).enumerate().map(wound).collect()
}

fn wgpu_name(values: &VertexAttributeValues) -> String {
    format!("`{:?}`", bevy::mesh::VertexFormat::from(values))
}

#[cfg(test)]
mod tests {
    use super::*;
    use bevy::asset::RenderAssetUsages;

    fn mesh(topology: PrimitiveTopology, vertices: usize) -> Mesh {
        let positions: Vec<[f32; 3]> = (0..vertices).map(|i| [i as f32, 0.0, 0.0]).collect();
        Mesh::new(topology, RenderAssetUsages::default())
            .with_inserted_attribute(Mesh::ATTRIBUTE_POSITION, positions)
    }

    #[test]
    fn indices_out_of_range_are_counted() {
        for indices in [
            Indices::U16(vec![0, 1, 2, 0, 2, 9]),
            Indices::U32(vec![0, 1, 2, 0, 2, 9, 1]),
        ] {
            let list = mesh(PrimitiveTopology::TriangleList, 4).with_inserted_indices(indices);
            let data = MeshData::read(&list).unwrap();
            assert_eq!((data.triangles, data.bad_indices), (vec![[0, 1, 2]], 1));
        }
    }

    #[test]
    fn strips_keep_their_winding_and_restart() {
        let strip = mesh(PrimitiveTopology::TriangleStrip, 7);
        assert_eq!(
            MeshData::read(&strip).unwrap().triangles[..3],
            [[0, 1, 2], [2, 1, 3], [2, 3, 4]]
        );
        let order = vec![0, 1, 2, 3, u16::MAX, 4, 5, 6];
        let restarted = strip.with_inserted_indices(Indices::U16(order));
        let data = MeshData::read(&restarted).unwrap();
        assert_eq!(data.triangles, [[0, 1, 2], [2, 1, 3], [4, 5, 6]]);
        assert_eq!(data.bad_indices, 0);
    }

    #[test]
    fn lines_missing_positions_and_extracted_meshes_are_problems() {
        let topology = PrimitiveTopology::LineList;
        assert_eq!(
            MeshData::read(&mesh(topology, 4)),
            Err(MeshProblem::NoTriangles(topology))
        );
        let empty = Mesh::new(
            PrimitiveTopology::TriangleList,
            RenderAssetUsages::default(),
        );
        assert!(matches!(
            MeshData::read(&empty),
            Err(MeshProblem::Unreadable(reason)) if reason.contains("no positions")
        ));
        let mut extracted = mesh(PrimitiveTopology::TriangleList, 3);
        extracted.take_gpu_data().unwrap();
        assert_eq!(MeshData::read(&extracted), Err(MeshProblem::InRenderWorld));
    }
}

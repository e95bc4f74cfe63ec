//! Buffers, node tree, textures and triangle lists of a glTF document.

use super::super::Texture;
use super::*;

pub(super) fn load_buffers<'a>(
    root: &Root,
    binary: Option<&'a [u8]>,
    file: &str,
    resolve: &mut Resolver<'_>,
) -> Result<Vec<Cow<'a, [u8]>>, SceneError> {
    let mut out = Vec::with_capacity(root.buffers.len());
    for (i, buffer) in root.buffers.iter().enumerate() {
        let wrong = |reason: String| SceneError::Format {
            file: file.into(),
            reason: format!("buffer {i}: {reason}"),
        };
        let bytes: Cow<'a, [u8]> = match (&buffer.uri, binary) {
            (None, Some(binary)) if i == 0 => Cow::Borrowed(binary),
            (None, _) => return Err(wrong("it has no bytes".into())),
            (Some(uri), _) => Cow::Owned(match container::data_uri(uri) {
                Some(bytes) => bytes.map_err(wrong)?,
                None => resolve(&container::file_name(uri))?,
            }),
        };
        if (bytes.len() as u64) < buffer.byte_length.0 {
            return Err(wrong(format!(
                "{} bytes, {} are declared",
                bytes.len(),
                buffer.byte_length.0
            )));
        }
        out.push(bytes);
    }
    Ok(out)
}

/// Returns the nodes of the default scene. Without a default scene, returns all nodes without a
/// parent.
pub(super) fn first_nodes(root: &Root) -> Result<Vec<usize>, String> {
    let scene = match root.scene {
        Some(index) => Some(
            root.scenes
                .get(index.value())
                .ok_or_else(|| format!("scene {} is not there", index.value()))?,
        ),
        None => root.scenes.first(),
    };
    if let Some(scene) = scene {
        return Ok(scene.nodes.iter().map(|n| n.value()).collect());
    }
    let mut child = vec![false; root.nodes.len()];
    for index in root.nodes.iter().flat_map(|n| n.children.iter().flatten()) {
        if let Some(c) = child.get_mut(index.value()) {
            *c = true;
        }
    }
    Ok((0..child.len()).filter(|&i| !child[i]).collect())
}

/// Decodes the textures that a material uses, and renumbers the indices of the materials.
pub(super) fn used_textures(
    file: &str,
    buffers: &Buffers<'_>,
    materials: &mut [PlacedMaterial],
    resolve: &mut Resolver<'_>,
) -> Result<Vec<Texture>, SceneError> {
    let mut renumbered = vec![None; buffers.root.textures.len()];
    let (mut out, mut texels) = (Vec::new(), 0u64);
    for m in materials.iter_mut().map(|m| &mut m.material) {
        let slots = [
            &mut m.base_color_texture,
            &mut m.metallic_texture,
            &mut m.emissive_texture,
        ];
        for slot in slots.into_iter().flatten() {
            let number = &mut renumbered[*slot as usize];
            if number.is_none() {
                let left = MAX_TEXELS - texels;
                let texture = material::texture(file, buffers, *slot as usize, left, resolve)?;
                texels += texture.len();
                *number = Some(out.len() as u32);
                out.push(texture);
            }
            *slot = number.unwrap_or(0);
        }
    }
    Ok(out)
}

pub(super) fn local_transform(node: &scene::Node) -> DMat4 {
    if let Some(columns) = node.matrix {
        return DMat4::from_cols_array(&columns.map(f64::from));
    }
    let scale = node.scale.unwrap_or([1.0; 3]);
    let turn = DQuat::from_array(node.rotation.unwrap_or_default().0.map(f64::from));
    let turn = if turn.length_squared() > 0.0 {
        turn.normalize()
    } else {
        DQuat::IDENTITY
    };
    let shift = node.translation.unwrap_or([0.0; 3]);
    DMat4::from_scale_rotation_translation(
        DVec3::from_array(scale.map(f64::from)),
        turn,
        DVec3::from_array(shift.map(f64::from)),
    )
}

/// Returns the triangles of a list, strip or fan, all with the same winding.
pub(super) fn assemble(mode: Mode, order: &[u32]) -> Vec<[u32; 3]> {
    match mode {
        Mode::TriangleStrip => order
            .windows(3)
            .enumerate()
            .map(|(i, w)| {
                if i % 2 == 0 {
                    [w[0], w[1], w[2]]
                } else {
                    [w[1], w[0], w[2]]
                }
            })
            .collect(),
        Mode::TriangleFan => match order.split_first() {
            Some((&hub, rim)) => rim.windows(2).map(|w| [hub, w[0], w[1]]).collect(),
            None => Vec::new(),
        },
        _ => order.chunks_exact(3).map(|c| [c[0], c[1], c[2]]).collect(),
    }
}

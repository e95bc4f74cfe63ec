//! glTF files of a room, similar to the export of a modeling tool.

use super::scenes::Room;

/// Returns the room as JSON that references its buffer by `uri`, and the buffer.
pub fn gltf(room: &Room, uri: &str) -> (Vec<u8>, Vec<u8>) {
    document(room, &format!(r#","uri":"{uri}""#), None)
}

/// Creates one mesh with one primitive and one material per surface. `uri` is the JSON fragment
/// with the buffer's URI. All surfaces use the image `texture` if given.
fn document(room: &Room, uri: &str, texture: Option<&str>) -> (Vec<u8>, Vec<u8>) {
    let mut binary: Vec<u8> = Vec::new();
    let mut views = Vec::new();
    let mut accessors = Vec::new();
    let mut primitives = Vec::new();
    let mut materials = Vec::new();
    for (i, quad) in room.0.iter().enumerate() {
        let corners = [
            quad.corner,
            quad.corner + quad.u,
            quad.corner + quad.u + quad.v,
            quad.corner + quad.v,
        ];
        let (low, high) = corners
            .iter()
            .fold((corners[0], corners[0]), |(l, h), c| (l.min(*c), h.max(*c)));
        let at = binary.len();
        corners
            .iter()
            .flat_map(|c| c.to_array())
            .for_each(|f| binary.extend(f.to_le_bytes()));
        views.push(format!(
            r#"{{"buffer":0,"byteOffset":{at},"byteLength":48}}"#
        ));
        accessors.push(format!(
            r#"{{"bufferView":{},"componentType":5126,"count":4,"type":"VEC3","min":{:?},"max":{:?}}}"#,
            2 * i,
            low.to_array(),
            high.to_array()
        ));
        let at = binary.len();
        [0u16, 1, 2, 0, 2, 3]
            .iter()
            .for_each(|k| binary.extend(k.to_le_bytes()));
        views.push(format!(
            r#"{{"buffer":0,"byteOffset":{at},"byteLength":12}}"#
        ));
        accessors.push(format!(
            r#"{{"bufferView":{},"componentType":5123,"count":6,"type":"SCALAR"}}"#,
            2 * i + 1
        ));
        primitives.push(format!(
            r#"{{"attributes":{{"POSITION":{}{}}},"indices":{},"material":{i}}}"#,
            2 * i,
            texture.map_or("".into(), |_| format!(
                r#","TEXCOORD_0":{}"#,
                2 * room.0.len()
            )),
            2 * i + 1
        ));
        let [r, g, b] = quad.color.to_array();
        materials.push(format!(
            r#"{{"doubleSided":true,"pbrMetallicRoughness":{{"baseColorFactor":[{r},{g},{b},1],"metallicFactor":0{}}}}}"#,
            texture.map_or("", |_| r#","baseColorTexture":{"index":0}"#)
        ));
    }
    let mut images = String::new();
    if let Some(texture) = texture {
        let at = binary.len();
        [0.0f32, 0.0, 1.0, 0.0, 1.0, 1.0, 0.0, 1.0]
            .iter()
            .for_each(|f| binary.extend(f.to_le_bytes()));
        views.push(format!(
            r#"{{"buffer":0,"byteOffset":{at},"byteLength":32}}"#
        ));
        accessors.push(format!(
            r#"{{"bufferView":{},"componentType":5126,"count":4,"type":"VEC2"}}"#,
            2 * room.0.len()
        ));
        images = format!(r#","images":[{{"uri":"{texture}"}}],"textures":[{{"source":0}}]"#);
    }
    let json = format!(
        r#"{{"asset":{{"version":"2.0"}},"scene":0,"scenes":[{{"nodes":[0]}}],"nodes":[{{"mesh":0}}],"buffers":[{{"byteLength":{}{uri}}}],"bufferViews":[{}],"accessors":[{}],"materials":[{}],"meshes":[{{"primitives":[{}]}}]{images}}}"#,
        binary.len(),
        views.join(","),
        accessors.join(","),
        materials.join(","),
        primitives.join(",")
    )
    .into_bytes();
    (json, binary)
}

/// Returns the room as binary glTF.
pub fn glb(room: &Room) -> Vec<u8> {
    pack(document(room, "", None))
}

/// Returns the room as binary glTF with an image file on all surfaces.
pub fn textured_glb(room: &Room, texture: &str) -> Vec<u8> {
    pack(document(room, "", Some(texture)))
}

fn pack((mut json, mut binary): (Vec<u8>, Vec<u8>)) -> Vec<u8> {
    json.resize(json.len().next_multiple_of(4), b' ');
    binary.resize(binary.len().next_multiple_of(4), 0);
    let mut out = Vec::new();
    let word = |out: &mut Vec<u8>, v: usize| out.extend((v as u32).to_le_bytes());
    out.extend(b"glTF");
    word(&mut out, 2);
    word(&mut out, 12 + 8 + json.len() + 8 + binary.len());
    word(&mut out, json.len());
    out.extend(b"JSON");
    out.extend(&json);
    word(&mut out, binary.len());
    out.extend(b"BIN\0");
    out.extend(&binary);
    out
}

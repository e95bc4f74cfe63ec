//! Scenes written here, byte by byte, and what becomes of them; and files that are damaged on
//! purpose.

use super::*;
use crate::samples::Random;
use crate::scene::{Geometry, Ray};
use std::f32::consts::PI;

/// Packs JSON and bytes as a GLB.
fn glb(json: &str, binary: &[u8]) -> Vec<u8> {
    let pad = |mut bytes: Vec<u8>, with: u8| {
        bytes.resize(bytes.len().next_multiple_of(4), with);
        bytes
    };
    let (json, binary) = (pad(json.into(), b' '), pad(binary.into(), 0));
    let mut out = b"glTF\x02\0\0\0".to_vec();
    out.extend((28 + json.len() as u32 + binary.len() as u32).to_le_bytes());
    for (kind, chunk) in [(b"JSON", json), (b"BIN\0", binary)] {
        out.extend((chunk.len() as u32).to_le_bytes());
        out.extend(kind);
        out.extend(chunk);
    }
    out
}

/// Bytes with the buffer views and accessors that describe them.
#[derive(Default)]
struct Pack {
    bytes: Vec<u8>,
    views: Vec<String>,
    accessors: Vec<String>,
}

impl Pack {
    fn view(&mut self, bytes: &[u8]) -> usize {
        self.views.push(format!(
            r#"{{"buffer":0,"byteOffset":{},"byteLength":{}}}"#,
            self.bytes.len(),
            bytes.len()
        ));
        self.bytes.extend(bytes);
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
        self.views.len() - 1
    }

    fn accessor(
        &mut self,
        bytes: &[u8],
        count: usize,
        component: u32,
        kind: &str,
        normalized: bool,
    ) -> usize {
        let view = self.view(bytes);
        self.accessors.push(format!(
            r#"{{"bufferView":{view},"count":{count},"componentType":{component},"type":"{kind}","normalized":{normalized}}}"#
        ));
        self.accessors.len() - 1
    }

    fn floats(&mut self, values: &[f32], kind: &str, width: usize) -> usize {
        self.accessor(
            bytemuck::cast_slice(values),
            values.len() / width,
            5126,
            kind,
            false,
        )
    }

    fn file(&self, rest: &str) -> Vec<u8> {
        let json = format!(
            r#"{{"asset":{{"version":"2.0"}},"buffers":[{{"byteLength":{}}}],"bufferViews":[{}],"accessors":[{}],{rest}}}"#,
            self.bytes.len(),
            self.views.join(","),
            self.accessors.join(",")
        );
        glb(&json, &self.bytes)
    }
}

fn load(bytes: &[u8]) -> Result<LoadedScene, SceneError> {
    load_gltf_bytes(bytes, "test.glb", &mut |name| {
        Err(SceneError::Io {
            path: name.into(),
            source: std::io::Error::other("there are no other files"),
        })
    })
}

/// A unit square at z = 0 that faces +z, with texture coordinates (0, 0) at its upper left.
fn square(pack: &mut Pack) -> String {
    let p = pack.floats(&[0., 0., 0., 1., 0., 0., 1., 1., 0., 0., 1., 0.], "VEC3", 3);
    let t = pack.floats(&[0., 1., 1., 1., 1., 0., 0., 0.], "VEC2", 2);
    let i = pack.accessor(&[0, 1, 2, 0, 2, 3], 6, 5121, "SCALAR", false);
    format!(r#""attributes":{{"POSITION":{p},"TEXCOORD_0":{t}}},"indices":{i}"#)
}

fn png(width: u32, height: u32, texels: &[[u8; 4]]) -> Vec<u8> {
    let mut out = std::io::Cursor::new(Vec::new());
    image::RgbaImage::from_raw(width, height, texels.concat())
        .unwrap()
        .write_to(&mut out, image::ImageFormat::Png)
        .unwrap();
    out.into_inner()
}

/// A textured, emitting, masked and mirrored square; a point, a spot and a directional light.
fn rich() -> Vec<u8> {
    let mut pack = Pack::default();
    let primitive = square(&mut pack);
    let image = pack.view(&png(2, 1, &[[255, 0, 0, 255], [188, 188, 188, 0]]));
    pack.file(&format!(
        r#""scene":0,"scenes":[{{"nodes":[0,3,4,5]}}],
        "nodes":[{{"children":[1,2],"translation":[0,0,5]}},{{"mesh":0}},{{"mesh":1,"scale":[-1,1,1]}},
          {{"translation":[1,2,3],"scale":[7,7,7],"name":"bulb","extensions":{{"KHR_lights_punctual":{{"light":0}}}}}},
          {{"rotation":[-0.7071068,0,0,0.7071068],"extensions":{{"KHR_lights_punctual":{{"light":1}}}}}},
          {{"extensions":{{"KHR_lights_punctual":{{"light":2}}}}}}],
        "meshes":[{{"primitives":[{{{primitive},"material":0}}]}},{{"primitives":[{{{primitive},"material":1}}]}}],
        "images":[{{"bufferView":{image},"mimeType":"image/png"}}],
        "samplers":[{{"wrapS":33071,"wrapT":33071}}],"textures":[{{"source":0,"sampler":0}}],
        "materials":[
          {{"alphaMode":"MASK","doubleSided":true,"pbrMetallicRoughness":{{"metallicFactor":0.5,"baseColorTexture":{{"index":0}}}}}},
          {{"emissiveFactor":[1,0.5,0],"emissiveTexture":{{"index":0,"extensions":{{"KHR_texture_transform":{{"offset":[0.5,0]}}}}}},
            "extensions":{{"KHR_materials_emissive_strength":{{"emissiveStrength":4}}}},"pbrMetallicRoughness":{{"metallicFactor":0,"baseColorFactor":[0.1,0.2,0.3,1]}}}}],
        "extensionsUsed":["KHR_lights_punctual","KHR_materials_emissive_strength","KHR_texture_transform"],
        "extensions":{{"KHR_lights_punctual":{{"lights":[{{"type":"point","intensity":3,"color":[1,0.5,0]}},
          {{"type":"spot","intensity":2,"range":9,"spot":{{"innerConeAngle":0.2,"outerConeAngle":0.5}}}},{{"type":"directional","intensity":4}}]}}}}"#
    ))
}

#[test]
fn gltf_nodes_keep_names_and_descendants() {
    let mut pack = Pack::default();
    let primitive = square(&mut pack);
    let bytes = pack.file(&format!(
        r#""scene":0,"scenes":[{{"nodes":[2,0]}}],
        "nodes":[{{"name":"door","children":[1,3],"translation":[0,0,2]}},{{"mesh":1}},{{"mesh":0,"name":"wall"}},{{"name":"handle","mesh":0}}],
        "meshes":[{{"primitives":[{{{primitive}}}]}},{{"primitives":[{{{primitive}}},{{{primitive}}}]}}]"#
    ));
    let mesh = load(&bytes).unwrap().mesh;
    assert_eq!(mesh.len(), 8);
    let (rest, held) = mesh.split_occluders(&["door", "handle", "gate"]);
    assert_eq!(rest.len(), 2);
    let counts: Vec<usize> = held.iter().map(|o| o.triangles.len()).collect();
    assert_eq!(counts, [4, 2, 0]);
    let z = |o: &crate::scene::Occluder| o.triangles[0][0].z;
    assert_eq!([z(&held[0]), z(&held[1])], [2.0, 2.0]);
    assert_eq!(rest.triangle(0).unwrap()[0].z, 0.0);
}

#[test]
fn gltf_materials_textures_and_mirrored_nodes_load() {
    let scene = load(&rich()).unwrap();
    assert_eq!(
        (scene.mesh.len(), scene.problems),
        (4, MeshProblems::default())
    );
    let look = |x: f32, z: f32| {
        let ray = Ray::new(Vec3::new(x, 0.5, z), Vec3::new(0.0, 0.0, -z.signum()));
        scene
            .mesh
            .cast(&ray)
            .map(|hit| scene.mesh.surface(&ray, &hit))
    };
    // The left half is opaque red, half of it metal; the right half is cut out.
    let left = look(0.2, 10.0).unwrap();
    assert!(
        (left.albedo - Vec3::new(0.5, 0.0, 0.0)).length() < 1e-6,
        "{left:?}"
    );
    assert_eq!(
        (left.normal, left.front, left.position),
        (Vec3::Z, true, Vec3::new(0.2, 0.5, 5.0))
    );
    assert_eq!(look(0.9, 10.0), None);
    // The mirrored copy still faces +z. It is single-sided: black and dark from behind.
    let front = look(-0.9, 10.0).unwrap();
    assert!(front.front && front.normal == Vec3::Z);
    assert!((front.albedo - Vec3::new(0.1, 0.2, 0.3)).length() < 1e-6);
    // Its texture is moved by half its width: sRGB 188 is 0.5029, times 4 π.
    assert!(
        (front.emission - 4.0 * PI * 0.502_886 * Vec3::new(1.0, 0.5, 0.0)).length() < 1e-3,
        "{front:?}"
    );
    let back = scene
        .mesh
        .cast(&Ray::new(Vec3::new(-0.5, 0.5, 0.0), Vec3::Z))
        .map(|hit| {
            scene
                .mesh
                .surface(&Ray::new(Vec3::new(-0.5, 0.5, 0.0), Vec3::Z), &hit)
        })
        .unwrap();
    assert_eq!(
        (back.front, back.albedo, back.emission, back.normal),
        (false, Vec3::ZERO, Vec3::ZERO, Vec3::NEG_Z)
    );
    // Occlusion agrees: through the hole, not through the rest, and not through the single-sided
    // back.
    let shadow = |x: f32, from: f32, to: f32| {
        scene
            .mesh
            .occluded(Vec3::new(x, 0.5, from), Vec3::new(x, 0.5, to))
    };
    assert!(shadow(0.2, 9.0, 1.0) && !shadow(0.9, 9.0, 1.0) && shadow(-0.5, 1.0, 9.0));
    assert!(!shadow(0.2, 9.0, 5.5));
    // The runtime's tree has no holes.
    assert_eq!(scene.mesh.bvh().triangles.len(), 4);
}

#[test]
fn gltf_lights_keep_units_and_ignore_node_scale() {
    let scene = load(&rich()).unwrap();
    assert_eq!(scene.light_names, ["bulb", "", ""]);
    assert_eq!(
        scene.lights[0],
        Light::Point {
            position: Vec3::new(1.0, 2.0, 3.0),
            intensity: Vec3::new(3.0, 1.5, 0.0),
            range: f32::INFINITY
        }
    );
    let Light::Spot {
        direction,
        inner,
        outer,
        range,
        ..
    } = scene.lights[1]
    else {
        panic!("{:?}", scene.lights[1]);
    };
    assert!((direction - Vec3::NEG_Y).length() < 1e-6 && (inner, outer, range) == (0.2, 0.5, 9.0));
    assert_eq!(
        scene.lights[2],
        Light::Directional {
            direction: Vec3::NEG_Z,
            irradiance: Vec3::splat(4.0)
        }
    );
}

#[test]
fn gltf_primitive_modes_and_quantization_give_equal_mesh() {
    let mut pack = Pack::default();
    let corners: [[f32; 2]; 4] = [[0., 0.], [1., 0.], [0., 1.], [1., 1.]];
    let flat: Vec<f32> = corners.iter().flat_map(|c| [c[0], c[1], 0.0]).collect();
    let strip = pack.floats(&flat, "VEC3", 3);
    let fan = pack.floats(&[0., 0., 0., 1., 0., 0., 1., 1., 0., 0., 1., 0.], "VEC3", 3);
    // Normalized 16-bit integers, 8 bytes apart.
    let small: Vec<u16> = corners
        .iter()
        .flat_map(|c| [(c[0] * 65535.0) as u16, (c[1] * 65535.0) as u16, 0, 77])
        .collect();
    let view = pack.view(bytemuck::cast_slice(&small));
    pack.views[view] = pack.views[view].replace('}', r#","byteStride":8}"#);
    pack.accessors.push(format!(
        r#"{{"bufferView":{view},"count":4,"componentType":5123,"type":"VEC3","normalized":true}}"#
    ));
    let quantized = pack.accessors.len() - 1;
    for (accessor, mode) in [(strip, 5), (fan, 6), (quantized, 5)] {
        let file = pack.file(&format!(
            r#""extensionsRequired":["KHR_mesh_quantization"],"nodes":[{{"mesh":0}}],
            "meshes":[{{"primitives":[{{"attributes":{{"POSITION":{accessor}}},"mode":{mode}}}]}}]"#
        ));
        let scene = load(&file).unwrap();
        assert_eq!(scene.mesh.len(), 2);
        for x in [0.2, 0.7] {
            let ray = Ray::new(Vec3::new(x, 0.4, 3.0), Vec3::NEG_Z);
            let hit = scene.mesh.cast(&ray).expect("the square is there");
            let surface = scene.mesh.surface(&ray, &hit);
            assert!(
                surface.front && surface.albedo == Vec3::ONE,
                "mode {mode}: {surface:?}"
            );
        }
    }
}

#[test]
fn gltf_sparse_accessors_and_data_uris_load() {
    let json = r#"{"asset":{"version":"2.0"},"nodes":[{"mesh":0}],
      "buffers":[{"uri":"data:;base64,AQIAAAAAgD8AAAAAAAAAAAAAAAAAAIA/AAAAAA==","byteLength":28}],
      "bufferViews":[{"buffer":0,"byteLength":2},{"buffer":0,"byteOffset":4,"byteLength":24}],
      "accessors":[{"count":3,"componentType":5126,"type":"VEC3","sparse":{"count":2,
        "indices":{"bufferView":0,"componentType":5121},"values":{"bufferView":1}}}],
      "meshes":[{"primitives":[{"attributes":{"POSITION":0}}]}]}"#;
    let scene = load(json.as_bytes()).unwrap();
    assert_eq!(scene.mesh.triangle(0), Some([Vec3::ZERO, Vec3::X, Vec3::Y]));
    // As many zeros as an accessor without bytes may ask for are refused before they are allocated.
    let huge = json.replace(r#""count":3"#, r#""count":99999999999"#);
    assert!(matches!(
        load(huge.as_bytes()),
        Err(SceneError::Mesh { .. })
    ));
}

#[test]
fn gltf_errors_name_object_and_location() {
    let mut pack = Pack::default();
    let primitive = square(&mut pack);
    let with = |nodes: &str, mesh: &str| {
        pack.file(&format!(
            r#""nodes":[{nodes}],"meshes":[{{"name":"tile","primitives":[{mesh}]}}]"#
        ))
    };
    let text = |bytes: Vec<u8>| load(&bytes).unwrap_err().to_string();
    assert_eq!(
        text(with(r#"{"mesh":0}"#, r#"{"attributes":{"POSITION":9}}"#)),
        "test.glb: mesh 0 (tile), primitive 0: accessor 9 is not there"
    );
    let own = format!("{{{primitive}}}");
    assert_eq!(
        text(with(r#"{"mesh":4}"#, &own)),
        "test.glb: mesh 4 is not there"
    );
    assert_eq!(
        text(with(r#"{"mesh":0,"children":[1]},{"children":[0]}"#, &own)),
        "test.glb: no usable triangle (0 dropped)",
        "a ring of nodes has no root"
    );
    assert!(text(with(r#"{"children":[1,1]},{"mesh":0}"#, &own)).contains("more than one parent"));
    let mut short = Pack::default();
    short.floats(&[0.0; 9], "VEC3", 3);
    short.accessors[0] = short.accessors[0].replace(r#""count":3"#, r#""count":4"#);
    let file = short
        .file(r#""nodes":[{"mesh":0}],"meshes":[{"primitives":[{"attributes":{"POSITION":0}}]}]"#);
    assert!(text(file).contains("accessor 0: 4 elements of 12 bytes"));
    let external = r#"{"asset":{"version":"2.0"},"buffers":[{"uri":"a%20b.bin","byteLength":1}]}"#;
    let error = load(external.as_bytes()).unwrap_err();
    assert!(
        error.is_io() && error.to_string().starts_with("a b.bin"),
        "{error}"
    );
    assert!(load_gltf("no/such/file.glb").unwrap_err().is_io());
    let required =
        r#"{"asset":{"version":"2.0"},"extensionsRequired":["KHR_draco_mesh_compression"]}"#;
    assert!(
        load(required.as_bytes())
            .unwrap_err()
            .to_string()
            .contains("KHR_draco_mesh_compression")
    );
}

#[test]
fn gltf_published_scene_loads() {
    let path = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../.."))
        .join("tests/data/cornell/cornell.glb");
    let scene = load_gltf(path).unwrap();
    assert_eq!(
        (scene.mesh.len(), scene.problems),
        (30, MeshProblems::default())
    );
    assert!((scene.mesh.bounds().size() - Vec3::new(5.56, 5.488, 5.592)).length() < 0.1);
}

/// No damage to a file makes the reader panic: ten thousand mutations and every truncation.
#[test]
fn gltf_damaged_files_do_not_panic() {
    let cornell = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../.."))
        .join("tests/data/cornell/cornell.glb");
    let mut good = 0;
    for (which, file) in [rich(), std::fs::read(cornell).unwrap()]
        .into_iter()
        .enumerate()
    {
        for end in 0..file.len() {
            assert!(
                load(&file[..end]).is_err(),
                "a file that ends at byte {end} is not a file"
            );
        }
        for k in 0..5000 {
            let mut r = Random::new(17, which as u64, k);
            let mut bytes = file.clone();
            for _ in 0..=r.below(4) {
                let at = r.below(bytes.len());
                match r.below(4) {
                    0 => bytes[at] = r.bits() as u8,
                    1 => bytes[at] ^= 1 << r.below(8),
                    // Digits where digits were, so that the JSON stays whole and its numbers lie.
                    2 if bytes[at].is_ascii_digit() => bytes[at] = b'0' + r.below(10) as u8,
                    2 => bytes[at] = bytes[at].wrapping_add(1),
                    _ => {
                        let from = r.below(bytes.len());
                        let length = r.below(16).min(bytes.len() - at.max(from));
                        bytes.copy_within(from..from + length, at);
                    }
                }
            }
            if let Ok(scene) = load(&bytes) {
                let ray = Ray::new(scene.mesh.bounds().center(), Vec3::NEG_Z);
                if let Some(hit) = scene.mesh.cast(&ray) {
                    let surface = scene.mesh.surface(&ray, &hit);
                    assert!(
                        surface.normal.is_finite()
                            && surface.albedo.is_finite()
                            && surface.emission.is_finite()
                    );
                }
                good += 1;
            }
        }
    }
    assert!(
        (500..9500).contains(&good),
        "{good} of 10,000 were still readable: the mutations test nothing"
    );
}

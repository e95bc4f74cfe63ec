//! Tests of reading, of rejected files with positions, and of damaged bytes.

use super::*;
use crate::samples::Random;
use proptest::prelude::*;

fn written(encoding: PlyEncoding) -> Vec<u8> {
    let positions: Vec<Vec3> = (0..40)
        .map(|i| Vec3::new(i as f32, 0.1, -2.5e-3 * i as f32))
        .collect();
    let normals = vec![Vec3::new(0.0, 0.6, -0.8); 40];
    let albedo: Vec<Vec3> = (0..40).map(|i| Vec3::splat(i as f32 / 40.0)).collect();
    let mut out = Vec::new();
    write_ply(&mut out, encoding, &positions, &normals, &albedo).unwrap();
    out
}

#[test]
fn ply_written_cloud_round_trips() {
    let text = parse_ply(&written(PlyEncoding::Ascii)).unwrap();
    assert_eq!((text.positions.len(), text.faces), (40, 0));
    assert_eq!(text.positions[7], Vec3::new(7.0, 0.1, -2.5e-3 * 7.0));
    assert_eq!(text.normals.as_ref().unwrap()[3], Vec3::new(0.0, 0.6, -0.8));
    assert_eq!(text.albedo.as_ref().unwrap()[10], Vec3::splat(0.25));
    for encoding in [PlyEncoding::LittleEndian, PlyEncoding::BigEndian] {
        assert_eq!(parse_ply(&written(encoding)).unwrap(), text);
    }
    let mut bare = Vec::new();
    write_ply(&mut bare, PlyEncoding::Ascii, &text.positions, &[], &[]).unwrap();
    let bare = parse_ply(&bare).unwrap();
    assert_eq!(
        (bare.positions, bare.normals, bare.albedo),
        (text.positions, None, None)
    );
}

#[test]
fn ply_files_of_other_programs_load() {
    // CR LF, a comment that is not UTF-8, elements before and after, lists, unknown properties,
    // 8-bit colors, doubles.
    let text = b"ply\r\nformat ascii 1.0\r\ncomment caf\xe9\r\nobj_info 7\r\nelement camera 1\r\nproperty list uchar float k\r\nproperty int id\r\n\
        element vertex 2\r\nproperty double x\r\nproperty double y\r\nproperty double z\r\nproperty uchar red\r\nproperty uchar green\r\n\
        property uchar blue\r\nproperty uchar alpha\r\nproperty list uchar int seen\r\nelement face 1\r\nproperty list uchar int vertex_indices\r\n\
        end_header\r\n3 0.5 1 2 -9\r\n1 2 3 255 0 188 255 0\r\n\r\n-1e-3 +2 .5 0 0 0 0 2 4 5\r\n3 0 1 0\r\n";
    let read = parse_ply(text).unwrap();
    assert_eq!(
        read.positions,
        [Vec3::new(1.0, 2.0, 3.0), Vec3::new(-1e-3, 2.0, 0.5)]
    );
    let color = read.albedo.unwrap()[0];
    assert_eq!((color.x, color.y, read.faces), (1.0, 0.0, 1));
    assert!((color.z - 0.5029).abs() < 1e-4, "sRGB is decoded: {color}");
    assert_eq!(read.normals, None);
    let mut binary = b"ply\nformat binary_big_endian 1.0\nelement face 2\nproperty list ushort int8 v\nelement vertex 1\nproperty short z\n\
        property list int double l\nproperty uint x\nproperty char y\nend_header\n"
        .to_vec();
    binary.extend([0, 2, 9, 9, 0, 0]);
    binary.extend([
        0xff, 0xfe, 0, 0, 0, 1, 1, 2, 3, 4, 5, 6, 7, 8, 0, 1, 0, 0, 0x80,
    ]);
    let read = parse_ply(&binary).unwrap();
    assert_eq!(read.positions, [Vec3::new(65536.0, -128.0, -2.0)]);
    assert_eq!(read.faces, 2);
}

#[test]
fn ply_errors_name_location() {
    let xyz = "property float x\nproperty float y\nproperty float z\n";
    let message = |text: &str| parse_ply(text.as_bytes()).unwrap_err().to_string();
    let ascii = |rest: &str| message(&format!("ply\nformat ascii 1.0\n{rest}"));
    for (found, expected) in [
        (message(""), "header line 1: the header has no end_header"),
        (
            message("plyx\n"),
            "header line 1: it does not begin with `ply`",
        ),
        (
            message("ply\nend_header\n"),
            "header line 2: the header has no format",
        ),
        (
            message("ply\nformat ebcdic 1.0\n"),
            "header line 2: format `ebcdic` is not known",
        ),
        (
            message("ply\nformat ascii 2.0\n"),
            "header line 2: version `2.0`, only 1.0 can be read",
        ),
        (
            ascii("elephant\n"),
            "header line 3: `elephant` is not a header line",
        ),
        (
            ascii("property float x\n"),
            "header line 3: a property before any element",
        ),
        (
            ascii("element vertex -1\n"),
            "header line 3: `-1` is not a count",
        ),
        (
            ascii("element a 0\nelement a 0\n"),
            "header line 4: a second element `a`",
        ),
        (
            ascii("element a 0\nproperty int x\nproperty int x\n"),
            "header line 5: a second property `x`",
        ),
        (
            ascii("element a 0\nproperty list float int x\n"),
            "header line 4: the length of a list is not an integer type",
        ),
        (
            ascii("element a 0\nproperty half x\n"),
            "header line 4: type `half` is not known",
        ),
        (
            ascii("element a 0\nend_header\n"),
            "header line 4: there is no element `vertex`",
        ),
        (
            ascii("element vertex 0\nproperty float x\nend_header\n"),
            "header line 3: `vertex` has no x, y and z",
        ),
        (
            ascii("element vertex 9000000000000000000\nend_header\n"),
            "header line 3: element `vertex` has no properties",
        ),
        (
            ascii(&format!(
                "element vertex 9000000000000000000\n{xyz}end_header\n1 2 3\n"
            )),
            "header line 3: 9000000000000000000 of element `vertex` do not fit into the 6 bytes behind the header",
        ),
        (
            ascii(&format!(
                "element vertex 1\n{xyz}property int red\nproperty int green\nproperty int blue\nend_header\n1 2 3 4 5 6\n"
            )),
            "header line 3: `red` is I32: colors are uchar (sRGB), float or double (linear)",
        ),
        (
            ascii(&format!(
                "element vertex 2\n{xyz}end_header\n1 2 3\n4 5\n6\n"
            )),
            "line 9: `z` is missing",
        ),
        (
            ascii(&format!("element vertex 1\n{xyz}end_header\n1 2 3 4\n")),
            "line 8: `4` is one value more than the header declares",
        ),
        (
            ascii(&format!("element vertex 1\n{xyz}end_header\n1 two 3\n")),
            "line 8: `y` is `two`, not F32",
        ),
        (
            ascii(&format!(
                "element vertex 2\n{xyz}end_header\n1 2 3\n\n\n\n\n\n\n"
            )),
            "line 15: the file ends at `vertex` 1 of 2",
        ),
    ] {
        assert_eq!(found, expected);
    }
    let whole = written(PlyEncoding::LittleEndian);
    let cut = parse_ply(&whole[..whole.len() - 1])
        .unwrap_err()
        .to_string();
    assert!(cut.contains("40 of element `vertex` do not fit"), "{cut}");
    let list = b"ply\nformat binary_little_endian 1.0\nelement vertex 1\nproperty list uint double l\nproperty char x\nproperty char y\n\
        property char z\nend_header\n\xff\xff\xff\xff123456789";
    let found = parse_ply(list).unwrap_err().to_string();
    assert!(
        found.starts_with("byte ") && found.contains("4294967295 values"),
        "{found}"
    );
    let many =
        format!("ply\nformat binary_little_endian 1.0\nelement vertex 9000000\n{xyz}end_header\n");
    let mut many = many.into_bytes();
    many.resize(many.len() + 12 * 9_000_000, 0);
    assert!(matches!(
        parse_ply(&many),
        Err(PlyError::TooMany {
            count: 9_000_000,
            ..
        })
    ));
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 4000, failure_persistence: None, ..ProptestConfig::default() })]

    /// Flipped, removed, doubled and spliced bytes give an error or points. The number of points is
    /// at most the number of bytes.
    #[test]
    fn ply_damaged_files_do_not_panic(seed: u64, edits in 1usize..6, which in 0usize..3) {
        let mut bytes = written([PlyEncoding::Ascii, PlyEncoding::LittleEndian, PlyEncoding::BigEndian][which]);
        let mut random = Random::new(seed, 0, 0);
        for _ in 0..edits {
            let at = random.below(bytes.len().max(1));
            // Half of the changes are in the header.
            let at = if random.unit() < 0.5 { at % 260 } else { at };
            match random.below(5) {
                0 => if let Some(b) = bytes.get_mut(at) { *b ^= 1 << random.below(8) },
                1 => if let Some(b) = bytes.get_mut(at) { *b = random.bits() as u8 },
                2 => bytes.truncate(at),
                3 => { let part = bytes[at.min(bytes.len())..].to_vec(); bytes.extend(part); }
                _ => if at < bytes.len() { bytes.insert(at, b"0123456789 \n-e"[random.below(14)]) },
            }
        }
        if let Ok(points) = parse_ply(&bytes) {
            prop_assert!(points.positions.len() <= bytes.len());
            prop_assert!(points.normals.is_none_or(|n| n.len() == points.positions.len()));
            prop_assert!(points.albedo.is_none_or(|n| n.len() == points.positions.len()));
        }
    }
}

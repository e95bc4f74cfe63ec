//! Container of a glTF file: GLB chunks, data URIs, percent-encoded file names. All lengths are
//! validated.

/// Returns the JSON and the binary chunk of a GLB. For a plain `.gltf` returns all bytes as JSON.
pub(super) fn split(bytes: &[u8]) -> Result<(&[u8], Option<&[u8]>), String> {
    if !bytes.starts_with(b"glTF") {
        return Ok((bytes, None));
    }
    let word = |at: usize| {
        let four = bytes.get(at..at + 4)?;
        Some(u32::from_le_bytes(four.try_into().ok()?))
    };
    let version = word(4).ok_or("the header ends early")?;
    if version != 2 {
        return Err(format!("GLB version {version}, only 2 can be read"));
    }
    let length = word(8).ok_or("the header ends early")? as usize;
    if length > bytes.len() {
        return Err(format!(
            "the header declares {length} bytes, the file has {}",
            bytes.len()
        ));
    }
    let (mut json, mut binary) = (None, None);
    let mut at = 12usize;
    while at + 8 <= length {
        let size = word(at).unwrap_or(0) as usize;
        let kind = &bytes[at + 4..at + 8];
        let chunk = bytes[at + 8..length].get(..size).ok_or_else(|| {
            format!(
                "the chunk at byte {at} declares {size} bytes, {} are left",
                length - at - 8
            )
        })?;
        match kind {
            b"JSON" if json.is_none() => json = Some(chunk),
            b"BIN\0" if binary.is_none() => binary = Some(chunk),
            // The format requires that other chunks are ignored.
            _ => {}
        }
        at += 8 + size;
    }
    Ok((json.ok_or("there is no JSON chunk")?, binary))
}

/// Returns the bytes of a `data:` URI. `None` if `uri` has another scheme.
pub(super) fn data_uri(uri: &str) -> Option<Result<Vec<u8>, String>> {
    let rest = uri.strip_prefix("data:")?;
    let Some((head, body)) = rest.split_once(',') else {
        return Some(Err("a data URI has no comma".into()));
    };
    Some(if head.ends_with(";base64") {
        base64(body)
    } else {
        Ok(percent_bytes(body))
    })
}

/// Converts a relative URI to a file name by decoding `%20` and similar codes.
pub(super) fn file_name(uri: &str) -> String {
    String::from_utf8_lossy(&percent_bytes(uri)).into_owned()
}

fn percent_bytes(text: &str) -> Vec<u8> {
    let bytes = text.as_bytes();
    let digit = |i: usize| bytes.get(i).and_then(|&b| char::from(b).to_digit(16));
    let mut out = Vec::with_capacity(bytes.len());
    let mut i = 0;
    while i < bytes.len() {
        match (bytes[i], digit(i + 1), digit(i + 2)) {
            (b'%', Some(high), Some(low)) => {
                out.push((16 * high + low) as u8);
                i += 3;
            }
            (b, ..) => {
                out.push(b);
                i += 1;
            }
        }
    }
    out
}

fn base64(text: &str) -> Result<Vec<u8>, String> {
    let mut out = Vec::with_capacity(text.len() / 4 * 3);
    let (mut bits, mut held) = (0u32, 0u32);
    for (at, b) in text.bytes().enumerate() {
        let six = match b {
            b'A'..=b'Z' => b - b'A',
            b'a'..=b'z' => b - b'a' + 26,
            b'0'..=b'9' => b - b'0' + 52,
            b'+' | b'-' => 62,
            b'/' | b'_' => 63,
            b'=' | b'\n' | b'\r' | b' ' => continue,
            _ => return Err(format!("byte {at} of a base64 data URI is not base64")),
        };
        bits = (bits << 6) | u32::from(six);
        held += 6;
        if held >= 8 {
            held -= 8;
            out.push((bits >> held) as u8);
            bits &= (1 << held) - 1;
        }
    }
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn data_uris_decode() {
        assert_eq!(
            data_uri("data:a/b;base64,aGVsbG8=").unwrap().unwrap(),
            b"hello"
        );
        assert_eq!(
            data_uri("data:a/b;base64,aGVsbG8h").unwrap().unwrap(),
            b"hello!"
        );
        assert_eq!(data_uri("data:,a%20b").unwrap().unwrap(), b"a b");
        assert!(data_uri("data:a/b;base64,a?").unwrap().is_err());
        assert!(data_uri("file.bin").is_none());
        assert_eq!(file_name("my%20level%2"), "my level%2");
    }

    #[test]
    fn glb_wrong_lengths_are_rejected() {
        let mut glb = b"glTF\x02\0\0\0\x18\0\0\0\x04\0\0\0JSON{}  ".to_vec();
        assert_eq!(split(&glb).unwrap(), (&b"{}  "[..], None));
        glb[12] = 5;
        assert!(split(&glb).is_err());
        glb[12] = 4;
        glb[8] = 25;
        assert!(split(&glb).is_err());
        glb[8] = 0;
        assert!(split(&glb).is_err(), "a length below the header's own");
        for end in 0..24 {
            assert!(split(&glb[..end]).is_err() || end < 4);
        }
    }
}

//! Names of the files that a glTF references.

use super::container::file_name;

/// Returns the external files of a glTF: buffers and images that are neither embedded nor data
/// URIs. Empty if the bytes are not a glTF. The loader then reports a better error.
#[must_use]
pub fn external_files(bytes: &[u8]) -> Vec<String> {
    let Ok(document) = ::gltf::Gltf::from_slice_without_validation(bytes) else {
        return Vec::new();
    };
    let json = document.document.into_json();
    let buffers = json.buffers.into_iter().filter_map(|b| b.uri);
    let images = json.images.into_iter().filter_map(|i| i.uri);
    buffers
        .chain(images)
        .filter(|uri| !uri.starts_with("data:"))
        .map(|uri| file_name(&uri))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn external_files_of_scene_are_listed() {
        let text = br#"{"asset":{"version":"2.0"},"buffers":[{"byteLength":1,"uri":"a%20b.bin"},{"byteLength":0,"uri":"data:,"}],
            "images":[{"uri":"tex/wall.png"},{"bufferView":0,"mimeType":"image/png"}]}"#;
        assert_eq!(external_files(text), ["a b.bin", "tex/wall.png"]);
        assert_eq!(external_files(b"no glTF"), [] as [&str; 0]);
    }

    #[test]
    fn file_name_partial_escape_stays() {
        for (uri, name) in [
            ("100%.png", "100%.png"),
            ("%C3%BC", "\u{fc}"),
            ("%FF", "\u{fffd}"),
            ("a%2", "a%2"),
            ("", ""),
        ] {
            assert_eq!(file_name(uri), name);
        }
    }
}

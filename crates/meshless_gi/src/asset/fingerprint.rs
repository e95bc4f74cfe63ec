//! Digest of all inputs of a bake, for the detection of stale bakes.

/// Computes the BLAKE3 digest of `parts`, as hex. The length of each part is included, so that
/// boundaries between parts matter.
#[must_use]
pub fn fingerprint(parts: &[&[u8]]) -> String {
    let mut hasher = blake3::Hasher::new();
    for part in parts {
        hasher.update(&(part.len() as u64).to_le_bytes());
        hasher.update(part);
    }
    hasher.finalize().to_hex().to_string()
}

#[cfg(test)]
mod tests {
    use super::fingerprint;

    #[test]
    fn fingerprint_any_changed_input_or_boundary_differs() {
        let a = fingerprint(&[b"ab", b"c"]);
        assert_eq!(a.len(), 64);
        assert_eq!(a, fingerprint(&[b"ab", b"c"]));
        assert_ne!(a, fingerprint(&[b"a", b"bc"]));
        assert_ne!(a, fingerprint(&[b"ab", b"d"]));
        assert_ne!(a, fingerprint(&[b"ab", b"c", b""]));
    }
}

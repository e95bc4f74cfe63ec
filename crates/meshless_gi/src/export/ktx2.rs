//! KTX 2.0 file with one three-dimensional texture of half floats. It follows sections 3 to 5 of
//! the KTX File Format Specification 2.0 (Khronos): header, index, level index, data format
//! descriptor, key and value, mip level.

use half::f16;

/// First bytes of every KTX 2.0 file.
const IDENTIFIER: [u8; 12] = *b"\xabKTX 20\xbb\r\n\x1a\n";
/// `VK_FORMAT_R16G16B16A16_SFLOAT`.
const FORMAT: u32 = 97;
/// Bytes of header and index.
const HEADER: usize = 80;
/// Bytes of the index of one mip level.
const LEVEL_INDEX: usize = 24;
/// Bytes of a basic descriptor block with four samples, and of the total size before it.
const DESCRIPTOR: usize = 4 + 24 + 4 * 16;
/// Bytes of a texel, and the alignment of a mip level.
const TEXEL: usize = 8;

/// Returns the bytes of a file of `size` texels along x, y and z. x varies fastest.
pub(super) fn write(size: [u32; 3], texels: &[[f16; 4]]) -> Vec<u8> {
    let writer = key_and_value(concat!(
        "KTXwriter\0bevy_meshless_gi ",
        env!("CARGO_PKG_VERSION"),
        "\0"
    ));
    let descriptor_at = HEADER + LEVEL_INDEX;
    let writer_at = descriptor_at + DESCRIPTOR;
    let level_at = (writer_at + writer.len()).next_multiple_of(TEXEL);
    let level = TEXEL * texels.len();

    let mut out = Vec::with_capacity(level_at + level);
    out.extend(IDENTIFIER);
    let mut word = |value: usize| out.extend((value as u32).to_le_bytes());
    word(FORMAT as usize);
    // Bytes of a component.
    word(2);
    size.iter().for_each(|&edge| word(edge as usize));
    // No array, one face, one mip level, no supercompression.
    [0, 1, 1, 0].into_iter().for_each(&mut word);
    word(descriptor_at);
    word(DESCRIPTOR);
    word(writer_at);
    word(writer.len());
    let mut long = |value: usize| out.extend((value as u64).to_le_bytes());
    // No data of a supercompression. Then the mip level: offset, bytes, bytes without compression.
    [0, 0, level_at, level, level]
        .into_iter()
        .for_each(&mut long);
    out.extend(descriptor());
    out.extend(writer);
    out.resize(level_at, 0);
    let components = texels.iter().flatten();
    out.extend(components.flat_map(|component| component.to_le_bytes()));
    out
}

/// Returns the data format descriptor of four signed half floats, linear, with the primaries of
/// BT.709. Section 5 of the Khronos Data Format Specification 1.3.
fn descriptor() -> Vec<u8> {
    let mut out = Vec::with_capacity(DESCRIPTOR);
    let mut words = |words: &[u32]| out.extend(words.iter().flat_map(|word| word.to_le_bytes()));
    let block = DESCRIPTOR as u32 - 4;
    // Basic descriptor of Khronos, version 2. Model RGBSDA (1), primaries BT.709 (1), linear
    // transfer (1). Texel blocks of one texel. Bytes of a texel.
    words(&[DESCRIPTOR as u32, 0, 2 | (block << 16), 0x01_01_01, 0, 8, 0]);
    for (k, channel) in [0, 1, 2, 15u32].into_iter().enumerate() {
        // First bit of the sample, its bits minus one, its channel with the flags float and signed.
        // No position offset. Range −1 to 1.
        let sample = (16 * k as u32) | (15 << 16) | ((0xc0 | channel) << 24);
        words(&[sample, 0, (-1.0f32).to_bits(), 1.0f32.to_bits()]);
    }
    out
}

/// Returns a key and its value, each terminated by a zero, aligned to four bytes.
fn key_and_value(text: &str) -> Vec<u8> {
    let mut out = (text.len() as u32).to_le_bytes().to_vec();
    out.extend(text.as_bytes());
    out.resize(out.len().next_multiple_of(4), 0);
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ktx2_level_data_lies_at_indexed_offsets() {
        let texels: Vec<[f16; 4]> = (0..2 * 4 * 3)
            .map(|i| [i as f32, 0.5, -1.0, 2.0].map(f16::from_f32))
            .collect();
        let file = write([2, 4, 3], &texels);
        let word = |at: usize| u32::from_le_bytes(file[at..at + 4].try_into().unwrap()) as usize;
        let long = |at: usize| u64::from_le_bytes(file[at..at + 8].try_into().unwrap()) as usize;
        assert_eq!(file[..12], IDENTIFIER);
        let header: Vec<usize> = (12..48).step_by(4).map(word).collect();
        assert_eq!(header, [97, 2, 2, 4, 3, 0, 1, 1, 0]);
        let (descriptor, bytes) = (word(48), word(52));
        assert_eq!((descriptor, bytes, word(descriptor)), (104, 92, 92));
        let (values, bytes) = (word(56), word(60));
        let value = &file[values + 4..values + 4 + word(values)];
        assert!(value.starts_with(b"KTXwriter\0") && value.ends_with(b"\0"));
        assert!(values + bytes <= long(80) && long(80).is_multiple_of(8));
        assert_eq!([64, 72, 88, 96].map(long), [0, 0, 192, 192]);
        assert_eq!(long(80) + 192, file.len());
        let last = &file[file.len() - 8..];
        assert_eq!(
            last,
            [23.0, 0.5, -1.0, 2.0]
                .map(|v| f16::from_f32(v).to_le_bytes())
                .concat()
        );
    }
}

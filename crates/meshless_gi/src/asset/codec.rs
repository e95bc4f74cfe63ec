//! Conversion of arrays of plain structs to bytes that compress well, and back.
//!
//! Every stored struct consists of 32-bit words. A [`Field`] is one word of it, or one half of a
//! word. In columns, the values of all items are written field after field. A field is written as
//! byte planes: first all lowest bytes, then all next ones. Signs and exponents, which hardly vary,
//! are then adjacent. Columns suit values that differ in every item: links and weights. Values that
//! repeat as a whole compress better item after item: normals, colors and corners of triangles.
//! Ascending numbers are written as differences.

use bytemuck::Pod;

/// Creates fields of all 32 bits of these words.
pub(super) const fn words<const N: usize>(words: [usize; N]) -> [Field; N] {
    let mut fields = [Field::word(0); N];
    let mut i = 0;
    while i < N {
        fields[i] = Field::word(words[i]);
        i += 1;
    }
    fields
}

/// Part of a word that a field occupies.
#[derive(Clone, Copy, PartialEq, Eq)]
enum WordPart {
    Whole,
    Low,
    High,
}

/// One column.
#[derive(Clone, Copy)]
pub(super) struct Field {
    word: usize,
    part: WordPart,
    delta: bool,
}

impl Field {
    /// Creates a field of all 32 bits of a word.
    pub const fn word(word: usize) -> Self {
        Self {
            word,
            part: WordPart::Whole,
            delta: false,
        }
    }

    /// Creates a field of the low 16 bits of a word.
    pub const fn low(word: usize) -> Self {
        Self {
            word,
            part: WordPart::Low,
            delta: false,
        }
    }

    /// Creates a field of the high 16 bits of a word.
    pub const fn high(word: usize) -> Self {
        Self {
            word,
            part: WordPart::High,
            delta: false,
        }
    }

    /// Returns the field, written as the difference to the item before with the sign in the lowest
    /// bit.
    pub const fn delta(self) -> Self {
        Self {
            delta: true,
            ..self
        }
    }

    /// Returns the bytes of one value.
    pub const fn bytes(self) -> usize {
        match self.part {
            WordPart::Whole => 4,
            WordPart::Low | WordPart::High => 2,
        }
    }

    fn get(self, word: u32) -> u32 {
        match self.part {
            WordPart::Whole => word,
            WordPart::Low => word & 0xffff,
            WordPart::High => word >> 16,
        }
    }

    fn put(self, word: &mut u32, value: u32) {
        match self.part {
            WordPart::Whole => *word = value,
            WordPart::Low => *word = *word & 0xffff_0000 | value,
            WordPart::High => *word = *word & 0xffff | value << 16,
        }
    }

    /// Computes the coded difference of two values, small for small steps in either direction.
    fn step(self, from: u32, to: u32) -> u32 {
        if self.part == WordPart::Whole {
            let d = to.wrapping_sub(from) as i32;
            ((d << 1) ^ (d >> 31)) as u32
        } else {
            let d = (to as u16).wrapping_sub(from as u16) as i16;
            u32::from(((d << 1) ^ (d >> 15)) as u16)
        }
    }

    /// Inverts [`Self::step`].
    fn undo_step(self, from: u32, step: u32) -> u32 {
        let d = (step >> 1) ^ (step & 1).wrapping_neg();
        if self.part == WordPart::Whole {
            from.wrapping_add(d)
        } else {
            u32::from((from as u16).wrapping_add(d as u16))
        }
    }
}

/// Stored fields of a struct, in their order.
#[derive(Clone, Copy)]
pub(super) struct Layout {
    fields: &'static [Field],
    columns: bool,
}

impl Layout {
    /// Creates a layout that stores field after field, in byte planes.
    pub const fn columns(fields: &'static [Field]) -> Self {
        Self {
            fields,
            columns: true,
        }
    }

    /// Creates a layout that stores item after item.
    pub const fn rows(fields: &'static [Field]) -> Self {
        Self {
            fields,
            columns: false,
        }
    }

    /// Returns the stored bytes of one item.
    pub const fn item_bytes(self) -> usize {
        let mut sum = 0;
        let mut i = 0;
        while i < self.fields.len() {
            sum += self.fields[i].bytes();
            i += 1;
        }
        sum
    }

    /// Converts items to bytes.
    pub fn encode<T: Pod>(self, items: &[T]) -> Vec<u8> {
        if self.columns {
            return to_columns(items, self.fields);
        }
        let words: &[u32] = bytemuck::cast_slice(items);
        let mut out = Vec::with_capacity(items.len() * self.item_bytes());
        let mut before = [0; MAX_FIELDS];
        for item in words.chunks_exact(size_of::<T>() / 4) {
            for (field, before) in self.fields.iter().zip(&mut before) {
                let value = field.get(item[field.word]);
                let coded = if field.delta {
                    field.step(*before, value)
                } else {
                    value
                };
                out.extend_from_slice(&coded.to_le_bytes()[..field.bytes()]);
                *before = value;
            }
        }
        out
    }

    /// Converts bytes to items. `raw` must be `count` times [`item_bytes`](Self::item_bytes) long.
    /// Words without a field are zero.
    pub fn decode<T: Pod>(self, raw: &[u8], count: usize) -> Vec<T> {
        debug_assert_eq!(raw.len(), count * self.item_bytes());
        if self.columns {
            return from_columns(raw, count, self.fields);
        }
        let mut items = vec![T::zeroed(); count];
        let words: &mut [u32] = bytemuck::cast_slice_mut(&mut items);
        let mut rest = raw;
        let mut before = [0; MAX_FIELDS];
        for item in words.chunks_exact_mut(size_of::<T>() / 4) {
            for (field, before) in self.fields.iter().zip(&mut before) {
                let (bytes, behind) = rest.split_at(field.bytes());
                rest = behind;
                let mut value = [0; 4];
                value[..bytes.len()].copy_from_slice(bytes);
                let mut value = u32::from_le_bytes(value);
                if field.delta {
                    value = field.undo_step(*before, value);
                    *before = value;
                }
                field.put(&mut item[field.word], value);
            }
        }
        items
    }
}

/// Largest number of fields of a struct.
const MAX_FIELDS: usize = 12;

/// Converts items to columns.
fn to_columns<T: Pod>(items: &[T], fields: &[Field]) -> Vec<u8> {
    let stride = size_of::<T>() / 4;
    let words: &[u32] = bytemuck::cast_slice(items);
    let mut out = Vec::with_capacity(size_of_val(items));
    let mut column = Vec::with_capacity(items.len());
    for field in fields {
        column.clear();
        let mut before = 0;
        for item in words.chunks_exact(stride) {
            let value = field.get(item[field.word]);
            column.push(if field.delta {
                field.step(before, value)
            } else {
                value
            });
            before = value;
        }
        for byte in 0..field.bytes() {
            out.extend(column.iter().map(|v| (v >> (8 * byte)) as u8));
        }
    }
    out
}

/// Converts columns to items.
fn from_columns<T: Pod>(raw: &[u8], count: usize, fields: &[Field]) -> Vec<T> {
    let stride = size_of::<T>() / 4;
    let mut items = vec![T::zeroed(); count];
    let words: &mut [u32] = bytemuck::cast_slice_mut(&mut items);
    let mut rest = raw;
    for field in fields {
        let (column, behind) = rest.split_at(count * field.bytes());
        rest = behind;
        let mut before = 0;
        for (i, item) in words.chunks_exact_mut(stride).enumerate() {
            let mut value = 0;
            for byte in 0..field.bytes() {
                value |= u32::from(column[byte * count + i]) << (8 * byte);
            }
            if field.delta {
                value = field.undo_step(before, value);
                before = value;
            }
            field.put(&mut item[field.word], value);
        }
    }
    items
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn encoded_items_round_trip() {
        let items: Vec<[u32; 2]> = (0..1000u32)
            .map(|i| {
                let h = i.wrapping_mul(0x9e37_79b9);
                [h, h.rotate_left(13) ^ i]
            })
            .chain([[0, u32::MAX], [u32::MAX, 0], [0x8000_0000, 0x7fff_8000]])
            .collect();
        const FIELDS: [&[Field]; 3] = [
            &[Field::word(0), Field::word(1)],
            &[
                Field::word(1).delta(),
                Field::low(0),
                Field::high(0).delta(),
            ],
            &[
                Field::low(0).delta(),
                Field::high(0),
                Field::word(1).delta(),
            ],
        ];
        for fields in FIELDS {
            for layout in [Layout::columns(fields), Layout::rows(fields)] {
                let raw = layout.encode(&items);
                assert_eq!(raw.len(), items.len() * layout.item_bytes());
                assert_eq!(layout.decode::<[u32; 2]>(&raw, items.len()), items);
                assert!(layout.encode::<[u32; 2]>(&[]).is_empty());
            }
        }
    }

    #[test]
    fn delta_of_small_steps_encodes_to_small_numbers() {
        let f = Field::word(0);
        for (from, to, step) in [(5, 6, 2), (6, 5, 1), (7, 7, 0)] {
            assert_eq!(f.step(from, to), step);
            assert_eq!(f.undo_step(from, step), to);
        }
        let h = Field::high(0);
        assert_eq!(h.step(0xffff, 0), 2);
        assert_eq!(h.undo_step(0xffff, 2), 0);
    }
}

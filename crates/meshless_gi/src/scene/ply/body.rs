//! Body of a `.ply` file: consecutive elements, as text or as binary values of either byte order.
//!
//! Both readers pass the scalars of each element to a callback as `f64`, which represents every
//! type exactly. Lists are skipped. Their length is checked against the remaining bytes.

use super::PlyError;
use super::header::{Element, Encoding, Header, Property, Scalar, line_at, quote};

/// Reads all elements in order. Calls `each` with the scalars of every element named
/// `element_name`: one value per property, 0 for lists.
pub(super) fn read(
    bytes: &[u8],
    header: &Header,
    element_name: &str,
    mut each: impl FnMut(&[f64]),
) -> Result<(), PlyError> {
    let mut values = Vec::new();
    match header.encoding {
        Encoding::Ascii => {
            let mut lines = Lines {
                bytes,
                at: header.body,
                line: header.lines,
            };
            for element in &header.elements {
                for i in 0..element.count {
                    lines.element(element, i, &mut values)?;
                    if element.name == element_name {
                        each(&values);
                    }
                }
            }
        }
        encoding => {
            let mut numbers = Numbers {
                bytes,
                at: header.body,
                big: encoding == Encoding::BigEndian,
            };
            for element in &header.elements {
                let taken = element.name == element_name;
                if !taken && element.properties.iter().all(|p| p.length.is_none()) {
                    numbers.skip(element)?;
                    continue;
                }
                for i in 0..element.count {
                    numbers.element(element, i, &mut values)?;
                    if taken {
                        each(&values);
                    }
                }
            }
        }
    }
    Ok(())
}

/// Text reader: one element per line.
struct Lines<'a> {
    bytes: &'a [u8],
    at: usize,
    /// Number of lines read.
    line: usize,
}

impl Lines<'_> {
    fn element(
        &mut self,
        element: &Element,
        index: u64,
        out: &mut Vec<f64>,
    ) -> Result<(), PlyError> {
        let text = loop {
            let Some((line, next)) = line_at(self.bytes, self.at) else {
                return Err(PlyError::Text {
                    line: self.line + 1,
                    what: format!(
                        "the file ends at {} {index} of {}",
                        quote(&element.name),
                        element.count
                    ),
                });
            };
            self.at = next;
            self.line += 1;
            if !line.trim_ascii().is_empty() {
                break line;
            }
        };
        let wrong = |what: String| PlyError::Text {
            line: self.line,
            what,
        };
        let mut words = text
            .split(u8::is_ascii_whitespace)
            .filter(|word| !word.is_empty());
        let mut next = |property: &Property, scalar: Scalar| -> Result<f64, PlyError> {
            let word = words
                .next()
                .ok_or_else(|| wrong(format!("{} is missing", quote(&property.name))))?;
            let word = String::from_utf8_lossy(word);
            number(&word, scalar).ok_or_else(|| {
                wrong(format!(
                    "{} is {}, not {scalar:?}",
                    quote(&property.name),
                    quote(&word)
                ))
            })
        };
        out.clear();
        for property in &element.properties {
            match property.length {
                None => out.push(next(property, property.scalar)?),
                Some(length) => {
                    // Bounded by the line: each value takes one word.
                    for _ in 0..list_length(next(property, length)?, property).map_err(wrong)? {
                        next(property, property.scalar)?;
                    }
                    out.push(0.0);
                }
            }
        }
        match words.next() {
            None => Ok(()),
            Some(word) => Err(wrong(format!(
                "{} is one value more than the header declares",
                quote(&String::from_utf8_lossy(word))
            ))),
        }
    }
}

/// Parses a value of this type. Integers must be in the range of the type.
fn number(word: &str, scalar: Scalar) -> Option<f64> {
    let within = |low: i64, high: i64| {
        let value = word.parse::<i64>().ok()?;
        (low..=high).contains(&value).then_some(value as f64)
    };
    match scalar {
        Scalar::I8 => within(-0x80, 0x7f),
        Scalar::U8 => within(0, 0xff),
        Scalar::I16 => within(-0x8000, 0x7fff),
        Scalar::U16 => within(0, 0xffff),
        Scalar::I32 => within(-0x8000_0000, 0x7fff_ffff),
        Scalar::U32 => within(0, 0xffff_ffff),
        Scalar::F32 | Scalar::F64 => word.parse().ok(),
    }
}

/// Converts the length of a list.
fn list_length(length: f64, property: &Property) -> Result<u64, String> {
    if length < 0.0 {
        return Err(format!(
            "list {} has the length {length}",
            quote(&property.name)
        ));
    }
    Ok(length as u64)
}

/// Reader of binary values.
struct Numbers<'a> {
    bytes: &'a [u8],
    at: usize,
    big: bool,
}

impl Numbers<'_> {
    fn wrong(&self, what: String) -> PlyError {
        PlyError::Binary {
            byte: self.at,
            what,
        }
    }

    /// Advances by `count` bytes and returns them.
    fn take(&mut self, count: u64) -> Option<&[u8]> {
        let end = usize::try_from(count)
            .ok()
            .and_then(|n| self.at.checked_add(n))?;
        let taken = self.bytes.get(self.at..end)?;
        self.at = end;
        Some(taken)
    }

    fn value(&mut self, scalar: Scalar) -> Option<f64> {
        let big = self.big;
        let taken = self.take(scalar.size() as u64)?;
        let mut b = [0u8; 8];
        b[..taken.len()].copy_from_slice(taken);
        if big {
            b[..taken.len()].reverse();
        }
        let [b0, b1, b2, b3, ..] = b;
        Some(match scalar {
            Scalar::I8 => f64::from(b0 as i8),
            Scalar::U8 => f64::from(b0),
            Scalar::I16 => f64::from(i16::from_le_bytes([b0, b1])),
            Scalar::U16 => f64::from(u16::from_le_bytes([b0, b1])),
            Scalar::I32 => f64::from(i32::from_le_bytes([b0, b1, b2, b3])),
            Scalar::U32 => f64::from(u32::from_le_bytes([b0, b1, b2, b3])),
            Scalar::F32 => f64::from(f32::from_le_bytes([b0, b1, b2, b3])),
            Scalar::F64 => f64::from_le_bytes(b),
        })
    }

    /// Skips all elements of a type without lists.
    fn skip(&mut self, element: &Element) -> Result<(), PlyError> {
        let size: u64 = element
            .properties
            .iter()
            .map(|p| p.scalar.size() as u64)
            .sum();
        let bytes = size.checked_mul(element.count);
        if bytes.and_then(|bytes| self.take(bytes)).is_none() {
            return Err(self.wrong(format!("the file ends within {}", quote(&element.name))));
        }
        Ok(())
    }

    fn element(
        &mut self,
        element: &Element,
        index: u64,
        out: &mut Vec<f64>,
    ) -> Result<(), PlyError> {
        let cut = |this: &Self| {
            this.wrong(format!(
                "the file ends within {} {index} of {}",
                quote(&element.name),
                element.count
            ))
        };
        out.clear();
        for property in &element.properties {
            let first = property.length.unwrap_or(property.scalar);
            let value = self.value(first).ok_or_else(|| cut(self))?;
            if property.length.is_none() {
                out.push(value);
                continue;
            }
            let length = list_length(value, property).map_err(|what| self.wrong(what))?;
            let bytes = length * property.scalar.size() as u64;
            if self.take(bytes).is_none() {
                return Err(self.wrong(format!(
                    "list {} of {} {index} has {length} values, more than the rest of the file",
                    quote(&property.name),
                    quote(&element.name)
                )));
            }
            out.push(0.0);
        }
        Ok(())
    }
}

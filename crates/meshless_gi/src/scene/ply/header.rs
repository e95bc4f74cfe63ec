//! Header of a `.ply` file: format, elements and their properties. Counts are checked against the
//! length of the file before any allocation.

use super::PlyError;

/// Largest number of elements, and of properties of an element. A larger number is treated as
/// damage.
const MAX_PARTS: usize = 1024;
/// Largest size of a header, bytes.
const MAX_HEADER_BYTES: usize = 1 << 20;

/// Encoding of the body.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Encoding {
    Ascii,
    LittleEndian,
    BigEndian,
}

/// Type of a value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Scalar {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl Scalar {
    /// Returns the type of a name. Supports both common families of names.
    fn named(name: &str) -> Option<Self> {
        Some(match name {
            "char" | "int8" => Self::I8,
            "uchar" | "uint8" => Self::U8,
            "short" | "int16" => Self::I16,
            "ushort" | "uint16" => Self::U16,
            "int" | "int32" => Self::I32,
            "uint" | "uint32" => Self::U32,
            "float" | "float32" => Self::F32,
            "double" | "float64" => Self::F64,
            _ => return None,
        })
    }

    pub(super) fn is_float(self) -> bool {
        matches!(self, Self::F32 | Self::F64)
    }

    /// Returns the size of a value in a binary body, bytes.
    pub(super) fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }
}

/// Value of an element, or a list of values.
#[derive(Clone, Debug)]
pub(super) struct Property {
    pub(super) name: String,
    pub(super) scalar: Scalar,
    /// Type of the list length. `None` for a single value.
    pub(super) length: Option<Scalar>,
}

/// Element type and its count.
#[derive(Clone, Debug)]
pub(super) struct Element {
    pub(super) name: String,
    pub(super) count: u64,
    pub(super) properties: Vec<Property>,
    /// Header line of the declaration.
    pub(super) line: usize,
}

impl Element {
    /// Returns the smallest number of bytes of one element in the body.
    pub(super) fn least_bytes(&self, encoding: Encoding) -> u64 {
        let of = |p: &Property| match encoding {
            // A digit and a separator. The last value of the file may have no separator.
            Encoding::Ascii => 2,
            _ => p.length.unwrap_or(p.scalar).size() as u64,
        };
        self.properties.iter().map(of).sum()
    }

    /// Returns the index of the scalar property of this name. `None` if it is absent or a list.
    pub(super) fn scalar(&self, name: &str) -> Option<usize> {
        self.properties
            .iter()
            .position(|p| p.name == name && p.length.is_none())
    }
}

/// Content of a header.
#[derive(Clone, Debug)]
pub(super) struct Header {
    pub(super) encoding: Encoding,
    pub(super) elements: Vec<Element>,
    /// Offset of the body, bytes.
    pub(super) body: usize,
    /// Number of header lines.
    pub(super) lines: usize,
}

/// Returns the line that starts at `from` without its end, and the start of the next line. `None`
/// at the end of the bytes.
pub(super) fn line_at(bytes: &[u8], from: usize) -> Option<(&[u8], usize)> {
    let rest = bytes.get(from..).filter(|rest| !rest.is_empty())?;
    let (line, next) = match rest.iter().position(|b| *b == b'\n') {
        Some(end) => (&rest[..end], from + end + 1),
        None => (rest, bytes.len()),
    };
    Some((line.strip_suffix(b"\r").unwrap_or(line), next))
}

impl Header {
    pub(super) fn read(bytes: &[u8]) -> Result<Self, PlyError> {
        let mut from = 0;
        let mut lines = 0;
        let mut encoding = None;
        let mut elements: Vec<Element> = Vec::new();
        loop {
            let wrong = |what: String| PlyError::Header {
                line: lines + 1,
                what,
            };
            let (line, next) = line_at(&bytes[..bytes.len().min(MAX_HEADER_BYTES)], from)
                .ok_or_else(|| wrong("the header has no end_header".into()))?;
            from = next;
            // Comments may have any encoding. Only the keywords must be valid text.
            let text = String::from_utf8_lossy(line);
            let words: Vec<&str> = text.split_ascii_whitespace().collect();
            match words.as_slice() {
                _ if lines == 0 => {
                    if words != ["ply"] {
                        return Err(wrong("it does not begin with `ply`".into()));
                    }
                }
                [] | ["comment" | "obj_info", ..] => {}
                ["format", name, version] => {
                    let found = match *name {
                        "ascii" => Encoding::Ascii,
                        "binary_little_endian" => Encoding::LittleEndian,
                        "binary_big_endian" => Encoding::BigEndian,
                        _ => return Err(wrong(format!("format {} is not known", quote(name)))),
                    };
                    if *version != "1.0" {
                        return Err(wrong(format!(
                            "version {}, only 1.0 can be read",
                            quote(version)
                        )));
                    }
                    if encoding.replace(found).is_some() {
                        return Err(wrong("a second format".into()));
                    }
                }
                ["element", name, count] => {
                    let count = count
                        .parse()
                        .map_err(|_| wrong(format!("{} is not a count", quote(count))))?;
                    if elements.iter().any(|e| e.name == *name) {
                        return Err(wrong(format!("a second element {}", quote(name))));
                    }
                    if elements.len() >= MAX_PARTS {
                        return Err(wrong(format!("more than {MAX_PARTS} elements")));
                    }
                    elements.push(Element {
                        name: (*name).into(),
                        count,
                        properties: Vec::new(),
                        line: lines + 1,
                    });
                }
                ["property", kind @ ..] => {
                    let property = property(kind).map_err(wrong)?;
                    let element = elements
                        .last_mut()
                        .ok_or_else(|| wrong("a property before any element".into()))?;
                    if element.properties.iter().any(|p| p.name == property.name) {
                        return Err(wrong(format!(
                            "a second property {}",
                            quote(&property.name)
                        )));
                    }
                    if element.properties.len() >= MAX_PARTS {
                        return Err(wrong(format!("more than {MAX_PARTS} properties")));
                    }
                    element.properties.push(property);
                }
                ["end_header"] => break,
                _ => return Err(wrong(format!("{} is not a header line", quote(&text)))),
            }
            lines += 1;
        }
        let Some(encoding) = encoding else {
            return Err(PlyError::Header {
                line: lines + 1,
                what: "the header has no format".into(),
            });
        };
        let header = Self {
            encoding,
            elements,
            body: from,
            lines: lines + 1,
        };
        header.check_counts(bytes.len() - from)?;
        Ok(header)
    }

    /// Checks that the remaining bytes can hold the counts of all elements.
    fn check_counts(&self, body: usize) -> Result<(), PlyError> {
        // The last value of a text needs no separator.
        let mut left = body as u64 + u64::from(self.encoding == Encoding::Ascii);
        for element in &self.elements {
            let wrong = |what: String| PlyError::Header {
                line: element.line,
                what,
            };
            if element.count > 0 && element.properties.is_empty() {
                return Err(wrong(format!(
                    "element {} has no properties",
                    quote(&element.name)
                )));
            }
            let min = element
                .count
                .checked_mul(element.least_bytes(self.encoding));
            left = min.and_then(|min| left.checked_sub(min)).ok_or_else(|| {
                wrong(format!(
                    "{} of element {} do not fit into the {body} bytes behind the header",
                    element.count,
                    quote(&element.name)
                ))
            })?;
        }
        Ok(())
    }
}

fn property(words: &[&str]) -> Result<Property, String> {
    let scalar = |name: &str| {
        Scalar::named(name).ok_or_else(|| format!("type {} is not known", quote(name)))
    };
    match words {
        ["list", length, kind, name] => {
            let length = scalar(length)?;
            if length.is_float() {
                return Err("the length of a list is not an integer type".into());
            }
            Ok(Property {
                name: (*name).into(),
                scalar: scalar(kind)?,
                length: Some(length),
            })
        }
        [kind, name] => Ok(Property {
            name: (*name).into(),
            scalar: scalar(kind)?,
            length: None,
        }),
        _ => Err("a property needs a type and a name".into()),
    }
}

/// Formats a word of the file for an error: short, and without control characters.
pub(super) fn quote(word: &str) -> String {
    let mut out: String = word.chars().take(40).flat_map(char::escape_debug).collect();
    if word.chars().nth(40).is_some() {
        out += "...";
    }
    format!("`{out}`")
}

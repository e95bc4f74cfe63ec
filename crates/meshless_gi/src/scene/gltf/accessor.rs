//! Reading accessors: typed arrays in buffers, with stride, normalized integers (including those of
//! KHR_mesh_quantization) and sparse substitution. Every count and offset is checked against the
//! available bytes before any read or allocation.

use ::gltf::json::accessor::{ComponentType, Type};
use ::gltf::json::validation::Checked;
use ::gltf::json::{Accessor, Index, Root, buffer};

/// Largest number of elements of an accessor without data. All elements are zero, except for those
/// of a sparse part.
pub(super) const MAX_ZEROS: usize = 1 << 22;

/// JSON and data of all buffers.
pub(super) struct Buffers<'a> {
    pub(super) root: &'a Root,
    pub(super) bytes: Vec<std::borrow::Cow<'a, [u8]>>,
}

fn component_size(kind: ComponentType) -> usize {
    match kind {
        ComponentType::I8 | ComponentType::U8 => 1,
        ComponentType::I16 | ComponentType::U16 => 2,
        ComponentType::U32 | ComponentType::F32 => 4,
    }
}

fn components(kind: Type) -> usize {
    match kind {
        Type::Scalar => 1,
        Type::Vec2 => 2,
        Type::Vec3 => 3,
        Type::Vec4 | Type::Mat2 => 4,
        Type::Mat3 => 9,
        Type::Mat4 => 16,
    }
}

fn number(bytes: &[u8], kind: ComponentType, normalized: bool) -> f32 {
    let scaled = |x: f32, max: f32| if normalized { (x / max).max(-1.0) } else { x };
    match *bytes {
        [a] if kind == ComponentType::U8 => scaled(f32::from(a), 255.0),
        [a] => scaled(f32::from(a as i8), 127.0),
        [a, b] if kind == ComponentType::U16 => {
            scaled(f32::from(u16::from_le_bytes([a, b])), 65_535.0)
        }
        [a, b] => scaled(f32::from(i16::from_le_bytes([a, b])), 32_767.0),
        [a, b, c, d] if kind == ComponentType::U32 => {
            scaled(u32::from_le_bytes([a, b, c, d]) as f32, 4_294_967_295.0)
        }
        [a, b, c, d] => f32::from_le_bytes([a, b, c, d]),
        _ => 0.0,
    }
}

fn decode_uint(bytes: &[u8]) -> u32 {
    let mut wide = [0u8; 4];
    wide[..bytes.len()].copy_from_slice(bytes);
    u32::from_le_bytes(wide)
}

/// Elements of `size` bytes, `stride` apart.
struct ElementSpan<'a> {
    bytes: &'a [u8],
    size: usize,
    stride: usize,
    count: usize,
}

impl<'a> ElementSpan<'a> {
    fn iter(&self) -> impl Iterator<Item = &'a [u8]> {
        let (bytes, size, stride) = (self.bytes, self.size, self.stride);
        (0..self.count).map(move |i| &bytes[i * stride..i * stride + size])
    }
}

impl Buffers<'_> {
    /// Returns the bytes of a buffer view.
    pub(super) fn view(&self, index: Index<buffer::View>) -> Result<&[u8], String> {
        let i = index.value();
        let view = self
            .root
            .buffer_views
            .get(i)
            .ok_or_else(|| format!("buffer view {i} is not there"))?;
        let b = view.buffer.value();
        let all = self
            .bytes
            .get(b)
            .ok_or_else(|| format!("buffer {b} is not there"))?;
        let from = view.byte_offset.map_or(0, |o| o.0);
        let range = from
            .checked_add(view.byte_length.0)
            .filter(|&to| to <= all.len() as u64);
        let to = range.ok_or_else(|| {
            format!(
                "buffer view {i} needs {} bytes from byte {from} of {}",
                view.byte_length.0,
                all.len()
            )
        })?;
        Ok(&all[from as usize..to as usize])
    }

    fn span(
        &self,
        index: Index<buffer::View>,
        offset: u64,
        size: usize,
        count: u64,
        tight: bool,
    ) -> Result<ElementSpan<'_>, String> {
        let bytes = self.view(index)?;
        let stride = match self.root.buffer_views[index.value()].byte_stride {
            Some(s) if !tight && s.0 > 0 => s.0,
            _ => size,
        };
        if stride < size {
            return Err(format!("elements of {size} bytes are {stride} bytes apart"));
        }
        let needed = match count {
            0 => Some(0),
            _ => (count - 1)
                .checked_mul(stride as u64)
                .and_then(|n| n.checked_add(size as u64))
                .and_then(|n| n.checked_add(offset)),
        };
        let needed = needed.filter(|&n| n <= bytes.len() as u64);
        if needed.is_none() {
            return Err(format!(
                "{count} elements of {size} bytes, {stride} apart, from byte {offset}, do not fit in the {} bytes of buffer view {}",
                bytes.len(),
                index.value()
            ));
        }
        Ok(ElementSpan {
            bytes: if count == 0 {
                &[]
            } else {
                &bytes[offset as usize..]
            },
            size,
            stride,
            count: count as usize,
        })
    }

    /// Returns the accessor at `index`, its component type and its number of components.
    fn checked(&self, index: Index<Accessor>) -> Result<(&Accessor, ComponentType, usize), String> {
        let i = index.value();
        let accessor = self
            .root
            .accessors
            .get(i)
            .ok_or_else(|| format!("accessor {i} is not there"))?;
        match (&accessor.component_type, &accessor.type_) {
            (Checked::Valid(c), Checked::Valid(t)) => Ok((accessor, c.0, components(*t))),
            _ => Err(format!("accessor {i} has an unknown type")),
        }
    }

    /// Returns all elements of an accessor of `N` components as floating-point values.
    pub(super) fn vectors<const N: usize>(
        &self,
        index: Index<Accessor>,
    ) -> Result<Vec<[f32; N]>, String> {
        let name = |e: String| format!("accessor {}: {e}", index.value());
        let (accessor, kind, width) = self.checked(index)?;
        if width != N {
            return Err(name(format!("{width} components, {N} are needed")));
        }
        let each = component_size(kind);
        let read = |bytes: &[u8]| -> [f32; N] {
            std::array::from_fn(|k| {
                number(&bytes[k * each..(k + 1) * each], kind, accessor.normalized)
            })
        };
        let count = accessor.count.0;
        let offset = accessor.byte_offset.map_or(0, |o| o.0);
        let mut out: Vec<[f32; N]> = match accessor.buffer_view {
            Some(view) => self
                .span(view, offset, N * each, count, false)
                .map_err(name)?
                .iter()
                .map(read)
                .collect(),
            None if count > MAX_ZEROS as u64 => {
                return Err(name(format!("{count} elements without any bytes")));
            }
            None => vec![[0.0; N]; count as usize],
        };
        if let Some(sparse) = &accessor.sparse {
            let Checked::Valid(index_kind) = &sparse.indices.component_type else {
                return Err(name("its sparse indices have an unknown type".into()));
            };
            let size = component_size(index_kind.0);
            let indices = self
                .span(
                    sparse.indices.buffer_view,
                    sparse.indices.byte_offset.0,
                    size,
                    sparse.count.0,
                    true,
                )
                .map_err(name)?;
            let values = self
                .span(
                    sparse.values.buffer_view,
                    sparse.values.byte_offset.0,
                    N * each,
                    sparse.count.0,
                    true,
                )
                .map_err(name)?;
            for (index, value) in indices.iter().zip(values.iter()) {
                let index = decode_uint(index) as usize;
                let to = out.get_mut(index).ok_or_else(|| {
                    name(format!(
                        "its sparse part replaces element {index} of {count}"
                    ))
                })?;
                *to = read(value);
            }
        }
        Ok(out)
    }

    /// Returns all elements of an accessor of vertex indices.
    pub(super) fn indices(&self, index: Index<Accessor>) -> Result<Vec<u32>, String> {
        let name = |e: String| format!("accessor {}: {e}", index.value());
        let (accessor, kind, width) = self.checked(index)?;
        if width != 1
            || !matches!(
                kind,
                ComponentType::U8 | ComponentType::U16 | ComponentType::U32
            )
        {
            return Err(name("vertex indices are single unsigned integers".into()));
        }
        let Some(view) = accessor.buffer_view else {
            return Err(name("vertex indices without bytes".into()));
        };
        if accessor.sparse.is_some() {
            return Err(name("sparse vertex indices are not read".into()));
        }
        let offset = accessor.byte_offset.map_or(0, |o| o.0);
        let span = self
            .span(view, offset, component_size(kind), accessor.count.0, false)
            .map_err(name)?;
        Ok(span.iter().map(decode_uint).collect())
    }
}

//! Spans of rows and points in one uniform buffer, each at an offset that can be bound.

use super::buffer_factory::uniform;
use super::links::LinkChunk;
use meshless_gi::internals::frame::Span;
use std::ops::Range;

/// Spans of one kind with their offsets in the uniform buffer of spans.
#[derive(Clone, Debug, Default)]
pub(super) struct SpanList {
    /// Offset in bytes, and the span at this offset.
    pub at: Vec<(u32, Span)>,
}

pub(super) fn span(range: Range<usize>) -> Span {
    Span {
        first: range.start as u32,
        count: range.len() as u32,
        ..Span::default()
    }
}

/// Returns the rows of a chunk that are among the first `max` rows.
pub(super) fn part_span(part: &LinkChunk, max: u32) -> Span {
    Span {
        first: part.rows.start,
        count: part.rows.end.min(max).saturating_sub(part.rows.start),
        base: part.links.start,
        pad: 0,
    }
}

/// Spans before their upload.
pub(super) struct SpanTable<'a> {
    device: &'a wgpu::Device,
    stride: usize,
    bytes: Vec<u8>,
}

impl<'a> SpanTable<'a> {
    pub fn new(device: &'a wgpu::Device) -> Self {
        let align = device.limits().min_uniform_buffer_offset_alignment as usize;
        Self {
            device,
            stride: size_of::<Span>().next_multiple_of(align.max(1)),
            bytes: Vec::new(),
        }
    }

    pub fn list(&mut self, spans: impl IntoIterator<Item = Span>) -> SpanList {
        let at = spans.into_iter().map(|s| {
            let offset = self.bytes.len();
            self.bytes.extend_from_slice(bytemuck::bytes_of(&s));
            self.bytes.resize(offset + self.stride, 0);
            (offset as u32, s)
        });
        SpanList { at: at.collect() }
    }

    pub fn upload(self, queue: &wgpu::Queue) -> wgpu::Buffer {
        let buffer = uniform(self.device, "spans", self.bytes.len() as u64);
        queue.write_buffer(&buffer, 0, &self.bytes);
        buffer
    }
}

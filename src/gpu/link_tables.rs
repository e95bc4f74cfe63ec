//! Links of the operator on the GPU: chunks that fit a binding, and the spans of each tier.

use super::GpuError;
use super::buffer_factory::BufferFactory;
use super::links::split_links;
use super::spans::{SpanList, SpanTable, part_span};
use meshless_gi::BakedScene;
use meshless_gi::internals::frame::{SceneDimensions, Span};
use meshless_gi::internals::transport::{Row, row_order};

/// Links of a scene, cut into chunks of rows in the order of their tiers.
pub(super) struct LinkTables {
    /// Rows in the order of their tiers.
    pub ordered: Vec<Row>,
    /// Receivers of `ordered`, then those of them that are senders.
    pub order: Vec<u32>,
    /// Links of each chunk.
    pub links: Vec<wgpu::Buffer>,
    /// Spans of the chunks' rows for each tier.
    pub tier_parts: Vec<SpanList>,
    /// The same for the rows of senders.
    pub sender_parts: Vec<SpanList>,
}

impl LinkTables {
    /// Uploads the links of `scene` and lists their spans in `table`.
    ///
    /// # Errors
    /// [`GpuError::TooLarge`] if a single row does not fit a binding.
    pub fn new(
        make: &BufferFactory<'_>,
        table: &mut SpanTable<'_>,
        scene: &BakedScene,
        shape: &SceneDimensions,
    ) -> Result<Self, GpuError> {
        let senders = shape.senders() as u32;
        let order = row_order(&scene.data().operator.rows);
        let row = |&i: &u32| scene.data().operator.rows[i as usize];
        let ordered: Vec<Row> = order.iter().map(row).collect();
        let parts = split_links(&ordered, make.limit)?;
        let links = parts
            .iter()
            .map(|p| {
                let range = p.links.start as usize..p.links.end as usize;
                make.upload("links", &scene.data().operator.links[range])
            })
            .collect::<Result<Vec<_>, _>>()?;
        // Number of senders among the first n rows, for every n.
        let mut sending = vec![0];
        for &i in &order {
            sending.push(sending[sending.len() - 1] + u32::from(i < senders));
        }
        let (mut tier_parts, mut sender_parts) = (Vec::new(), Vec::new());
        for t in 1..=shape.link_tiers {
            let used = ordered.partition_point(|row| row.tier <= t) as u32;
            let spans = parts.iter().map(|p| part_span(p, used));
            tier_parts.push(table.list(spans.clone()));
            sender_parts.push(table.list(spans.map(|span| {
                let [first, end] =
                    [span.first, span.first + span.count].map(|r| sending[r as usize]);
                Span {
                    first: order.len() as u32 + first,
                    count: end - first,
                    ..span
                }
            })));
        }
        let of_senders = order.iter().filter(|&&i| i < senders);
        Ok(Self {
            order: order.iter().chain(of_senders).copied().collect(),
            ordered,
            links,
            tier_parts,
            sender_parts,
        })
    }
}

//! An operator from rows whose links lie row after row, as tests that make scenes by hand write them down.

use bevy_meshless_gi::transport::{Link, Operator, Row, SenderForm, place_links, row_order};

/// Puts the links into the order of the tiers.
pub fn operator(form: SenderForm, mut rows: Vec<Row>, links: &[Link]) -> Operator {
    let sorted = row_order(&rows)
        .iter()
        .flat_map(|&i| {
            let row = &rows[i as usize];
            links[row.start as usize..][..row.count as usize].to_vec()
        })
        .collect();
    place_links(&mut rows).unwrap();
    Operator {
        form,
        rows,
        links: sorted,
        compression: None,
    }
}

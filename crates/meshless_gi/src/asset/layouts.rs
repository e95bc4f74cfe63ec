//! Layouts of the items of sections: the words that a file stores, and their order.

use super::codec::{Field, Layout, words};

pub(super) const POINT: Layout = Layout::rows(&[
    Field::word(0),
    Field::word(1),
    Field::word(2),
    Field::word(3),
    Field::word(4),
    Field::word(5),
    Field::word(6),
    Field::word(7).delta(),
]);
pub(super) const LIGHT_SAMPLE: Layout = Layout::rows(&words([0, 1, 2, 3]));
pub(super) const SURFACE: Layout = Layout::rows(&words([0, 1, 2, 4, 5, 6, 8, 9, 10]));
pub(super) const COUNT: Layout = Layout::columns(&[Field::word(0)]);
pub(super) const INDEX: Layout = Layout::columns(&[Field::word(0).delta()]);
pub(super) const WEIGHT: Layout = Layout::columns(&[Field::word(0).delta(), Field::word(1)]);
/// `start` follows from tiers and counts.
pub(super) const ROW: Layout = Layout::columns(&[Field::word(1), Field::word(2), Field::low(3)]);
pub(super) const LINK: Layout = Layout::columns(&[
    Field::low(0),
    Field::high(0),
    Field::low(1),
    Field::high(1).delta(),
]);
/// Two half floats per word.
pub(super) const VALUE: Layout = Layout::columns(&[Field::low(0), Field::high(0)]);
pub(super) const COLUMN: Layout = Layout::columns(&[
    Field::word(0).delta(),
    Field::word(1),
    Field::word(2).delta(),
    Field::word(3),
]);
pub(super) const BOUNCE: Layout = Layout::columns(&[
    Field::word(0),
    Field::word(1),
    Field::word(2),
    Field::word(3).delta(),
]);
pub(super) const COLOR: Layout = Layout::columns(&words([0, 1, 2]));
pub(super) const PLANE: Layout = Layout::rows(&words([0, 1, 2, 3]));
pub(super) const SLOT: Layout = Layout::rows(&words([0, 1, 2, 3]));
pub(super) const NODE: Layout = Layout::columns(&[
    Field::word(0),
    Field::word(1),
    Field::word(2),
    Field::word(4),
    Field::word(5),
    Field::word(6),
    Field::word(3).delta(),
    Field::word(7),
]);
pub(super) const TRIANGLE: Layout = Layout::rows(&words([0, 1, 2, 4, 5, 6, 8, 9, 10]));

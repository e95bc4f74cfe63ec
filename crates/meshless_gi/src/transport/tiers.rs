//! Tiers of the operator (design D11): nested sets of rows for cheaper frames.
//!
//! With method `bounded`, each row replaces the prediction. A point without a row takes the
//! weighted mean of its parents (kernel `flatten`). Any set of rows that includes all rows without
//! parents is therefore an operator. Tiers are a nested series of such sets.
//!
//! Rows of coarser levels come first. Rows of one level follow in an order that is even over the
//! surface. The interpolation error decreases with the square of the spacing. Its square decreases
//! by a factor of sixteen per level, while a row costs about the same on every level. An even part
//! of a level is unbiased, except for light in regions smaller than the spacing. An alternative is
//! to order rows by the loss that refinement measures (times area, over links). It is not better at
//! equal links, and it darkens the result. Where irradiance varies slowly, the loss is below the
//! noise of the rays. Thousands of rows are then missing together.
//!
//! Method `l08` has one tier. Its rows are differences that all finer points use (\[L08\] Eq.
//! (17)), and ε has already removed small rows.

use super::SenderForm;
use super::refine::RawRow;
use crate::basis::Weights;

/// Number of tiers with method `bounded`.
pub const TIERS: u32 = 4;

/// Links of the first tier relative to all. The tier is larger if rows without parents have more
/// links.
const FIRST_TIER_FRACTION: f64 = 0.125;

/// Computes the tier of each point's row, 1 to [`TIERS`]. A frame of this tier or a higher one uses
/// the row. The value is undefined for points without rows.
///
/// `level_starts` bounds the levels. Points of a level are in Morton order. `parents` has a row per
/// point. Tiers have about 1/8, 1/4, 1/2 and all of the links.
#[must_use]
pub fn assign_tiers(
    rows: &[RawRow],
    level_starts: &[u32],
    parents: &Weights,
    form: SenderForm,
) -> Vec<u32> {
    let mut tiers = vec![1; rows.len()];
    if form == SenderForm::Differences {
        return tiers;
    }
    // Number of links after packing, except for links that round to zero. A row costs at least one.
    let cost = |i: usize| rows[i].links.len() as u64 + 1;
    let active = |i: &usize| rows[*i].active;
    let needed = |i: &usize| parents.row(*i).is_empty();
    let sum = |of: &dyn Fn(&usize) -> bool| (0..rows.len()).filter(of).map(cost).sum::<u64>();
    let min = sum(&|i| active(i) && needed(i));
    let targets = targets(sum(&active), min);
    let mut used = min;
    let mut tier = 1;
    for bounds in level_starts.windows(2) {
        let level = bounds[0] as usize..bounds[1] as usize;
        let mut optional: Vec<usize> = level.filter(|i| active(i) && !needed(i)).collect();
        // Weyl sequence of the golden ratio: every prefix is distributed evenly.
        optional.sort_by_key(|&i| ((i as u32).wrapping_mul(0x9e37_79b9), i));
        for i in optional {
            while tier < TIERS && used >= targets[tier as usize - 1] {
                tier += 1;
            }
            tiers[i] = tier;
            used += cost(i);
        }
    }
    tiers
}

/// Computes the number of links of each tier except the last. The numbers are a geometric series up
/// to all links. It starts at [`FIRST_TIER_FRACTION`] of `all`, or at the required links if there
/// are more.
fn targets(all: u64, needed: u64) -> [u64; TIERS as usize - 1] {
    let first = (needed as f64 / all.max(1) as f64).max(FIRST_TIER_FRACTION);
    let step = libm::cbrt(first);
    [first, step * step, step].map(|share| (share * all as f64) as u64)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::basis::WeightEntry;
    use glam::Vec3A;

    /// Creates 20 points that need their rows and 2000 that do not. Every fifth of the 2000 points
    /// has no row. A row has four links.
    fn rows() -> (Vec<RawRow>, Weights, [u32; 4]) {
        let rows = (0..2020)
            .map(|i| match i < 20 || i % 5 != 0 {
                true => RawRow {
                    links: (0..4).map(|j| (j, Vec3A::X)).collect(),
                    active: true,
                    ..RawRow::default()
                },
                false => RawRow::default(),
            })
            .collect();
        let parents = Weights::from_rows((0..2020u32).map(|i| match i < 20 {
            true => vec![],
            false => vec![WeightEntry {
                index: i % 20,
                weight: 1.0,
            }],
        }));
        (rows, parents, [0, 20, 420, 2020])
    }

    #[test]
    fn tiers_double_in_size_and_start_with_coarse_levels() {
        let (rows, parents, starts) = rows();
        let tiers = assign_tiers(&rows, &starts, &parents, SenderForm::Averages);
        let active: Vec<usize> = (0..rows.len()).filter(|&i| rows[i].active).collect();
        for (t, share) in (1..=TIERS).zip([0.125, 0.25, 0.5, 1.0]) {
            let used = active.iter().filter(|&&i| tiers[i] <= t).count() as f64;
            let found = used / active.len() as f64;
            assert!((found - share).abs() < 0.002, "tier {t}: {found}");
        }
        assert!(tiers[..20].iter().all(|&t| t == 1));
        let highest = |r: std::ops::Range<usize>| r.map(|i| tiers[i]).max().unwrap();
        // 340 of 1620 rows are on the two coarser levels, which use two tiers.
        assert_eq!((highest(20..420), highest(420..2020)), (2, 4));
        // Each sixteenth of the finest level has about the same number of rows of tier 3.
        for part in 0..16 {
            let range = 420 + 100 * part..520 + 100 * part;
            let count = range.filter(|&i| rows[i].active && tiers[i] == 3).count();
            assert!((20..=32).contains(&count), "part {part}: {count}");
        }
    }

    #[test]
    fn difference_rows_have_one_tier() {
        let (rows, parents, starts) = rows();
        let one = assign_tiers(&rows, &starts, &parents, SenderForm::Differences);
        assert!(one.iter().all(|&t| t == 1));
        let none = Weights::from_rows((0..2020).map(|_| []));
        let one = assign_tiers(&rows, &starts, &none, SenderForm::Averages);
        assert!(one.iter().all(|&t| t == 1));
        let empty = Weights::default();
        assert!(assign_tiers(&[], &[0], &empty, SenderForm::Averages).is_empty());
    }
}

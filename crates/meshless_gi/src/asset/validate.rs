//! Validation of a baked scene: every index and number is in range, and every traversal is finite.
//! No scene is used before it has passed (design D10).

use super::info::TierInfo;
use super::scene_data::{LightSamples, SceneData};
use super::stats::BakedStats;
use super::violation::{Check, Violation};
use crate::basis::Weights;
use crate::samples::GridSlot;
use crate::transport::{Link, MAX_CODE, Operator, SenderForm, row_order};
use glam::{Vec3, Vec4};

/// Largest deviation from one of sums of weights and of lengths of normals.
pub(super) const TOLERANCE: f32 = 1e-3;
/// Largest radiosity that surfaces may emit, W/m². Sums of larger values overflow.
pub(super) const MAX_RADIOSITY: f32 = 1e20;
/// Largest sum Σ |F·n| of rows of averages: 1 except for rounding.
pub(super) const MAX_ROW_SUM: f32 = 1.01;
/// Largest |F|. It is at most 1 for averages. Differences between levels and the noise of the
/// gather may exceed 1 slightly.
pub(super) const MAX_LINK: f32 = 16.0;

impl SceneData {
    /// Checks the arrays, and the facts about their tiers. See
    /// [`BakedScene::validate`](super::BakedScene::validate).
    pub(super) fn validate(&self, tiers: &[TierInfo]) -> Result<BakedStats, Vec<Violation>> {
        let mut check = Check(Vec::new());
        self.check_shape(&mut check);
        // The other checks take their ranges from the shape.
        if check.0.is_empty() {
            self.check_points(&mut check);
            self.check_weights(&mut check);
            self.check_compression(&mut check);
            self.check_sky(&mut check);
            self.check_operator(&mut check, tiers);
            self.check_grid(&mut check);
            self.check_visibility(&mut check);
            self.check_probes(&mut check);
            self.check_fmm(&mut check);
            self.check_materials(&mut check);
            self.check_illumination(&mut check);
            self.check_occluders(&mut check);
        }
        let depth = self.check_bvh(&mut check);
        if check.0.is_empty() {
            Ok(self.stats(depth))
        } else {
            Err(check.0)
        }
    }

    /// Checks the lengths of arrays and levels.
    fn check_shape(&self, check: &mut Check) {
        let (points, starts) = (self.points.len(), &self.level_starts);
        check.section(starts.len() >= 2, "levels", || {
            "at least one is required".into()
        });
        check.section(starts.is_sorted(), "levels", || "do not ascend".into());
        check.section(
            starts.first() == Some(&0) && starts.last().map(|&s| s as usize) == Some(points),
            "levels",
            || format!("do not cover the {points} points"),
        );
        let levels = starts.len().saturating_sub(1);
        let sender_levels = self.sender_levels as usize;
        let sound = (1..=levels).contains(&sender_levels);
        check.section(sound, "sender levels", || {
            format!("{sender_levels} of {levels} levels")
        });
        let senders = if sound {
            starts[sender_levels] as usize
        } else {
            0
        };
        let per_sender = self.light_samples.per_sender;
        check.section(per_sender <= LightSamples::MAX, "light samples", || {
            format!("{per_sender} per sender, at most {}", LightSamples::MAX)
        });
        let max_senders = Link::MAX_SENDERS - self.sky_terms();
        check.section(senders <= max_senders, "senders", || {
            format!("{senders}, at most {max_senders}")
        });
        let mut length = |location, found: usize, expected: usize| {
            check.section(found == expected, location, || {
                format!("{found} instead of {expected}")
            });
        };
        length("surfaces", self.surfaces.len(), points);
        let finest = match sound {
            true => senders - starts[sender_levels - 1].min(starts[sender_levels]) as usize,
            false => 0,
        };
        length(
            "light samples",
            self.light_samples.list.len(),
            finest.saturating_mul(per_sender as usize),
        );
        length("pull rows", self.pull.len(), senders);
        length("parent rows", self.parents.len(), points);
        length("rows", self.operator.rows.len(), points);
        if let Some(bounces) = &self.bounces {
            let coarsest = starts.get(1).map_or(0, |&s| s as usize);
            length(
                "bounce rows",
                bounces.starts.len().saturating_sub(1),
                coarsest,
            );
        }
    }

    fn check_points(&self, check: &mut Check) {
        let radius = self.display.radius;
        check.section(
            radius.is_finite() && radius >= 0.0,
            "display radius",
            || format!("{radius} m"),
        );
        for (i, p) in self.points.iter().enumerate() {
            check.item(p.x().is_finite(), "points", i, || {
                format!("position {}", p.x())
            });
            check.item(unit(p.n()), "points", i, || {
                format!("normal {} is not of unit length", p.n())
            });
            check.item(p.radius.is_finite() && p.radius > 0.0, "points", i, || {
                format!("radius {} m", p.radius)
            });
            let planes = p.plane_range();
            check.item(planes.end <= self.display.planes.len(), "points", i, || {
                format!("clip planes {planes:?} of {}", self.display.planes.len())
            });
            if check.is_full() {
                return;
            }
        }
        for (i, p) in self.light_samples.list.iter().enumerate() {
            check.item(p.x().is_finite(), "light samples", i, || {
                format!("position {}", p.x())
            });
        }
        for (i, s) in self.surfaces.iter().enumerate() {
            let within =
                |v: [f32; 3], low: f32, high: f32| v.iter().all(|c| (low..=high).contains(c));
            check.item(
                within(s.albedo, 0.0, 1.0 + TOLERANCE),
                "surfaces",
                i,
                || format!("albedo {:?}", s.albedo),
            );
            check.item(
                within(s.emission, 0.0, MAX_RADIOSITY),
                "surfaces",
                i,
                || format!("emission {:?}", s.emission),
            );
            check.item(within(s.sky, -2.0, 2.0), "surfaces", i, || {
                format!("sky {:?}", s.sky)
            });
        }
        for (i, plane) in self.display.planes.iter().enumerate() {
            check.item(Vec4::from_array(*plane).is_finite(), "planes", i, || {
                format!("{plane:?}")
            });
        }
    }

    /// Checks that there is one irradiance per point, or none.
    fn check_illumination(&self, check: &mut Check) {
        let (found, points) = (self.illumination.len(), self.points.len());
        check.section(found == 0 || found == points, "illumination", || {
            format!("{found} instead of {points}")
        });
        for (i, e) in self.illumination.iter().enumerate() {
            let sound = e.iter().all(|c| (0.0..=f32::MAX).contains(c));
            check.item(sound, "illumination", i, || format!("{e:?} W/m²"));
        }
    }

    /// Checks that pull rows refer to senders on finer levels and parent rows to points on coarser
    /// levels. Both traversals then end.
    fn check_weights(&self, check: &mut Check) {
        let all = self.parents.starts.len() == self.points.len() + 1;
        check.section(
            all && has_valid_starts(&self.parents),
            "parent rows",
            || "do not ascend to the end of the weights".into(),
        );
        check.section(has_valid_starts(&self.pull), "pull rows", || {
            "do not ascend to the end of the weights".into()
        });
        if !check.0.is_empty() {
            return;
        }
        let senders = self.senders();
        let per_level = self.operator.form == SenderForm::Differences;
        for l in 0..self.levels() {
            let level = self.level(l);
            for i in level.clone() {
                let row = self.parents.row(i);
                for w in row {
                    check.item((w.index as usize) < level.start, "parents", i, || {
                        format!("parent {} is not on a coarser level", w.index)
                    });
                }
                check_sums(check, "parents", i, self.parents.row(i), |w| {
                    per_level.then(|| self.level_starts.partition_point(|&s| s <= w))
                });
            }
            for i in level.start..level.end.min(self.senders()) {
                for w in self.pull.row(i) {
                    check.item(
                        (level.end..senders).contains(&(w.index as usize)),
                        "pull",
                        i,
                        || format!("child {} is not a sender on a finer level", w.index),
                    );
                }
                check_sums(check, "pull", i, self.pull.row(i), |_| None);
            }
            if check.is_full() {
                return;
            }
        }
    }

    /// Returns the highest tier that row `i` may be of. Rows that a frame of every tier needs are
    /// of the first, and differences are not omitted.
    fn max_tier(&self, i: usize) -> u32 {
        // The parent rows may be invalid themselves.
        let needed =
            !matches!(self.parents.starts.get(i..i + 2), Some(&[start, end]) if start < end);
        match needed || self.operator.form == SenderForm::Differences {
            true => 1,
            false => Operator::MAX_TIERS,
        }
    }

    /// Checks the recorded sizes of the tiers against the operator.
    fn check_tiers(&self, check: &mut Check, stated: &[TierInfo]) {
        let sizes = self.tier_sizes();
        check.section(sizes.len() == stated.len(), "tiers", || {
            format!("{} are listed, but there are {}", stated.len(), sizes.len())
        });
        for (t, (tier, (rows, links))) in stated.iter().zip(sizes).enumerate() {
            let (error, interval) = (tier.estimated_nrmse, tier.estimated_nrmse_interval);
            check.item((tier.rows, tier.links) == (rows, links), "tiers", t, || {
                format!(
                    "{} rows and {} links are listed, but there are {rows} and {links}",
                    tier.rows, tier.links
                )
            });
            let sound = |v: f32| v.is_finite() && v >= 0.0;
            check.item(sound(error) && sound(interval), "tiers", t, || {
                format!("estimated error {error} ± {interval}")
            });
        }
    }

    fn check_operator(&self, check: &mut Check, tiers: &[TierInfo]) {
        let (rows, links) = (&self.operator.rows, &self.operator.links);
        let coefficients = self.operator.coefficients(self.senders()) + self.sky_terms();
        let mut end = 0u64;
        for i in row_order(rows) {
            let row = &rows[i as usize];
            check.item(u64::from(row.start) == end, "rows", i as usize, || {
                format!("starts at link {} instead of {end}", row.start)
            });
            end += u64::from(row.count);
        }
        // Invalid parent rows cannot be evaluated.
        let sound = check.0.is_empty();
        for (i, row) in rows.iter().enumerate() {
            let fits = !sound || row.tier <= self.max_tier(i);
            check.item(fits, "rows", i, || {
                format!("has tier {}, at most {}", row.tier, self.max_tier(i))
            });
            check.item(row.tier > 0 || row.count == 0, "rows", i, || {
                format!("has tier 0, but {} links", row.count)
            });
            check.item((0.0..=MAX_LINK).contains(&row.scale), "rows", i, || {
                format!("scale {}", row.scale)
            });
        }
        let (steps, precision) = (&self.operator.steps, &self.operator.precision);
        check.section(
            steps.is_empty() || steps.len() == rows.len(),
            "link steps",
            || format!("{} items, but {} rows", steps.len(), rows.len()),
        );
        for (i, (&code, row)) in steps.iter().zip(rows).enumerate() {
            let sound = code <= MAX_CODE && (code == 0 || row.tier > 0);
            check.item(sound, "link steps", i, || format!("code {code}"));
        }
        let senders = match self.operator.form {
            SenderForm::Components => 0,
            _ => self.senders(),
        };
        check.section(
            precision.is_empty() || precision.len() == senders + 1,
            "sender precision",
            || format!("{} items, but {senders} senders", precision.len()),
        );
        check.section(end == links.len() as u64, "rows", || {
            format!("have {end} links, but there are {}", links.len())
        });
        if check.0.is_empty() {
            self.check_tiers(check, tiers);
        }
        for (i, link) in links.iter().enumerate() {
            let v = link.vector();
            check.item(
                v.abs().max_element() <= 1.0 + TOLERANCE && v.is_finite(),
                "links",
                i,
                || format!("vector {v}"),
            );
            check.item(link.sender() as usize <= coefficients, "links", i, || {
                format!("sender {} of {coefficients}", link.sender())
            });
            if check.is_full() {
                return;
            }
        }
        self.check_row_sums(check);
        let (Some(bounces), senders) = (&self.bounces, self.senders()) else {
            return;
        };
        let starts = &bounces.starts;
        check.section(
            starts.is_sorted()
                && starts.first() == Some(&0)
                && starts.last().map(|&s| s as usize) == Some(bounces.links.len()),
            "bounce rows",
            || "do not ascend to the end of the links".into(),
        );
        for (i, link) in bounces.links.iter().enumerate() {
            let sound = link.gain.iter().all(|g| (0.0..=f32::MAX).contains(g));
            check.item(sound, "bounce links", i, || format!("gain {:?}", link.gain));
            check.item((link.sender as usize) < senders, "bounce links", i, || {
                format!("sender {} of {senders}", link.sender)
            });
        }
    }

    /// Checks that no point receives more than all senders emit. With larger row sums the sweeps
    /// would diverge. Differences have signs, and are not checked.
    fn check_row_sums(&self, check: &mut Check) {
        if !check.0.is_empty() || self.operator.form == SenderForm::Differences {
            return;
        }
        if let Some(compression) = &self.operator.compression {
            return self.check_components(check, compression);
        }
        let all = self.operator.rows.iter().zip(&self.points).enumerate();
        for (i, (row, point)) in all {
            let links = &self.operator.links[row.start as usize..][..row.count as usize];
            let n = point.n();
            // The sky's terms have signs, and are parts of its light.
            let light = links
                .iter()
                .filter(|l| l.sender() as usize <= self.senders());
            let sum: f32 = light.map(|l| l.vector().dot(n).abs()).sum();
            let sum = sum * row.scale;
            check.item(sum <= MAX_ROW_SUM, "rows", i, || {
                format!("links sum to {sum}, at most {MAX_ROW_SUM}")
            });
        }
    }

    /// Checks that a lookup ends at a free slot and stays within its list.
    fn check_grid(&self, check: &mut Check) {
        let grid = &self.display.grid;
        let (slots, entries) = (&grid.slots, &grid.entries);
        let size = grid.cell_size;
        check.section(size.is_finite() && size > 0.0, "grid", || {
            format!("cells of {size} m")
        });
        let taken = slots.iter().filter(|s| s.start != GridSlot::EMPTY).count();
        check.section(
            slots.len().is_power_of_two() && 2 * taken <= slots.len(),
            "grid",
            || format!("{taken} of {} slots are taken", slots.len()),
        );
        // Lists are contiguous, so that no entry is read twice.
        let mut at = 0;
        while at < entries.len() && !check.is_full() {
            let count = entries[at] as usize;
            let Some(list) = entries[at + 1..].get(..count) else {
                check.item(false, "grid entries", at, || {
                    format!("a list of {count} is cut off")
                });
                return;
            };
            check.item(
                list.iter().all(|&p| (p as usize) < self.points.len()),
                "grid entries",
                at,
                || format!("refers to a point beyond the {}", self.points.len()),
            );
            at += 1 + count;
        }
        // A slot that starts within a list might refer to an entry that is not a point.
        let list_starts = || {
            let mut at = 0;
            std::iter::from_fn(move || {
                let start = at;
                at += 1 + *entries.get(start)? as usize;
                Some(start as u32)
            })
        };
        let mut lists = Vec::with_capacity(list_starts().count());
        lists.extend(list_starts());
        for (i, slot) in slots.iter().enumerate() {
            let sound = slot.start == GridSlot::EMPTY || lists.binary_search(&slot.start).is_ok();
            check.item(sound, "grid slots", i, || {
                format!("no list starts at {}", slot.start)
            });
        }
    }
}

fn unit(n: Vec3) -> bool {
    (n.length_squared() - 1.0).abs() <= 2.0 * TOLERANCE
}

fn has_valid_starts(weights: &Weights) -> bool {
    weights.starts.is_sorted()
        && weights.starts.first() == Some(&0)
        && weights.starts.last().map(|&s| s as usize) == Some(weights.entries.len())
}

/// Checks that the weights of a row are finite and not negative, and that those of each group sum
/// to one. All weights are one group if `group` returns `None`.
fn check_sums(
    check: &mut Check,
    name: &'static str,
    i: usize,
    row: &[crate::basis::WeightEntry],
    group: impl Fn(u32) -> Option<usize>,
) {
    let sound = row
        .iter()
        .all(|w| (0.0..=1.0 + TOLERANCE).contains(&w.weight));
    check.item(sound, name, i, || "a weight is not within 0 to 1".into());
    for part in row.chunk_by(|a, b| group(a.index) == group(b.index)) {
        let sum: f32 = part.iter().map(|w| w.weight).sum();
        check.item((sum - 1.0).abs() <= TOLERANCE, name, i, || {
            format!("weights sum to {sum}")
        });
    }
}

//! Cases in which light transport is known to fail: what is done about each, and that it holds.
//! `docs/reports/HARD_CASES.md` lists them with what was measured.

#[path = "hard_cases/closed_rooms.rs"]
mod closed_rooms;
#[path = "hard_cases/components.rs"]
mod components;
#[path = "hard_cases/digits.rs"]
mod digits;
#[path = "hard_cases/energy.rs"]
mod energy;
#[path = "hard_cases/lamps.rs"]
mod lamps;
#[path = "hard_cases/levels.rs"]
mod levels;
#[path = "hard_cases/places.rs"]
mod places;
#[path = "hard_cases/points.rs"]
mod points;
#[path = "hard_cases/smooth.rs"]
mod smooth;

use meshless_gi_lab::fixtures::hard_cases as support;

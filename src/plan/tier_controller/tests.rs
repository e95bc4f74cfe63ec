//! Tests of `tier_controller`.

use super::*;
use std::time::Duration;

fn tiers() -> Vec<TierCandidate> {
    [(1, 0.08), (2, 0.05), (4, 0.045), (8, 0.04)]
        .map(|(work, error)| TierCandidate {
            work: 1000 * work,
            error,
            octree: false,
        })
        .to_vec()
}

/// Returns deterministic noise in −1 to 1.
fn noise(i: u32) -> f32 {
    let hash = i.wrapping_mul(0x9e37_79b9) ^ 0x51ed_270b;
    let hash = (hash ^ hash >> 15).wrapping_mul(0x85eb_ca6b);
    ((hash ^ hash >> 13) >> 8) as f32 / (1 << 23) as f32 - 1.0
}

/// Runs `count` solves whose cost, in milliseconds, is `cost(solve, work)`. Returns the tier after
/// each.
fn run(controller: &mut TierController, count: u32, cost: impl Fn(u32, f32) -> f32) -> Vec<u32> {
    (0..count)
        .map(|i| {
            let work = controller.tiers()[controller.tier() as usize - 1].work as f32 / 8000.0;
            controller.record_sample(cost(i, work));
            controller.tier()
        })
        .collect()
}

fn budget(ms: f32) -> TierController {
    TierController::new(
        GiQuality::GpuBudget(Duration::from_micros((1e3 * ms) as u64)),
        tiers(),
    )
}

#[test]
fn tier_is_selected_by_number_or_error() {
    let of = |requested| TierController::new(requested, tiers()).selection();
    assert_eq!(of(GiQuality::Full).tier, 4);
    for (n, tier) in [(0, 1), (1, 1), (3, 3), (9, 4)] {
        let selection = of(GiQuality::Tier(n));
        assert_eq!(selection.tier, tier);
        assert_eq!(selection.reason == "requested", n == tier, "{selection}");
    }
    for (error, tier) in [
        (1.0, 1),
        (0.08, 1),
        (0.06, 2),
        (0.041, 4),
        (0.01, 4),
        (f32::NAN, 4),
    ] {
        let selection = of(GiQuality::MaxError(error));
        assert_eq!(selection.tier, tier, "{error}: {selection}");
        let met = error >= 0.04;
        assert!(selection.reason.starts_with("none") != met, "{selection}");
    }
    // Only a budget uses the measured cost.
    let mut controller = TierController::new(GiQuality::Tier(4), tiers());
    run(&mut controller, 500, |_, _| 1e6);
    assert_eq!((controller.tier(), controller.changes()), (4, 0));
}

#[test]
fn tier_within_budget_stays_full() {
    let mut controller = budget(10.0);
    assert!(controller.selection().reason.contains("not measured"));
    run(&mut controller, 5000, |i, work| (8.0 + noise(i)) * work);
    assert_eq!((controller.tier(), controller.changes()), (4, 0));
    let reason = controller.selection().reason;
    assert!(
        reason.contains("within 10 ms") && reason.contains("no higher"),
        "{reason}"
    );
}

#[test]
fn tier_above_budget_steps_down_once() {
    // 20, 10, 5 and 2.5 ms: the second tier is the highest that fits, with its headroom.
    let mut controller = budget(9.0);
    let seen = run(&mut controller, 20_000, |i, work| {
        20.0 * work * (1.0 + 0.1 * noise(i))
    });
    assert_eq!(
        seen.iter().position(|&t| t < 4),
        Some(LOWER_AFTER_SOLVES as usize - 1)
    );
    assert_eq!((controller.tier(), controller.changes()), (2, 1));
    assert!(
        controller.selection().reason.contains("tier 3 would take"),
        "{}",
        controller.selection()
    );
}

#[test]
fn tier_with_noisy_load_does_not_oscillate() {
    // Means on both sides of every threshold.
    for k in 0..60 {
        let mean = 6.0 + 0.25 * k as f32;
        for spread in [0.1, 0.3, 0.6] {
            let mut controller = budget(10.0);
            let cost = |i: u32, work| mean * work * (1.0 + spread * noise(i + 7919 * k));
            run(&mut controller, 20_000, cost);
            // log2(20 000 / 60) attempts, each up and down, and the first way down.
            assert!(
                controller.changes() <= 20,
                "{mean} ± {spread}: {}",
                controller.changes()
            );
        }
    }
}

#[test]
fn tier_follows_load_steps_both_ways() {
    let mut controller = budget(10.0);
    let load = |i: u32| if (2000..6000).contains(&i) { 30.0 } else { 7.0 };
    let seen = run(&mut controller, 12_000, |i, work| {
        load(i) * work * (1.0 + 0.2 * noise(i))
    });
    assert_eq!((seen[1999], seen[11_999]), (4, 4));
    // 30, 15, 7.5 ms: the third tier from above, without steps.
    assert!(
        seen[2010..6000].iter().all(|&t| t == 2),
        "{:?}",
        &seen[2000..2020]
    );
    assert!(controller.changes() <= 4, "{}", controller.changes());
    let over = (0..12_000)
        .filter(|&i| load(i) * tiers()[seen[i as usize] as usize - 1].work as f32 / 8000.0 > 10.0);
    assert!(over.count() <= LOWER_AFTER_SOLVES as usize);
}

#[test]
fn tier_trials_after_wrong_prediction_become_rare() {
    // No tier fits, because the cost does not depend on the links: down, and never up.
    let mut controller = budget(4.0);
    run(&mut controller, 5000, |_, work| 5.0 + 0.1 * work);
    assert_eq!(controller.tier(), 1);
    assert!(controller.changes() <= 3 && controller.selection().reason.contains("over 4 ms"));
    // Most of the cost does not depend on the links. After the first step down, the controller can
    // raise the tier until it fits.
    let mut controller = budget(10.0);
    let load = |i: u32| if i < 500 { 9.0 } else { 4.0 };
    run(&mut controller, 2000, |i, work| load(i) + 3.0 * work);
    assert_eq!(
        (controller.tier(), controller.changes() <= 5),
        (4, true),
        "{}",
        controller.changes()
    );
    // All links cost three times the prediction from half of them.
    let mut controller = budget(10.0);
    let seen = run(&mut controller, 100_000, |_, work| {
        if work == 1.0 { 12.0 } else { 4.0 * work }
    });
    assert!(
        controller.changes() <= 2 * 11 + 1,
        "{}",
        controller.changes()
    );
    let high = seen.iter().filter(|&&t| t == 4).count();
    assert!(high < 200, "{high} solves over the budget");
}

#[test]
fn tier_ignores_spikes_and_invalid_times() {
    let mut controller = budget(10.0);
    run(&mut controller, 3000, |i, work| match i % 10 {
        3 => 60.0,
        5 => f32::NAN,
        7 => f32::INFINITY,
        8 => -1.0,
        _ => 5.0 * work,
    });
    assert_eq!((controller.tier(), controller.changes()), (4, 0));
    for extreme in [Duration::MAX, Duration::ZERO] {
        let mut controller = TierController::new(GiQuality::GpuBudget(extreme), tiers());
        run(&mut controller, 100, |_, _| 5.0);
        assert_eq!(controller.tier() == 1, extreme.is_zero(), "{extreme:?}");
    }
}

#[test]
fn tier_above_links_is_named_octree() {
    let mut all = tiers();
    all[3].octree = true;
    let selection = TierController::new(GiQuality::Full, all.clone()).selection();
    assert!(
        selection
            .to_string()
            .starts_with("tier 4 of 4, the octree: ")
    );
    let mut controller = TierController::new(GiQuality::GpuBudget(Duration::from_millis(5)), all);
    run(&mut controller, 20, |_, work| 8.0 * work);
    let text = controller.selection().to_string();
    assert!(text.starts_with("tier 3 of 4: "), "{text}");
    assert!(
        text.ends_with("tier 4, the octree, would take 8.00 ms"),
        "{text}"
    );
}

#[test]
fn bake_without_tiers_has_single_tier() {
    let mut controller =
        TierController::new(GiQuality::GpuBudget(Duration::from_millis(1)), Vec::new());
    controller.record_sample(f32::NAN);
    assert_eq!((controller.tier(), controller.selection().tiers), (1, 1));
    let one = vec![TierCandidate {
        work: 0,
        error: 0.1,
        octree: false,
    }];
    let mut controller = TierController::new(GiQuality::GpuBudget(Duration::from_millis(1)), one);
    (0..100).for_each(|_| controller.record_sample(5.0));
    assert_eq!((controller.tier(), controller.changes()), (1, 0));
}

//! Tests of `lights`.

use super::*;

const BOX: Bounds = Bounds {
    min: Vec3::ZERO,
    max: Vec3::splat(10.0),
};

fn light_source(x: f32, color: f32) -> Vec<FrameLight> {
    vec![FrameLight::point(
        Vec3::new(x, 1.0, 1.0),
        Vec3::splat(color),
        20.0,
    )]
}

fn settle(table: &mut SlotTable, changes: &[SlotChange]) {
    let moved: Vec<u32> = (0..changes.len())
        .filter(|&i| changes[i] == SlotChange::Geometry)
        .map(|i| i as u32)
        .collect();
    table.mark_projected(&moved);
    table.mark_applied();
}

#[test]
fn light_keeps_slot_while_others_change() {
    use SlotChange::{Color, Geometry, None};
    let mut table = SlotTable::new();
    let first = table.update(
        &[(9, light_source(1.0, 1.0)), (4, light_source(2.0, 1.0))],
        BOX,
    );
    assert_eq!(first.changes, [Geometry, Geometry]);
    settle(&mut table, &first.changes);
    // Light 9 is removed: its slot is free, and the transport still includes its light.
    let second = table.update(&[(4, light_source(2.0, 1.0))], BOX);
    assert_eq!((second.changes, second.stale), (vec![None, None], true));
    assert_eq!(
        table.lights(),
        [FrameLight::default(), light_source(2.0, 1.0)[0]]
    );
    table.mark_applied();
    // Light 5 takes the free slot. Light 4 changes color in its own.
    let third = table.update(
        &[(4, light_source(2.0, 3.0)), (5, light_source(3.0, 1.0))],
        BOX,
    );
    assert_eq!((third.changes, third.stale), (vec![Geometry, Color], false));
}

#[test]
fn accumulated_light_drift_triggers_projection() {
    let mut table = SlotTable::new();
    let start = table.update(&[(1, light_source(1.0, 1.0))], BOX);
    settle(&mut table, &start.changes);
    let mut moved = 0;
    for i in 1..=100 {
        let slots = table.update(&[(1, light_source(1.0 + 2e-5 * i as f32, 1.0))], BOX);
        if slots.changes == [SlotChange::Geometry] {
            moved += 1;
            settle(&mut table, &slots.changes);
        }
    }
    // 2 mm in total, in steps of 0.17 mm.
    assert!((8..=13).contains(&moved), "projected {moved} times");
}

#[test]
fn moving_dark_light_is_not_projected() {
    let mut table = SlotTable::new();
    let on = table.update(&[(1, light_source(1.0, 1.0))], BOX);
    settle(&mut table, &on.changes);
    let off = table.update(&[(1, light_source(1.0, 0.0))], BOX);
    assert_eq!(off.changes, [SlotChange::Color]);
    settle(&mut table, &off.changes);
    assert_eq!(
        table.update(&[(1, light_source(4.0, 0.0))], BOX).changes,
        [SlotChange::None]
    );
    assert_eq!(
        table.lights(),
        [light_source(1.0, 0.0)[0]],
        "the geometry of its projection"
    );
    // At the old position the projection is valid, elsewhere it is not.
    assert_eq!(
        table.update(&[(1, light_source(1.0, 1.0))], BOX).changes,
        [SlotChange::Color]
    );
    assert_eq!(
        table.update(&[(1, light_source(4.0, 1.0))], BOX).changes,
        [SlotChange::Geometry]
    );
    // A light out of reach is dark, and so is one without a kind.
    assert_eq!(
        table.update(&[(1, light_source(400.0, 1.0))], BOX).changes,
        [SlotChange::None]
    );
    assert_eq!(
        table
            .update(&[(1, vec![FrameLight::default()])], BOX)
            .changes,
        [SlotChange::None]
    );
}

#[test]
fn initially_dark_light_is_projected_when_lit() {
    let mut table = SlotTable::new();
    let dark = table.update(
        &[(1, light_source(1.0, 0.0)), (2, light_source(2.0, 1.0))],
        BOX,
    );
    assert_eq!(dark.changes, [SlotChange::None, SlotChange::Geometry]);
    // A dark slot is not projected, even if all slots are marked as projected.
    assert_eq!(table.lights()[0], FrameLight::default());
    table.mark_projected(&[0, 1]);
    table.mark_applied();
    let lit = table.update(
        &[(1, light_source(1.0, 1.0)), (2, light_source(2.0, 1.0))],
        BOX,
    );
    assert_eq!(lit.changes, [SlotChange::Geometry, SlotChange::None]);
}

#[test]
fn trailing_slots_are_removed_with_lights() {
    let all: Vec<(u64, Vec<FrameLight>)> = (0..100).map(|k| (k, light_source(1.0, 1.0))).collect();
    let mut table = SlotTable::new();
    let first = table.update(&all, BOX);
    settle(&mut table, &first.changes);
    for _ in 0..2 {
        // Until the transport has run, it is out of date.
        let fewer = table.update(&all[..3], BOX);
        assert_eq!((fewer.changes.len(), fewer.stale), (3, true));
    }
    table.mark_applied();
    assert!(!table.update(&all[..3], BOX).stale);
    let none = table.update(&[], BOX);
    assert_eq!((none.changes.len(), none.stale), (0, true));
}

#[test]
fn color_rounding_is_ignored_until_accumulated() {
    let mut table = SlotTable::new();
    let first = table.update(&[(1, light_source(1.0, 1.0))], BOX);
    settle(&mut table, &first.changes);
    let then = |table: &mut SlotTable, c| table.update(&[(1, light_source(1.0, c))], BOX).changes;
    assert_eq!(then(&mut table, 1.000_005), [SlotChange::None]);
    assert_eq!(then(&mut table, 1.000_02), [SlotChange::Color]);
    assert_eq!(then(&mut table, 0.0), [SlotChange::Color]);
}

#[test]
fn different_lights_have_different_projections() {
    let spot = |direction, inner, range| {
        FrameLight::spot(Vec3::ONE, direction, Vec3::ONE, inner, 0.5, range)
    };
    let base = spot(Vec3::X, 0.2, f32::INFINITY);
    assert!(same_projection(&base, &base, 1e-4));
    let mut brighter = base;
    brighter.color = [7.0; 3];
    assert!(same_projection(&base, &brighter, 1e-4));
    for other in [
        spot(Vec3::Y, 0.2, f32::INFINITY),
        spot(Vec3::X, 0.3, f32::INFINITY),
        spot(Vec3::X, 0.2, 5.0),
        FrameLight::directional(Vec3::X, Vec3::ONE),
    ] {
        assert!(!same_projection(&base, &other, 1e-4));
    }
    assert!(same_projection(
        &spot(Vec3::X, 0.2, 5.0),
        &spot(Vec3::X, 0.2, 5.00005),
        1e-4
    ));
    assert!(!same_projection(
        &spot(Vec3::X, 0.2, 5.0),
        &spot(Vec3::X, 0.2, 5.001),
        1e-4
    ));
}

#[test]
fn changed_soft_shadow_lights_are_detected() {
    let panel = SoftLight::rectangle(Vec3::ONE, Vec3::X, Vec3::Z, Vec3::ONE, 16).with_range(20.0);
    let bulb = SoftLight::sphere(Vec3::Y, 0.1, Vec3::X, 5.0, 16);
    let both = [panel, bulb];
    assert!(same_soft_shadow(&both, &both, 1e-4));
    assert!(!same_soft_shadow(&both, &both[..1], 1e-4), "one removed");
    type Change = fn(&mut SoftLight);
    let changes: [(Change, bool); 7] = [
        (|l| l.center[1] += 5e-5, true),
        (|l| l.center[1] += 5e-4, false),
        (|l| l.u[0] += 0.1, false),
        (|l| l.radius += 0.1, false),
        (|l| l.color[0] *= 1.000_005, true),
        (|l| l.color[0] *= 1.01, false),
        (|l| *l = l.with_range(6.0), false),
    ];
    for (k, (change, alike)) in changes.into_iter().enumerate() {
        for at in 0..2 {
            let mut other = both;
            change(&mut other[at]);
            assert_eq!(same_soft_shadow(&both, &other, 1e-4), alike, "{k} {at}");
        }
    }
    assert!(soft_light_affects(&panel, BOX) && soft_light_affects(&bulb, BOX));
    let black = SoftLight::rectangle(Vec3::ONE, Vec3::X, Vec3::Z, Vec3::ZERO, 16);
    let far = SoftLight::sphere(Vec3::NEG_X * 9.0, 0.1, Vec3::ONE, 5.0, 16);
    for light in [black, far, SoftLight::default()] {
        assert!(!soft_light_affects(&light, BOX));
    }
}

#[test]
fn reset_projects_all_lights() {
    let mut table = SlotTable::new();
    let start = table.update(
        &[(1, light_source(1.0, 1.0)), (2, light_source(2.0, 1.0))],
        BOX,
    );
    settle(&mut table, &start.changes);
    table.reset();
    assert_eq!(
        table
            .update(
                &[(1, light_source(1.0, 1.0)), (2, light_source(2.0, 1.0))],
                BOX
            )
            .changes,
        start.changes
    );
}

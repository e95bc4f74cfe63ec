//! The clock of an example: what moves by itself is where its time says, so that a picture of a
//! time is the same on any machine.

use bevy::prelude::*;
use bevy_meshless_gi::prelude::*;

/// The time of an example. It waits for its light, and stands where a picture of a time is asked
/// for; M stops it and lets it go on.
#[derive(Resource, Clone)]
pub struct Clock {
    /// Now, in the example's own unit.
    pub now: f32,
    /// Units that a second adds.
    speed: f32,
    /// Whether Left and Right turn it back and on.
    by_hand: bool,
    /// Whether it goes.
    pub on: bool,
}

/// Where the clock goes on; what moves by it comes after.
#[derive(SystemSet, Clone, Debug, PartialEq, Eq, Hash)]
pub struct ClockSystems;

impl Clock {
    /// From `start` on, or stopped at a time that was asked for.
    pub fn new(start: f32, speed: f32, at: Option<f32>) -> Self {
        Self {
            now: at.unwrap_or(start),
            speed,
            by_hand: false,
            on: at.is_none(),
        }
    }

    /// Left and Right turn it too.
    pub fn by_hand(self) -> Self {
        Self {
            by_hand: true,
            ..self
        }
    }
}

impl Plugin for Clock {
    fn build(&self, app: &mut App) {
        app.insert_resource(self.clone())
            .add_systems(Update, go_on.in_set(ClockSystems));
    }
}

fn go_on(
    mut clock: ResMut<Clock>,
    baking: Query<(), With<GiBakeProgress>>,
    keys: Res<ButtonInput<KeyCode>>,
    time: Res<Time>,
) {
    if keys.just_pressed(KeyCode::KeyM) {
        clock.on = !clock.on;
    }
    let turned = |key, by: f32| if keys.pressed(key) { by } else { 0.0 };
    let mut speed = match clock.on && baking.is_empty() {
        true => 1.0,
        false => 0.0,
    };
    if clock.by_hand {
        speed += turned(KeyCode::ArrowRight, 3.0) + turned(KeyCode::ArrowLeft, -3.0);
    }
    if speed != 0.0 {
        let by = speed * clock.speed * time.delta_secs();
        clock.now += by;
    }
}

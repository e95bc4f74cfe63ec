//! Clock of an example. Motion depends on its time alone, so that a picture of a time is the same
//! on any machine.

use bevy::prelude::*;
use bevy_meshless_gi::prelude::*;

/// Time of an example. It starts when the light is on, and stops for a picture. M stops and
/// continues it.
#[derive(Resource, Clone)]
pub struct Clock {
    /// Current time, in the example's unit.
    pub now: f32,
    /// Units per second.
    speed: f32,
    /// `true` if Left and Right change the time.
    by_hand: bool,
    /// `true` if the clock runs.
    pub on: bool,
}

/// Set that advances the clock. Systems that depend on it run after it.
#[derive(SystemSet, Clone, Debug, PartialEq, Eq, Hash)]
pub struct ClockSystems;

impl Clock {
    /// Creates a clock that runs from `start`, or stops at `at`.
    pub fn new(start: f32, speed: f32, at: Option<f32>) -> Self {
        Self {
            now: at.unwrap_or(start),
            speed,
            by_hand: false,
            on: at.is_none(),
        }
    }

    /// Lets Left and Right change the time.
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
            .add_systems(Update, advance.in_set(ClockSystems));
    }
}

fn advance(
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

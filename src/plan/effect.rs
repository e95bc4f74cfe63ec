//! [`Effect`]: a row of the table of effects.
//!
//! An effect is a part of the simulation that a scene may or may not need. It reads the
//! [`FrameState`] and adds the passes that it needs to the [`Plan`], each with a reason. Passes run
//! in the order of their stages. No effect reads the passes of another one.
//!
//! The type parameter `R` describes the recording of a pass. The plan never uses it: the caller
//! that owns the table also owns the recorder.

use super::{FrameStage, FrameState, Pass, Plan, Work};

/// Row of the table of effects.
#[derive(Clone, Copy, Debug)]
pub struct Effect<R: 'static> {
    /// Name, as in [`Pass::effect`].
    pub name: &'static str,
    /// Purpose in one sentence.
    pub summary: &'static str,
    /// Adds the passes that this frame needs.
    pub schedule: fn(&FrameState, &mut Plan),
    /// Kinds of passes that the effect adds.
    pub passes: &'static [PassKind<R>],
}

/// Kind of pass: its cost and its recording.
#[derive(Clone, Copy, Debug)]
pub struct PassKind<R: 'static> {
    /// Stage of the passes.
    pub stage: FrameStage,
    /// `true` if such a pass belongs to one view, `false` if all views share it.
    pub per_view: bool,
    /// Scope in which the device's clock times such a pass.
    pub timing: Timing,
    /// Amount of work of a pass, in the unit that its time is proportional to.
    pub work: fn(&FrameState, &Pass) -> Work,
    /// Recorder of such a pass.
    pub record: R,
}

/// Scope in which the device's clock times a kind of pass.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Timing {
    /// No clock times it.
    None,
    /// It is timed as one with the passes of this stage.
    With(FrameStage),
    /// It is timed as one with the passes of this stage, and is part of its scene's solve.
    Solve(FrameStage),
}

impl<R> Effect<R> {
    /// Returns the kind of `pass`. `None` for a pass of another effect.
    #[must_use]
    pub fn kind_of(&self, pass: &Pass) -> Option<&PassKind<R>> {
        let fits = |kind: &&PassKind<R>| {
            self.name == pass.effect
                && kind.stage == pass.stage
                && kind.per_view == pass.view.is_some()
        };
        self.passes.iter().find(fits)
    }
}

/// Returns the kind of `pass` in a table of effects. `None` if no effect of the table adds it.
#[must_use]
pub fn kind_of<'a, R>(effects: &'a [Effect<R>], pass: &Pass) -> Option<&'a PassKind<R>> {
    effects.iter().find_map(|effect| effect.kind_of(pass))
}

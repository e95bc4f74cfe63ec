//! [`EffectStates`]: data on the device that effects hold from one frame to the next, by type.
//!
//! The recorder and the counters treat all states alike. An effect with buffers of its own needs no
//! line outside of its file.

use crate::gpu::GpuCounters;
use crate::plan::{Pass, Plan};
use std::any::{Any, TypeId};
use std::collections::BTreeMap;

/// Data of an effect on the device, of one scene, of one view, or of the whole world.
pub(crate) trait EffectState: Any + Send + Sync {
    /// Returns the number of buffers, and the bytes of buffers and textures.
    fn size(&self) -> (u32, u64);

    /// Returns the counters of the work that the state has recorded. The default is none: the
    /// recording adds its work to the counters of its context.
    fn counters(&self) -> GpuCounters {
        GpuCounters::default()
    }

    /// Returns `true` if a frame in which no pass inserts the state releases it. States of views
    /// are always released then.
    fn is_transient(&self) -> bool {
        false
    }

    /// Returns `true` if a pass uses the state. A state of the world is released in the first frame
    /// without such a pass. The default is `true` for every pass.
    fn is_used_by(&self, _pass: &Pass) -> bool {
        true
    }

    /// Maps buffers that were copied for the CPU, and makes those of the frame available for the
    /// next one. Called after the submission of each frame.
    fn finish_frame(&mut self) {}
}

/// States of the effects, at most one of each type.
#[derive(Default)]
pub(crate) struct EffectStates(BTreeMap<TypeId, Box<dyn EffectState>>);

impl EffectStates {
    /// Returns the state of a type. `None` if there is none.
    pub fn get<T: EffectState>(&self) -> Option<&T> {
        let state: &dyn Any = self.0.get(&TypeId::of::<T>())?.as_ref();
        state.downcast_ref()
    }

    /// Returns the state of a type. `None` if there is none.
    pub fn get_mut<T: EffectState>(&mut self) -> Option<&mut T> {
        let state: &mut dyn Any = self.0.get_mut(&TypeId::of::<T>())?.as_mut();
        state.downcast_mut()
    }

    /// Returns the state of a type, and creates it if there is none.
    pub fn get_or_default<T: EffectState + Default>(&mut self) -> &mut T {
        let entry = self.0.entry(TypeId::of::<T>());
        let state: &mut dyn Any = entry.or_insert_with(|| Box::<T>::default()).as_mut();
        state.downcast_mut().expect("the key is the type")
    }

    /// Removes and returns the state of a type. `None` if there is none.
    pub fn take<T: EffectState>(&mut self) -> Option<T> {
        let state: Box<dyn Any> = self.0.remove(&TypeId::of::<T>())?;
        state.downcast().ok().map(|state| *state)
    }

    /// Stores a state in place of the one of the same type.
    pub fn insert<T: EffectState>(&mut self, state: T) {
        self.0.insert(TypeId::of::<T>(), Box::new(state));
    }

    /// Removes and returns the transient states.
    pub fn take_transient(&mut self) -> Self {
        let all = std::mem::take(&mut self.0);
        let (transient, kept) = all.into_iter().partition(|(_, state)| state.is_transient());
        self.0 = kept;
        Self(transient)
    }

    /// Removes and returns the states that no pass of a plan uses.
    pub fn take_unused(&mut self, plan: &Plan) -> Self {
        let is_used = |state: &dyn EffectState| plan.passes.iter().any(|p| state.is_used_by(p));
        let all = std::mem::take(&mut self.0);
        let (used, unused) = (all.into_iter()).partition(|(_, state)| is_used(state.as_ref()));
        self.0 = used;
        Self(unused)
    }

    /// Returns the number of buffers, and the bytes of buffers and textures.
    pub fn size(&self) -> (u32, u64) {
        let sizes = self.0.values().map(|state| state.size());
        sizes.fold((0, 0), |(n, b), (count, bytes)| (n + count, b + bytes))
    }

    /// Returns the sum of the counters.
    pub fn counters(&self) -> GpuCounters {
        let mut sum = GpuCounters::default();
        for state in self.0.values() {
            sum.add(&state.counters());
        }
        sum
    }

    /// Calls [`EffectState::finish_frame`] of all states.
    pub fn finish_frame(&mut self) {
        for state in self.0.values_mut() {
            state.finish_frame();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plan::{FrameStage, RunReason, SceneId};

    #[derive(Default)]
    struct Kept(u32);

    impl EffectState for Kept {
        fn size(&self) -> (u32, u64) {
            (1, 8)
        }

        fn finish_frame(&mut self) {
            self.0 += 1;
        }
    }

    struct Transient;

    impl EffectState for Transient {
        fn size(&self) -> (u32, u64) {
            (2, 100)
        }

        fn counters(&self) -> GpuCounters {
            GpuCounters {
                fogs: 3,
                ..GpuCounters::default()
            }
        }

        fn is_transient(&self) -> bool {
            true
        }

        fn is_used_by(&self, pass: &Pass) -> bool {
            pass.effect == "fog"
        }
    }

    #[test]
    fn state_without_pass_is_taken() {
        let states = || {
            let mut states = EffectStates::default();
            states.insert(Kept(0));
            states.insert(Transient);
            states
        };
        let taken = |effects: &[&'static str]| {
            let mut plan = Plan::default();
            for effect in effects {
                plan.push(effect, FrameStage::FOG, SceneId(1), RunReason::InView);
            }
            let (mut all, mut unused) = (states(), states().take_unused(&plan));
            let _ = all.take_unused(&plan);
            let is_held = |states: &mut EffectStates| {
                [
                    states.take::<Kept>().is_some(),
                    states.take::<Transient>().is_some(),
                ]
            };
            (is_held(&mut all), is_held(&mut unused))
        };
        assert_eq!(taken(&[]), ([false, false], [true, true]));
        assert_eq!(taken(&["rsm"]), ([true, false], [false, true]));
        assert_eq!(taken(&["rsm", "fog"]), ([true, true], [false, false]));
    }

    #[test]
    fn states_are_found_by_type_and_summed() {
        let mut states = EffectStates::default();
        assert!(states.get::<Kept>().is_none());
        states.get_or_default::<Kept>().0 = 4;
        states.insert(Transient);
        assert_eq!((states.size(), states.counters().fogs), ((3, 108), 3));
        states.finish_frame();
        assert_eq!(states.get_mut::<Kept>().map(|kept| kept.0), Some(5));
        let mut earlier = states.take_transient();
        assert_eq!((states.size(), earlier.size()), ((1, 8), (2, 100)));
        assert!(earlier.take::<Kept>().is_none());
        assert!(earlier.take::<Transient>().is_some());
        assert!(earlier.take::<Transient>().is_none());
    }
}

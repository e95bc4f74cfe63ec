//! Solve with bounces until convergence.

use super::CpuFrame;
use super::transport::{ReceiverSet, octree};
use crate::asset::BakedScene;
use crate::frame::anderson::Anderson;
use crate::frame::{FrameSettings, SceneDimensions, SolveSchedule, pull};

impl CpuFrame {
    /// Solves as [`solve`](Self::solve) does, but with sweeps until convergence. The bounces of
    /// `settings` are ignored. The iteration stops when the contribution of further sweeps is below
    /// `tolerance` times the light. That contribution follows from the bake's bound on the gain of
    /// a reflection. The limit of single precision also stops the iteration. The sweeps are
    /// accelerated: they are not single reflections, but converge to the same result. Returns the
    /// number of sweeps, at most [`MAX_ACCELERATED`](Self::MAX_ACCELERATED).
    pub fn converge(
        &mut self,
        scene: &BakedScene,
        settings: &FrameSettings,
        tolerance: f32,
    ) -> u32 {
        let one = FrameSettings {
            sweeps: 1,
            baked_bounces: false,
            ..*settings
        };
        self.solved = None;
        self.solve(scene, &one);
        let gain = scene.info().energy.spectral_radius_bound;
        let scene = scene.data();
        let shape = SceneDimensions::new(scene);
        let params = shape.params(&one, self.lights.len());
        let steps = SolveSchedule::new(&shape, &one);
        let mut octree = octree(scene, &steps);
        let gain = if gain.is_finite() { gain } else { 1.0 };
        let enough = f64::from(tolerance) * f64::from(1.0 - gain.clamp(0.0, 0.9995));
        // Rounding error of sums of a few hundred links.
        let enough = enough.max(3e-7);
        let finest = params.finest_sender as usize;
        let own: Vec<usize> = (0..scene.senders())
            .filter(|&j| j >= finest || scene.pull.row(j).is_empty())
            .collect();
        // The color channels are independent.
        let mut memory: [Anderson; 3] = Default::default();
        let values = |senders: &[[f32; 4]], c: usize| -> Vec<f32> {
            own.iter().map(|&j| senders[j][c]).collect()
        };
        let mut sweeps = 1;
        let mut x = [0, 1, 2].map(|c| values(&self.senders, c));
        loop {
            self.sweep(scene, &params, &steps, &mut octree);
            sweeps += 1;
            let g = [0, 1, 2].map(|c| values(&self.senders, c));
            let mut change = 0.0f64;
            for ((memory, x), g) in memory.iter_mut().zip(&mut x).zip(&g) {
                change = change.max(memory.step(x, g));
            }
            // The result of the sweep is transported light. The next iterate is only extrapolated.
            if change <= enough || sweeps >= Self::MAX_ACCELERATED {
                break;
            }
            for (c, x) in x.iter_mut().enumerate() {
                for (&j, x) in own.iter().zip(x) {
                    *x = x.max(0.0);
                    self.senders[j][c] = *x;
                }
            }
            for level in &steps.pull {
                pull::pull(&scene.pull, level.clone(), &mut self.senders);
            }
        }
        self.transport(scene, &params, &steps, &mut octree, ReceiverSet::All);
        self.transport_to_probes(scene, &params, &steps);
        // The result differs from that of any plain solve.
        self.solved = None;
        self.counters.sweeps += u64::from(sweeps - 1);
        sweeps
    }

    /// Maximum number of sweeps of [`converge`](Self::converge).
    pub const MAX_ACCELERATED: u32 = 200;
}

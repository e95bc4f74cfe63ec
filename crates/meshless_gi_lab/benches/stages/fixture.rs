//! Set-up of the benches: a baked scene, and the input of the transport stages.

use glam::{Vec3, Vec3A};
use meshless_gi::internals::bake::{BakeSettings, reached_area};
use meshless_gi::internals::basis::{Hierarchy, HierarchySettings, Weights};
use meshless_gi::internals::frame::project;
use meshless_gi::internals::samples::find_viewpoints;
use meshless_gi::internals::transport::bounded_truncation::{CutMeasure, CutScratch, cut_row};
use meshless_gi::internals::transport::{
    Deposit, GatherScene, GatherSettings, Gathered, RawRow, SenderTree, TRAINING_LIGHTS, Training,
    gather,
};
use meshless_gi::{
    BakedScene, FrameLight, Preset, Progress, Quad, Recipe, TriangleMesh, bake_scene,
};
use rayon::prelude::*;

/// Overlap of the senders' functions in a bake of method `bounded`.
const SENDER_OVERLAP: f32 = 1.25;

/// Scene, bake and points that the benches share.
pub struct Fixture {
    /// Geometry of the Cornell box.
    pub mesh: TriangleMesh,
    /// Its bake at preset `Draft`.
    pub scene: BakedScene,
    /// Settings of that bake.
    pub settings: BakeSettings,
    /// Points before refinement.
    pub hierarchy: Hierarchy,
    /// Parents of the points.
    pub parents: Weights,
    /// Sender hierarchy as a tree.
    pub tree: SenderTree,
    /// Radiosity under training lights.
    pub training: Training,
    /// Truncated rows of the points.
    pub rows: Vec<RawRow>,
    /// Sky visibility of the points.
    pub sky: Vec<Vec3>,
}

impl Fixture {
    /// Bakes the Cornell box.
    pub fn new() -> Self {
        let mesh = TriangleMesh::from_quads(&Quad::cornell_box());
        let recipe = Recipe {
            preset: Preset::Draft,
            ..Recipe::default()
        };
        let baked = bake_scene(&mesh, &recipe, 0, &Progress::default()).expect("a bake");
        let (viewpoints, _) = find_viewpoints(&mesh, recipe.seed);
        let (area, _) = reached_area(&mesh, &viewpoints, false, recipe.seed);
        let settings = recipe.settings(area).expect("settings");
        let building = HierarchySettings {
            coarse_radius: settings.coarse_radius,
            levels: settings.levels as usize,
            sender_levels: settings.sender_levels as usize,
            max: settings.max_points(),
            seed: settings.seed,
            sender_overlap: Some(SENDER_OVERLAP),
            clip: settings.clip_planes,
            drop_first: false,
            separate_emitters: true,
        };
        let hierarchy =
            Hierarchy::build(&mesh, &viewpoints, &building, &|_| true).expect("not canceled");
        let starts = &hierarchy.level_starts[..=settings.sender_levels as usize];
        let tree = SenderTree::new(&hierarchy.tree(), starts);
        let training = train(&baked.scene, &hierarchy, &tree);
        let mut fixture = Self {
            scene: baked.scene,
            parents: hierarchy.parents(false),
            mesh,
            settings,
            hierarchy,
            tree,
            training,
            rows: Vec::new(),
            sky: Vec::new(),
        };
        (fixture.rows, fixture.sky) = fixture.gather_rows();
        fixture
    }

    /// Returns the number of senders.
    pub fn senders(&self) -> usize {
        self.tree.parent.len()
    }

    /// Returns the input of a gather.
    pub fn gather_scene(&self) -> GatherScene<'_> {
        let settings = GatherSettings {
            geometry: &self.mesh,
            sender_levels: self.settings.sender_levels as usize,
            rays: self.settings.rays_per_point,
            seed: self.settings.seed,
            deposit: Deposit::Finest,
        };
        settings.scene(&self.hierarchy)
    }

    /// Returns the error measure of truncation.
    pub fn measure(&self) -> CutMeasure<'_> {
        CutMeasure {
            training: &self.training,
            epsilon: self.settings.truncation_error,
        }
    }

    /// Returns the truncated rows and the sky visibility of all points.
    fn gather_rows(&self) -> (Vec<RawRow>, Vec<Vec3>) {
        let scene = self.gather_scene();
        (0..self.hierarchy.len())
            .into_par_iter()
            .map_init(
                || (Gathered::new(self.senders()), CutScratch::default()),
                |(gathered, scratch), i| {
                    gather(&scene, i, gathered);
                    let n = self.normal(i);
                    let sky: Vec3 = gathered.sky.into();
                    let links = cut_row(gathered, &self.tree, n, &self.measure(), scratch);
                    let row = RawRow {
                        links,
                        active: true,
                        ..RawRow::default()
                    };
                    (row, sky)
                },
            )
            .unzip()
    }

    /// Returns the normal of point `i` of the hierarchy.
    pub fn normal(&self, i: usize) -> Vec3A {
        self.hierarchy.surfaces[i].normal.into()
    }
}

/// Returns point light `k`, on a helix in the box above its blocks.
pub fn light(k: usize) -> FrameLight {
    let angle = 2.4 * k as f32;
    let height = 1.3 + 0.5 * (k % TRAINING_LIGHTS) as f32 / TRAINING_LIGHTS as f32;
    let position = Vec3::new(0.7 * angle.cos(), height, 0.7 * angle.sin());
    FrameLight::point(position, Vec3::ONE, 20.0)
}

/// Computes the direct light of the training lights at every sender, relative to the root mean
/// square of each light.
fn train(scene: &BakedScene, hierarchy: &Hierarchy, tree: &SenderTree) -> Training {
    let extent = project::extent(scene.data());
    let surfaces = &hierarchy.surfaces[..tree.parent.len()];
    let mut signals = vec![[0.0; TRAINING_LIGHTS]; surfaces.len()];
    for t in 0..TRAINING_LIGHTS {
        let light = light(t);
        for (signal, s) in signals.iter_mut().zip(surfaces) {
            signal[t] =
                project::project_at(&scene.data().bvh, extent, &light, s.position, s.normal);
        }
        let square: f32 = signals.iter().map(|s| s[t] * s[t]).sum();
        let root = (square / surfaces.len() as f32).sqrt();
        assert!(root > 0.0, "training light {t} reaches no sender");
        signals.iter_mut().for_each(|s| s[t] /= root);
    }
    let exposure = signals
        .iter()
        .map(|s| s.iter().map(|f| f * f).sum::<f32>() / TRAINING_LIGHTS as f32)
        .collect();
    Training::new(signals, exposure, 0.0, tree)
}

//! Scenes and views for what is measured of subsplats: by the tests, and by the example that writes docs/SUBSPLATS.md.
#![allow(dead_code, reason = "test and example each use their part")]

mod clutter;

pub use clutter::clutter;

use bevy_meshless_gi::accuracy::{DrawnView, Image, errors, flip};
use bevy_meshless_gi::asset::BakedScene;
use bevy_meshless_gi::frame::pyramid::Picture;
use bevy_meshless_gi::frame::subsplat::{LUMINANCE, state};
use bevy_meshless_gi::frame::{
    CpuFrame, FrameLight, FrameSettings, GridShape, Node, SplatParams, SubsplatCounts,
    SubsplatParams, SubsplatSettings, Subsplats, VectorIrradiance, gbuffer, splat, subsplats,
};
use bevy_meshless_gi::scene::{Light, SceneDescription, SceneError, TriangleMesh, load_gltf};
use glam::{Mat4, Vec3};
use rayon::prelude::*;
use std::f32::consts::FRAC_1_PI;
use std::path::Path;
use std::time::Instant;

/// Patches of a rectangle light.
const PATCHES: u32 = 64;
/// Mean luminance that pictures are exposed to.
const EXPOSED: f32 = 0.18;
/// Near plane, metres.
const NEAR: f32 = 0.1;
/// Vertical angle of view, radians.
const ANGLE: f32 = 1.0;

/// A level: geometry and lamps.
pub struct Level {
    pub name: String,
    pub mesh: TriangleMesh,
    pub lights: Vec<Light>,
    /// Where three pictures are taken: eye and target, metres.
    pub views: [(Vec3, Vec3); 3],
}

impl Level {
    /// A folder with `L0.json`; None where no views of a folder of this name are known.
    pub fn read(folder: &Path) -> Result<Option<Self>, SceneError> {
        let name = folder.file_name().unwrap_or_default();
        let name = name.to_string_lossy().into_owned();
        let v = Vec3::new;
        let views = match name.as_str() {
            "cornell" => [
                (v(2.78, 2.73, -4.5), v(2.78, 2.73, 2.8)),
                (v(4.6, 4.2, 0.3), v(1.4, 0.6, 4.6)),
                (v(0.5, 1.0, 0.4), v(4.4, 1.4, 4.6)),
            ],
            "rooms_open" => [
                (v(0.4, 1.7, 0.3), v(4.5, 1.0, 2.4)),
                (v(7.5, 1.7, 3.3), v(3.6, 0.8, 1.7)),
                (v(2.4, 1.6, 2.0), v(6.5, 1.2, 2.0)),
            ],
            "sponza" => [
                (v(-9.0, 2.0, 0.3), v(8.0, 4.0, 0.0)),
                (v(6.0, 6.5, -4.6), v(-4.0, 6.0, 1.0)),
                (v(3.0, 1.6, 3.0), v(-3.0, 2.0, 5.5)),
            ],
            _ => return Ok(None),
        };
        let description = SceneDescription::read(folder.join("L0.json"))?;
        Ok(Some(Self {
            name,
            mesh: load_gltf(&description.geometry[0])?.mesh,
            lights: description.lights,
            views,
        }))
    }
}

/// Where light comes from.
pub enum Source {
    /// A bake under the level's lamps, solved.
    Baked(Box<BakedScene>, Vec<VectorIrradiance>),
    /// Made up: the light at a place.
    Made(fn(Vec3) -> VectorIrradiance),
}

/// A level and its light.
pub struct Stage {
    pub level: Level,
    pub source: Source,
}

/// Light of this colour that comes from one direction.
pub fn from(direction: Vec3, colour: Vec3) -> VectorIrradiance {
    let d = direction.normalize();
    let axis = |part: f32| (part * colour).extend(0.0).to_array();
    VectorIrradiance {
        x: axis(d.x),
        y: axis(d.y),
        z: axis(d.z),
    }
}

impl Stage {
    pub fn new(level: Level, scene: BakedScene) -> Self {
        let lights: Vec<FrameLight> = level
            .lights
            .iter()
            .flat_map(|light| FrameLight::expand(light, PATCHES))
            .collect();
        let mut frame = CpuFrame::new(&scene);
        frame.set_lights(&scene, &lights);
        frame.solve(&scene, &FrameSettings::default());
        let values = frame.values().to_vec();
        Self {
            level,
            source: Source::Baked(Box::new(scene), values),
        }
    }

    /// A level with light that nobody computed.
    pub fn made(name: &str, mesh: TriangleMesh, light: fn(Vec3) -> VectorIrradiance) -> Self {
        Self {
            level: Level {
                name: name.into(),
                mesh,
                lights: Vec::new(),
                views: [(Vec3::ZERO, Vec3::NEG_Z); 3],
            },
            source: Source::Made(light),
        }
    }

    /// One of the level's own views.
    pub fn view(&self, i: usize, size: [u32; 2]) -> View<'_> {
        let (eye, target) = self.level.views[i];
        View::new(self, eye, target, size)
    }
}

/// A drawn view of a stage.
pub struct View<'a> {
    pub stage: &'a Stage,
    pub drawn: DrawnView,
    pub view_from_clip: Mat4,
    pub view_from_world: Mat4,
    pub splat: SplatParams,
    /// What full resolution shows.
    pub full: Vec<[f32; 4]>,
}

/// What subsplats show, beside full resolution.
#[derive(Clone, Copy, Debug)]
pub struct Measured {
    pub counts: SubsplatCounts,
    /// Mean FLIP of the two pictures of indirect light.
    pub flip: f32,
    /// Root mean square difference of the irradiance over the root mean square irradiance.
    pub nrmse: f64,
}

impl Measured {
    /// Evaluations over pixels.
    pub fn share(&self) -> f64 {
        f64::from(self.counts.total()) / f64::from(self.counts.pixels)
    }
}

impl<'a> View<'a> {
    pub fn new(stage: &'a Stage, eye: Vec3, target: Vec3, size: [u32; 2]) -> Self {
        let clip_from_world = DrawnView::perspective(eye, target, Vec3::Y, ANGLE, size, NEAR);
        Self::of(
            stage,
            Mat4::look_at_rh(eye, target, Vec3::Y),
            clip_from_world,
            size,
        )
    }

    /// A view with these matrices, exposed so that the mean luminance of its indirect light is [`EXPOSED`].
    pub fn of(
        stage: &'a Stage,
        view_from_world: Mat4,
        clip_from_world: Mat4,
        size: [u32; 2],
    ) -> Self {
        let drawn = DrawnView::new(&stage.level.mesh, clip_from_world, size);
        let mut view = Self {
            stage,
            view_from_clip: view_from_world * drawn.world_from_clip,
            view_from_world,
            splat: SplatParams::new(
                drawn.world_from_clip,
                Mat4::IDENTITY,
                [0.0, 0.0, size[0] as f32, size[1] as f32],
                size,
                1.0,
                match &stage.source {
                    Source::Baked(scene, _) => GridShape::from(&scene.display.grid),
                    Source::Made(_) => GridShape {
                        slot_mask: 0,
                        cell_size: 1.0,
                    },
                },
            ),
            drawn,
            full: Vec::new(),
        };
        view.full = view.at_full_resolution();
        let (mut sum, mut count) = (0.0, 0);
        for (colour, texel) in view.colours(&view.full).zip(&view.full) {
            sum += f64::from(LUMINANCE.dot(colour));
            count += usize::from(texel[3] > 0.0);
        }
        let mean = (sum / count.max(1) as f64) as f32;
        view.expose(if mean > 0.0 { EXPOSED / mean } else { 1.0 });
        view
    }

    /// Sets the scale.
    pub fn expose(&mut self, scale: f32) {
        self.splat.scale = scale;
        self.full = self.at_full_resolution();
    }

    /// Every pixel evaluated by itself.
    pub fn at_full_resolution(&self) -> Vec<[f32; 4]> {
        let [width, height] = self.drawn.size;
        (0..width * height)
            .into_par_iter()
            .map(|i| self.pixel([i % width, i / width]))
            .collect()
    }

    /// A pixel evaluated by itself.
    pub fn pixel(&self, pixel: [u32; 2]) -> [f32; 4] {
        let i = self.index(pixel);
        let texel = self.drawn.gbuffer[i];
        // 0 where nothing is to be lit.
        let depth = self.picture().depth(self.drawn.size, pixel);
        match &self.stage.source {
            Source::Baked(scene, values) => {
                splat::splat_pixel(&self.splat, scene, values, pixel, depth, texel)
            }
            Source::Made(_) if depth <= 0.0 => [0.0; 4],
            Source::Made(light) => {
                let (x, n) = splat::place(&self.splat, pixel, depth, texel);
                let e = light(x).dot(n).max(Vec3::ZERO);
                (self.splat.scale * e).extend(1.0).to_array()
            }
        }
    }

    pub fn index(&self, [x, y]: [u32; 2]) -> usize {
        (y * self.drawn.size[0] + x) as usize
    }

    pub fn picture(&self) -> Picture<'_> {
        Picture {
            depth: &self.drawn.depth,
            gbuffer: &self.drawn.gbuffer,
        }
    }

    pub fn params(&self, settings: &SubsplatSettings) -> SubsplatParams {
        let size = self.drawn.size;
        let viewport = [0.0, 0.0, size[0] as f32, size[1] as f32];
        SubsplatParams::new(
            settings,
            self.view_from_clip,
            self.view_from_world,
            viewport,
            size,
        )
    }

    /// The light of a node.
    pub fn evaluate(&self, pixel: [u32; 2], node: &mut Node) {
        let i = self.index(pixel);
        let texel = self.drawn.gbuffer[i];
        // 0 where nothing is to be lit.
        let depth = self.picture().depth(self.drawn.size, pixel);
        match &self.stage.source {
            Source::Baked(scene, values) => {
                splat::splat_node(&self.splat, scene, values, pixel, depth, texel, node);
            }
            Source::Made(_) if depth <= 0.0 => {
                *node = Node::new(&VectorIrradiance::default(), 0.0, state::EVALUATED);
            }
            Source::Made(light) => {
                let (x, _) = splat::place(&self.splat, pixel, depth, texel);
                let mut scaled = VectorIrradiance::default();
                scaled.add_scaled(self.splat.scale, &light(x));
                let all = state::EVALUATED | state::KNOWN | state::COVERED;
                *node = Node::new(&scaled, node.foretold(), all);
            }
        }
    }

    pub fn subsplats(&self, settings: &SubsplatSettings) -> Subsplats {
        subsplats(&self.params(settings), &self.picture(), &|pixel, node| {
            self.evaluate(pixel, node);
        })
    }

    pub fn measure(&self, settings: &SubsplatSettings) -> Measured {
        let shown = self.subsplats(settings);
        self.compare(&shown.texels, shown.counts)
    }

    /// `texels` beside full resolution.
    pub fn compare(&self, texels: &[[f32; 4]], counts: SubsplatCounts) -> Measured {
        let rgb = |texels: &[[f32; 4]]| -> Vec<Vec3> {
            texels.iter().map(|t| Vec3::new(t[0], t[1], t[2])).collect()
        };
        let exact = vec![Vec3::ZERO; texels.len()];
        Measured {
            counts,
            flip: flip(&self.image(&self.full), &self.image(texels)),
            nrmse: errors(&rgb(texels), &rgb(&self.full), &exact).nrmse,
        }
    }

    /// Indirect light of each pixel as the camera gets it, exposed.
    fn colours<'b>(&'b self, texels: &'b [[f32; 4]]) -> impl Iterator<Item = Vec3> + 'b {
        texels
            .iter()
            .zip(&self.drawn.gbuffer)
            .map(|(t, &texel)| FRAC_1_PI * gbuffer::diffuse(texel) * Vec3::new(t[0], t[1], t[2]))
    }

    /// The picture of indirect light, with a tone curve.
    pub fn image(&self, texels: &[[f32; 4]]) -> Image {
        Image {
            width: self.drawn.size[0],
            height: self.drawn.size[1],
            pixels: self
                .colours(texels)
                .map(|c| 1.25 * c / (Vec3::ONE + c))
                .collect(),
        }
    }

    /// Seconds of full resolution on one thread, the lesser of two runs.
    pub fn full_seconds(&self) -> f64 {
        seconds(&|| {
            std::hint::black_box(self.at_full_resolution());
        })
    }

    /// The same of subsplats.
    pub fn few_seconds(&self, settings: &SubsplatSettings) -> f64 {
        seconds(&|| {
            std::hint::black_box(self.subsplats(settings));
        })
    }
}

fn seconds(run: &(dyn Fn() + Sync)) -> f64 {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build();
    let pool = pool.expect("one thread");
    let one = || {
        let began = Instant::now();
        pool.install(run);
        began.elapsed().as_secs_f64()
    };
    one().min(one())
}

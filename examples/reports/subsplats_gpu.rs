//! Times of multiresolution splatting and of every pixel on the device at 1920 × 1080, for the
//! views of docs/reports/subsplats.md. Then [N09] Fig. 14: virtual point lights at several
//! resolutions. Prints tables with the name of the adapter.
//!
//! ```text
//! cargo run --release --example subsplats_gpu -- [--bakes FOLDER] [LEVEL_FOLDER...]
//! ```
//!
//! Without a folder, only the cluttered room at `Draft` is measured. `FOLDER/NAME.mgi` replaces a
//! bake. Each time is the minimum of several submissions.

#[path = "../../tests/twins/depth.rs"]
mod depth;
use meshless_gi_lab::fixtures::TestScene;
use meshless_gi_lab::fixtures::subsplats as subsplat_support;

use bevy_meshless_gi::gpu::{GpuFrame, HeadlessDevice, KernelPipelines};
use bevy_meshless_gi::internals::gpu::{
    EntryPoint, NodeLights, RsmBuffers, SplatTargets, SubsplatBuffers, SubsplatTargets, ViewBuffers,
};
use half::f16;
use meshless_gi::internals::frame::{
    CompositeParams, VectorIrradiance, Vpl, VplParams, VplViewParams, splat,
};
use meshless_gi::{BakedScene, Limits, Preset, Progress, Recipe, SubsplatSettings, bake_scene};
use std::error::Error;
use std::path::{Path, PathBuf};
use std::time::Instant;
use subsplat_support::{LitScene, Source, View, clutter};
use wgpu::{BufferUsages, TextureFormat, TextureUsages, TextureViewDescriptor};

const SIZE: [u32; 2] = [1920, 1080];
/// Number of submissions. The minimum time counts.
const RUNS: usize = 3;

fn main() -> Result<(), Box<dyn Error>> {
    let usage = "usage: subsplats_gpu [--bakes FOLDER] [LEVEL_FOLDER...]";
    let (mut bakes, mut scenes) = (None, vec![clutter()]);
    let mut args = std::env::args().skip(1);
    while let Some(arg) = args.next() {
        match arg.as_str() {
            "--bakes" => bakes = Some(PathBuf::from(args.next().ok_or(usage)?)),
            _ => {
                let scene = TestScene::read(arg.as_ref())?;
                scenes.push(scene.ok_or_else(|| format!("{arg}: the test scene has no views"))?);
            }
        }
    }
    let harness = HeadlessDevice::new()?;
    println!("{}\n", harness.adapter);
    println!(
        "| scene | view | subsplats | one of … pixels | every pixel, ms | subsplats, ms | ratio | NRMSE |"
    );
    println!("|---|---|---|---|---|---|---|---|");
    let mut first = None;
    for scene in scenes {
        let baked = bake(&scene, bakes.as_deref())?;
        let stage = LitScene::new(scene, baked);
        for i in 0..3 {
            let view = stage.view(i, SIZE);
            row(&harness, &view, i)?;
        }
        first.get_or_insert(stage);
    }
    let Some(stage) = first else { return Ok(()) };
    let view = stage.view(0, SIZE);
    println!(
        "\nVirtual point lights on {}, without shadows: milliseconds (and over those at every pixel).\n",
        stage.scene.name
    );
    println!("| lights | 16 pixels | 8 pixels | 4 pixels | 2 pixels | every pixel |");
    println!("|---|---|---|---|---|---|");
    for lights in [16, 64, 256] {
        lit(&harness, &view, lights)?;
    }
    Ok(())
}

fn bake(scene: &TestScene, bakes: Option<&Path>) -> Result<BakedScene, Box<dyn Error>> {
    let file = bakes.map(|folder| folder.join(format!("{}.mgi", scene.name)));
    if let Some(file) = file.as_deref().filter(|f| f.exists()) {
        return Ok(BakedScene::read(file, &Limits::default())?);
    }
    let recipe = Recipe {
        preset: Preset::Draft,
        ..Recipe::default()
    };
    Ok(bake_scene(&scene.mesh, &recipe, 0, &Progress::default())?.scene)
}

/// Textures of a view on the device.
struct Textures {
    depth: wgpu::TextureView,
    gbuffer: wgpu::TextureView,
    output: wgpu::Texture,
    target: wgpu::TextureView,
}

impl Textures {
    fn new(harness: &HeadlessDevice, view: &View<'_>) -> Self {
        let look = |t: &wgpu::Texture| t.create_view(&TextureViewDescriptor::default());
        let gbuffer = harness.texture(
            SIZE,
            TextureFormat::Rgba32Uint,
            TextureUsages::TEXTURE_BINDING,
            Some(&view.drawn.gbuffer),
        );
        let output = harness.texture::<[f16; 4]>(
            SIZE,
            TextureFormat::Rgba16Float,
            TextureUsages::STORAGE_BINDING | TextureUsages::COPY_SRC,
            None,
        );
        Self {
            depth: look(&depth::depth_texture(harness, SIZE, &view.drawn.depth)),
            gbuffer: look(&gbuffer),
            target: look(&output),
            output,
        }
    }

    fn targets(&self) -> SubsplatTargets<'_> {
        SubsplatTargets {
            depth: &self.depth,
            gbuffer: &self.gbuffer,
            output: &self.target,
        }
    }

    fn every_pixel(&self) -> SplatTargets<'_> {
        SplatTargets {
            depth: &self.depth,
            gbuffer: &self.gbuffer,
            earlier: None,
            output: &self.target,
        }
    }

    fn read(&self, harness: &HeadlessDevice) -> Result<Vec<f32>, Box<dyn Error>> {
        let texels: Vec<[f16; 4]> = harness.read_texture(&self.output)?;
        Ok(texels
            .iter()
            .flat_map(|t| [t[0], t[1], t[2]].map(f16::to_f32))
            .collect())
    }
}

/// Returns the minimum milliseconds of [`RUNS`] submissions, after one warm-up.
fn time(
    harness: &HeadlessDevice,
    mut record: impl FnMut(&mut wgpu::CommandEncoder),
) -> Result<f64, Box<dyn Error>> {
    harness.run(&mut record)?;
    let mut min = f64::INFINITY;
    for _ in 0..RUNS {
        let began = Instant::now();
        harness.run(&mut record)?;
        min = min.min(began.elapsed().as_secs_f64());
    }
    Ok(1000.0 * min)
}

/// Returns the evaluations of the last frame by the device's counters.
fn evaluated(harness: &HeadlessDevice, buffers: &SubsplatBuffers) -> Result<u32, Box<dyn Error>> {
    let levels = buffers.levels();
    let mut sum = 0;
    for k in 0..=levels.coarsest_level {
        let count: Vec<u32> = harness.read(buffers.count_of(k), 8)?;
        sum += count[3].min(levels.cells(k)) - count[4];
    }
    Ok(sum)
}

fn row(harness: &HeadlessDevice, view: &View<'_>, i: usize) -> Result<(), Box<dyn Error>> {
    let Source::Baked(scene, values) = &view.stage.source else {
        return Err("only baked scenes are measured".into());
    };
    let kernels = KernelPipelines::new(&harness.device)?;
    let mut frame = GpuFrame::new(&kernels, &harness.queue, scene, 1)?;
    let buffer = frame
        .buffers()
        .output(EntryPoint::Averages)
        .ok_or("no values")?;
    (harness.queue).write_buffer(
        buffer,
        0,
        bytemuck::cast_slice::<VectorIrradiance, u8>(values),
    );
    let textures = Textures::new(harness, view);
    let mut splat = ViewBuffers::new(&harness.device);
    splat.write(&harness.queue, &view.splat, &CompositeParams::default());
    let full = time(harness, |encoder| {
        frame.splat(&kernels, encoder, &splat, &textures.every_pixel());
    })?;
    let reference = textures.read(harness)?;
    let params = view.params(&SubsplatSettings::default());
    let mut buffers = SubsplatBuffers::new(&harness.device, &harness.queue, params.levels())?;
    buffers.write(&harness.queue, &params);
    let by = time(harness, |encoder| {
        let on = [(frame.buffers(), &splat)];
        buffers.record(&kernels, encoder, &textures.targets(), &on, None);
    })?;
    let shown = textures.read(harness)?;
    let count = evaluated(harness, &buffers)?;
    let square = |v: f32| f64::from(v) * f64::from(v);
    let error: f64 = shown
        .iter()
        .zip(&reference)
        .map(|(a, b)| square(a - b))
        .sum();
    let power: f64 = reference.iter().map(|&b| square(b)).sum();
    println!(
        "| {} | {} | {count} | {:.1} | {full:.1} | {by:.1} | {:.2} | {:.2} % |",
        view.stage.scene.name,
        i + 1,
        f64::from(SIZE[0] * SIZE[1]) / f64::from(count),
        by / full,
        100.0 * (error / power).sqrt(),
    );
    Ok(())
}

/// Returns virtual lights on visible surfaces.
fn virtual_lights(view: &View<'_>, count: u32) -> Vec<Vpl> {
    let drawn: Vec<usize> = (0..view.drawn.depth.len())
        .filter(|&i| view.drawn.depth[i] > 0.0)
        .collect();
    (0..count)
        .map(|k| {
            let i = drawn[(k as usize * 7919 * 131) % drawn.len()];
            let pixel = [i as u32 % SIZE[0], i as u32 / SIZE[0]];
            let (depth, texel) = (view.drawn.depth[i], view.drawn.gbuffer[i]);
            let (x, n) = splat::pixel_position(&view.splat, pixel, depth, texel);
            Vpl {
                position: x.to_array(),
                square: 0.01,
                normal: n.to_array(),
                flux: [1.0 / count as f32; 3],
                ..bytemuck::Zeroable::zeroed()
            }
        })
        .collect()
}

fn lit(harness: &HeadlessDevice, view: &View<'_>, count: u32) -> Result<(), Box<dyn Error>> {
    let kernels = KernelPipelines::new(&harness.device)?;
    let textures = Textures::new(harness, view);
    let lights = virtual_lights(view, count);
    let maps = RsmBuffers::new(&harness.device, 1, count)?;
    (harness.queue).write_buffer(maps.vpls(), 0, bytemuck::cast_slice(&lights));
    let view_params = VplViewParams {
        space_from_clip: view.drawn.world_from_clip.to_cols_array_2d(),
        viewport: [0.0, 0.0, SIZE[0] as f32, SIZE[1] as f32],
        size: SIZE,
        scale: 1.0,
        pad: 0,
    };
    let uniform = |bytes: &[u8]| {
        let buffer = harness.device.create_buffer(&wgpu::BufferDescriptor {
            label: None,
            size: bytes.len() as u64,
            usage: BufferUsages::UNIFORM | BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        harness.queue.write_buffer(&buffer, 0, bytes);
        buffer
    };
    let view_buffer = uniform(bytemuck::bytes_of(&view_params));
    let lit = uniform(bytemuck::bytes_of(&VplParams::unshadowed(count)));
    let [nodes, triangles] = maps.tree(None);
    let texture = wgpu::BindingResource::TextureView;
    let bind = kernels.bind(
        EntryPoint::Vpl,
        &[
            (0, view_buffer.as_entire_binding()),
            (1, texture(&textures.depth)),
            (2, texture(&textures.gbuffer)),
            (3, lit.as_entire_binding()),
            (4, maps.vpls().as_entire_binding()),
            (5, nodes.as_entire_binding()),
            (6, triangles.as_entire_binding()),
            (7, texture(&textures.target)),
        ],
    );
    let full = time(harness, |encoder| {
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
        pass.set_pipeline(&kernels.compute_kernel(EntryPoint::Vpl).pipeline);
        pass.set_bind_group(0, &bind, &[]);
        pass.dispatch_workgroups(SIZE[0].div_ceil(8), SIZE[1].div_ceil(8), 1);
    })?;
    let mut cells = Vec::new();
    for finest in [4, 3, 2, 1] {
        let settings = SubsplatSettings {
            coarsest_level: 5,
            finest_level: finest,
            ..SubsplatSettings::default()
        };
        let params = view.params(&settings);
        let mut buffers = SubsplatBuffers::new(&harness.device, &harness.queue, params.levels())?;
        buffers.write(&harness.queue, &params);
        let ms = time(harness, |encoder| {
            let on = NodeLights {
                maps: &maps,
                view: &view_buffer,
                lit: &lit,
                shadows: None,
            };
            buffers.record(&kernels, encoder, &textures.targets(), &[], Some(&on));
        })?;
        cells.push(format!("{ms:.0} ({:.2})", ms / full));
    }
    println!("| {count} | {} | {full:.0} |", cells.join(" | "));
    Ok(())
}

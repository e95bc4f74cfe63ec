//! Pipelines, created on first use. An unused effect has none (design D9).

use super::EntryPoint;
use super::GpuError;
use super::kernel::{Binding, BindingKind, COMPOSITE_ENTRIES, FOG_ENTRIES, Kernel};
use super::kernels::{COMPOSITE, FOG, KERNELS};
use meshless_gi::internals::frame::Span;
use meshless_gi::internals::frame::fmm_layout::MAX_FMM_TERMS;
use std::num::NonZeroU64;
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Mutex, OnceLock, PoisonError};

/// Compute pipeline with the layout of its bind group.
#[derive(Clone, Debug)]
pub struct ComputeKernel {
    /// Compute pipeline.
    pub pipeline: wgpu::ComputePipeline,
    /// Layout of group 0.
    pub layout: wgpu::BindGroupLayout,
}

/// Render pipeline of a kernel that draws, see [`ComputeKernel`].
#[derive(Clone, Debug)]
pub struct RenderKernel {
    /// Render pipeline.
    pub pipeline: wgpu::RenderPipeline,
    /// Layout of group 0.
    pub layout: wgpu::BindGroupLayout,
}

/// Kind of draw onto an image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Draw {
    /// Irradiance on the surfaces, added to the image.
    Add,
    /// Irradiance that replaces the image.
    Replace,
    /// Specular reflection, added to the image.
    Specular,
    /// Occluded light, subtracted from the image.
    Shadow,
    /// Light that fog scatters to the eye, added to the image.
    Fog,
    /// `Fog` with a depth texture of several samples per pixel.
    FogSampled,
}

/// Workgroup memory of `fmm_down`, the largest of all kernels, in bytes: scalars, derivatives, a
/// scaled expansion and the threads' sums.
const FMM_MEMORY: usize = MAX_FMM_TERMS * (4 + 2 * 16 + 3 * 16) + 64 * 48;

/// Pipelines of one device.
#[derive(Debug)]
pub struct KernelPipelines {
    device: wgpu::Device,
    modules: [OnceLock<wgpu::ShaderModule>; KERNELS.len()],
    compute_kernels: [OnceLock<ComputeKernel>; EntryPoint::COUNT],
    /// Pipelines that draw, one for each target format and each kind of draw.
    render_kernels: Mutex<Vec<((wgpu::TextureFormat, Draw), RenderKernel)>>,
    created: AtomicU32,
}

impl KernelPipelines {
    /// Creates the table of a device without any pipeline.
    ///
    /// # Errors
    /// [`GpuError::Limit`] if a limit of the device is too small for the kernels.
    pub fn new(device: &wgpu::Device) -> Result<Self, GpuError> {
        let limits = device.limits();
        let storage = |bindings: &[u32], kernel: &Kernel| {
            let used = kernel
                .bindings
                .iter()
                .filter(|b| bindings.contains(&b.index));
            used.filter(|b| matches!(b.kind, BindingKind::Read(_) | BindingKind::Write(_)))
                .count()
        };
        let entries = KERNELS
            .iter()
            .flat_map(|k| k.entries.iter().map(move |e| (k, e)));
        let max = entries
            .map(|(k, e)| storage(e.bindings, k))
            .max()
            .unwrap_or(0);
        let need = [
            (
                "maxStorageBuffersPerShaderStage",
                u64::from(limits.max_storage_buffers_per_shader_stage),
                max as u64,
            ),
            (
                "maxStorageTexturesPerShaderStage",
                u64::from(limits.max_storage_textures_per_shader_stage),
                1,
            ),
            (
                "maxComputeInvocationsPerWorkgroup",
                u64::from(limits.max_compute_invocations_per_workgroup),
                256,
            ),
            (
                "maxComputeWorkgroupStorageSize",
                u64::from(limits.max_compute_workgroup_storage_size),
                FMM_MEMORY as u64,
            ),
            (
                "maxComputeWorkgroupsPerDimension",
                u64::from(limits.max_compute_workgroups_per_dimension),
                65_535,
            ),
            (
                "maxBindingsPerBindGroup",
                u64::from(limits.max_bindings_per_bind_group),
                13,
            ),
            (
                "maxDynamicUniformBuffersPerPipelineLayout",
                u64::from(limits.max_dynamic_uniform_buffers_per_pipeline_layout),
                1,
            ),
        ];
        for (limit, have, need) in need {
            if have < need {
                return Err(GpuError::Limit { limit, have, need });
            }
        }
        Ok(Self {
            device: device.clone(),
            modules: [const { OnceLock::new() }; KERNELS.len()],
            compute_kernels: [const { OnceLock::new() }; EntryPoint::COUNT],
            render_kernels: Mutex::default(),
            created: AtomicU32::new(0),
        })
    }

    /// Returns the device.
    #[must_use]
    pub fn device(&self) -> &wgpu::Device {
        &self.device
    }

    /// Returns the number of pipelines created so far.
    #[must_use]
    pub fn pipeline_count(&self) -> u32 {
        self.created.load(Ordering::Relaxed)
    }

    /// Returns `true` if the pipeline of `entry_point` exists.
    #[must_use]
    pub fn is_created(&self, entry_point: EntryPoint) -> bool {
        self.compute_kernels[entry_point as usize].get().is_some()
    }

    /// Returns the pipeline of an entry point. The first call creates it.
    pub fn compute_kernel(&self, entry_point: EntryPoint) -> &ComputeKernel {
        self.compute_kernels[entry_point as usize].get_or_init(|| {
            let (at, entry) = entry_point.entry();
            let kernel = &KERNELS[at];
            let label = format!("meshless_gi {} {}", kernel.name, entry.name);
            let used = kernel
                .bindings
                .iter()
                .filter(|b| entry.bindings.contains(&b.index));
            let layout = self.layout(&label, used, wgpu::ShaderStages::COMPUTE);
            let pipeline_layout = self.pipeline_layout(&label, &layout);
            let pipeline = self
                .device
                .create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
                    label: Some(&label),
                    layout: Some(&pipeline_layout),
                    module: self.module(at),
                    entry_point: Some(entry.name),
                    compilation_options: wgpu::PipelineCompilationOptions::default(),
                    cache: None,
                });
            self.created.fetch_add(1, Ordering::Relaxed);
            ComputeKernel { pipeline, layout }
        })
    }

    /// Returns the pipeline of this kind of draw for a target of this format. The first call
    /// creates it.
    pub fn render_kernel(&self, format: wgpu::TextureFormat, draw: Draw) -> RenderKernel {
        let mut made = self
            .render_kernels
            .lock()
            .unwrap_or_else(PoisonError::into_inner);
        if let Some((_, kernel)) = made.iter().find(|(of, _)| *of == (format, draw)) {
            return kernel.clone();
        }
        let kernel = self.create_render_kernel(format, draw);
        made.push(((format, draw), kernel.clone()));
        kernel
    }

    fn create_render_kernel(&self, format: wgpu::TextureFormat, draw: Draw) -> RenderKernel {
        let [screen, irradiance, gloss, shade] = COMPOSITE_ENTRIES;
        let [fog_screen, fog, fog_sampled] = FOG_ENTRIES;
        // The last value is a kind of binding that the entry point does not have.
        let (at, vertex, fragment, without) = match draw {
            Draw::Add | Draw::Replace => (COMPOSITE, screen, irradiance, None),
            Draw::Specular => (COMPOSITE, screen, gloss, None),
            Draw::Shadow => (COMPOSITE, screen, shade, None),
            Draw::Fog => (FOG, fog_screen, fog, Some(BindingKind::Samples)),
            Draw::FogSampled => (FOG, fog_screen, fog_sampled, Some(BindingKind::Depth)),
        };
        let label = format!("meshless_gi {}", KERNELS[at].name);
        let used = KERNELS[at].bindings.iter();
        let used = used.filter(|b| without != Some(b.kind));
        let layout = self.layout(&label, used, wgpu::ShaderStages::FRAGMENT);
        let pipeline_layout = self.pipeline_layout(&label, &layout);
        let module = self.module(at);
        let add = wgpu::BlendComponent {
            src_factor: wgpu::BlendFactor::One,
            dst_factor: wgpu::BlendFactor::One,
            operation: match draw {
                Draw::Shadow => wgpu::BlendOperation::ReverseSubtract,
                _ => wgpu::BlendOperation::Add,
            },
        };
        let pipeline = self
            .device
            .create_render_pipeline(&wgpu::RenderPipelineDescriptor {
                label: Some(&label),
                layout: Some(&pipeline_layout),
                vertex: wgpu::VertexState {
                    module,
                    entry_point: Some(vertex),
                    compilation_options: wgpu::PipelineCompilationOptions::default(),
                    buffers: &[],
                },
                primitive: wgpu::PrimitiveState::default(),
                depth_stencil: None,
                multisample: wgpu::MultisampleState::default(),
                fragment: Some(wgpu::FragmentState {
                    module,
                    entry_point: Some(fragment),
                    compilation_options: wgpu::PipelineCompilationOptions::default(),
                    targets: &[Some(wgpu::ColorTargetState {
                        format,
                        blend: (draw != Draw::Replace).then_some(wgpu::BlendState {
                            color: add,
                            alpha: add,
                        }),
                        write_mask: wgpu::ColorWrites::COLOR,
                    })],
                }),
                multiview_mask: None,
                cache: None,
            });
        self.created.fetch_add(1, Ordering::Relaxed);
        RenderKernel { pipeline, layout }
    }

    fn module(&self, at: usize) -> &wgpu::ShaderModule {
        self.modules[at].get_or_init(|| {
            self.device
                .create_shader_module(wgpu::ShaderModuleDescriptor {
                    label: Some(KERNELS[at].name),
                    source: wgpu::ShaderSource::Wgsl(KERNELS[at].source.into()),
                })
        })
    }

    fn pipeline_layout(&self, label: &str, layout: &wgpu::BindGroupLayout) -> wgpu::PipelineLayout {
        self.device
            .create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
                label: Some(label),
                bind_group_layouts: &[Some(layout)],
                immediate_size: 0,
            })
    }

    fn layout<'a>(
        &self,
        label: &str,
        bindings: impl Iterator<Item = &'a Binding>,
        visibility: wgpu::ShaderStages,
    ) -> wgpu::BindGroupLayout {
        let entries: Vec<_> = bindings
            .map(|b| wgpu::BindGroupLayoutEntry {
                binding: b.index,
                visibility,
                ty: binding_type(b.kind),
                count: None,
            })
            .collect();
        self.device
            .create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
                label: Some(label),
                entries: &entries,
            })
    }
}

fn binding_type(kind: BindingKind) -> wgpu::BindingType {
    let buffer = |ty, has_dynamic_offset, size: usize| wgpu::BindingType::Buffer {
        ty,
        has_dynamic_offset,
        min_binding_size: NonZeroU64::new(size as u64),
    };
    let plane = wgpu::TextureViewDimension::D2;
    let image = |sample_type, view_dimension, multisampled| wgpu::BindingType::Texture {
        sample_type,
        view_dimension,
        multisampled,
    };
    let texture = |sample_type, view_dimension| image(sample_type, view_dimension, false);
    let float = wgpu::TextureSampleType::Float { filterable: false };
    let output = |view_dimension| wgpu::BindingType::StorageTexture {
        access: wgpu::StorageTextureAccess::WriteOnly,
        format: wgpu::TextureFormat::Rgba16Float,
        view_dimension,
    };
    match kind {
        BindingKind::Uniform(size) => buffer(wgpu::BufferBindingType::Uniform, false, size),
        BindingKind::Span => buffer(wgpu::BufferBindingType::Uniform, true, size_of::<Span>()),
        BindingKind::Read(size) => buffer(
            wgpu::BufferBindingType::Storage { read_only: true },
            false,
            size,
        ),
        BindingKind::Write(size) => buffer(
            wgpu::BufferBindingType::Storage { read_only: false },
            false,
            size,
        ),
        BindingKind::Depth => texture(wgpu::TextureSampleType::Depth, plane),
        BindingKind::Uint => texture(wgpu::TextureSampleType::Uint, plane),
        BindingKind::Float => texture(float, plane),
        BindingKind::Layers => texture(float, wgpu::TextureViewDimension::D2Array),
        BindingKind::Output => output(plane),
        BindingKind::Voxels => output(wgpu::TextureViewDimension::D3),
        BindingKind::Samples => image(wgpu::TextureSampleType::Depth, plane, true),
        BindingKind::Space => texture(
            wgpu::TextureSampleType::Float { filterable: true },
            wgpu::TextureViewDimension::D3,
        ),
        BindingKind::Sampler => wgpu::BindingType::Sampler(wgpu::SamplerBindingType::Filtering),
    }
}

//! Recording of the light that dynamic objects reflect. The maps of a light become virtual point
//! lights (`rsm`). These light a view (`vpl`). All lights with maps share one set of buffers. It
//! does not exist without such a light.

use super::EntryPoint;
use super::dispatch::{MAX_GROUPS, compute};
use super::frame::SplatTargets;
use super::pipelines::KernelPipelines;
use super::scene_buffers::SceneBuffers;
use super::{GpuCounters, GpuError};
use bytemuck::Pod;
use glam::Mat4;
use meshless_gi::FrameLight;
use meshless_gi::internals::frame::rsm_layout::MAX_VPLS;
use meshless_gi::internals::frame::{
    RsmParams, RsmSelectParams, RsmShadowParams, RsmTexel, Vpl, VplParams, VplViewParams,
};
use meshless_gi::internals::scene::{BvhNode, BvhTriangle};

/// Size of a uniform buffer in bytes. The largest of the parameters fits.
const UNIFORM: u64 = 256;
const _: () = assert!(
    size_of::<RsmParams>() <= UNIFORM as usize && size_of::<RsmShadowParams>() <= UNIFORM as usize
);

/// Map drawn from a light: a square of depth (reversed, one sample) and Bevy's deferred G-buffer
/// (`Rgba32Uint`). It shows only dynamic objects.
#[derive(Clone, Copy, Debug)]
pub struct RsmCapture<'a> {
    /// Depth.
    pub depth: &'a wgpu::TextureView,
    /// G-buffer.
    pub gbuffer: &'a wgpu::TextureView,
    /// Matrix and light. `first` is set by [`RsmBuffers::map`].
    pub params: RsmParams,
}

/// Baked scene that shadows the virtual point lights.
#[derive(Clone, Copy, Debug)]
pub struct VplShadows<'a> {
    /// Transform from the space of the lights to that of the scene
    /// ([`local_from_space`](meshless_gi::internals::frame::rsm_layout::local_from_space)).
    pub local_from_space: Mat4,
    /// Buffers of the scene.
    pub scene: &'a SceneBuffers,
    /// Threshold of irradiance, W/m². Virtual point lights below it are evaluated without a shadow
    /// ray.
    pub dim: f32,
}

/// Buffers of all reflective shadow maps, and their recording.
#[derive(Debug)]
pub struct RsmBuffers {
    /// Texels of the current light. All lights use this buffer in turn.
    texels: wgpu::Buffer,
    texel_capacity: u32,
    /// Virtual point lights of all lights, one light after the other.
    vpls: wgpu::Buffer,
    vpl_capacity: u32,
    used_vpls: u32,
    /// Number of texels of the current light.
    texel_count: u32,
    /// Buffers of one node and one triangle, bound if there is no baked scene.
    empty_bvh: [wgpu::Buffer; 2],
    /// Uniform buffers of a frame. The number in use follows.
    uniforms: Vec<wgpu::Buffer>,
    used_uniforms: usize,
    counters: GpuCounters,
}

impl RsmBuffers {
    /// Creates buffers for `vpls` virtual point lights in total, and for lights with at most
    /// `texels` texels in all their maps. `begin` grows them.
    ///
    /// # Errors
    /// [`GpuError::TooLarge`] if a buffer does not fit a binding of the device.
    pub fn new(device: &wgpu::Device, texels: u32, vpls: u32) -> Result<Self, GpuError> {
        Ok(Self {
            texels: storage::<RsmTexel>(device, "lit texels", texels)?,
            texel_capacity: texels,
            vpls: storage::<Vpl>(device, "virtual point lights", vpls)?,
            vpl_capacity: vpls,
            used_vpls: 0,
            texel_count: 0,
            empty_bvh: [
                storage::<BvhNode>(device, "no BVH nodes", 1)?,
                storage::<BvhTriangle>(device, "no BVH triangles", 1)?,
            ],
            uniforms: Vec::new(),
            used_uniforms: 0,
            counters: GpuCounters::default(),
        })
    }

    /// Begins a frame without lights and with all uniform buffers free. Reserves space for the
    /// texels of one light and the virtual point lights of all lights. Do not call it between
    /// recording a frame and its submission.
    ///
    /// # Errors
    /// [`GpuError::TooLarge`] if a buffer does not fit a binding of the device.
    pub fn begin(&mut self, device: &wgpu::Device, texels: u32, vpls: u32) -> Result<(), GpuError> {
        if texels > self.texel_capacity {
            self.texels = storage::<RsmTexel>(device, "lit texels", texels)?;
            self.texel_capacity = texels;
        }
        if vpls > self.vpl_capacity {
            self.vpls = storage::<Vpl>(device, "virtual point lights", vpls)?;
            self.vpl_capacity = vpls;
        }
        (self.used_vpls, self.texel_count, self.used_uniforms) = (0, 0, 0);
        Ok(())
    }

    /// Begins a frame with the virtual lights of the previous frame. Only views may be recorded. Do
    /// not call it between recording a frame and its submission.
    pub fn reuse_frame(&mut self) {
        (self.texel_count, self.used_uniforms) = (0, 0);
    }

    /// Records one map of a light. Call [`RsmBuffers::select_vpls`] after its last map. Maps that
    /// do not fit are left out, see [`RsmBuffers::begin`].
    pub fn map(
        &mut self,
        kernels: &KernelPipelines,
        queue: &wgpu::Queue,
        encoder: &mut wgpu::CommandEncoder,
        map: &RsmCapture<'_>,
    ) {
        let side = map.params.side;
        let count = side.saturating_mul(side);
        if !side.is_power_of_two() || count > self.texel_capacity - self.texel_count {
            return;
        }
        let params = RsmParams {
            first: self.texel_count,
            ..map.params
        };
        let at = self.uniform(kernels, queue, &params);
        let bind = kernels.bind(
            EntryPoint::RsmTexels,
            &[
                (0, self.uniforms[at].as_entire_binding()),
                (1, wgpu::BindingResource::TextureView(map.depth)),
                (2, wgpu::BindingResource::TextureView(map.gbuffer)),
                (3, self.texels.as_entire_binding()),
            ],
        );
        let groups = side.div_ceil(8);
        self.dispatch(
            kernels,
            encoder,
            EntryPoint::RsmTexels,
            &bind,
            [groups, groups],
        );
        self.texel_count += count;
    }

    /// Begins the next light. The previous light need not be complete.
    pub fn next_light(&mut self) {
        self.texel_count = 0;
    }

    /// Records the shadows of the baked scenes on the maps of a light, and the selection of its
    /// `vpls` virtual point lights.
    pub fn select_vpls(
        &mut self,
        kernels: &KernelPipelines,
        queue: &wgpu::Queue,
        encoder: &mut wgpu::CommandEncoder,
        light: &FrameLight,
        scenes: &[(Mat4, &SceneBuffers)],
        vpls: u32,
    ) {
        let texels = std::mem::take(&mut self.texel_count);
        let vpls = vpls.min(MAX_VPLS).min(self.vpl_capacity - self.used_vpls);
        if vpls == 0 || texels == 0 {
            return;
        }
        for (local_from_space, scene) in scenes {
            let shape = scene.shape();
            if shape.nodes == 0 {
                continue;
            }
            let params = RsmShadowParams::new(
                *local_from_space,
                light,
                texels,
                shape.nodes as u32,
                shape.extent,
            );
            let at = self.uniform(kernels, queue, &params);
            let bind = kernels.bind(
                EntryPoint::RsmShadow,
                &[
                    (3, self.texels.as_entire_binding()),
                    (4, self.uniforms[at].as_entire_binding()),
                    (5, scene.nodes.as_entire_binding()),
                    (6, scene.triangles.as_entire_binding()),
                ],
            );
            let groups = texels.div_ceil(64);
            let groups = [groups.min(MAX_GROUPS), groups.div_ceil(MAX_GROUPS)];
            self.dispatch(kernels, encoder, EntryPoint::RsmShadow, &bind, groups);
        }
        let params = RsmSelectParams {
            texels,
            first: self.used_vpls,
            vpls,
            pad: 0,
        };
        let at = self.uniform(kernels, queue, &params);
        let bind = kernels.bind(
            EntryPoint::RsmSelect,
            &[
                (3, self.texels.as_entire_binding()),
                (7, self.uniforms[at].as_entire_binding()),
                (8, self.vpls.as_entire_binding()),
            ],
        );
        self.dispatch(kernels, encoder, EntryPoint::RsmSelect, &bind, [1, 1]);
        self.used_vpls += vpls;
    }

    /// Records the irradiance of each pixel of a view from the lights recorded so far, added to
    /// `targets.earlier`.
    pub fn splat(
        &mut self,
        kernels: &KernelPipelines,
        queue: &wgpu::Queue,
        encoder: &mut wgpu::CommandEncoder,
        view: &VplViewParams,
        shadows: Option<&VplShadows<'_>>,
        targets: &SplatTargets<'_>,
    ) {
        let [width, height] = view.size;
        if width == 0 || height == 0 {
            return;
        }
        let entry_point = match targets.earlier {
            Some(_) => EntryPoint::VplOver,
            None => EntryPoint::Vpl,
        };
        let view = self.uniform(kernels, queue, view);
        let lit = self.uniform(kernels, queue, &self.params(shadows));
        let [nodes, triangles] = self.tree(shadows);
        let texture = wgpu::BindingResource::TextureView;
        let mut resources = vec![
            (0, self.uniforms[view].as_entire_binding()),
            (1, texture(targets.depth)),
            (2, texture(targets.gbuffer)),
            (3, self.uniforms[lit].as_entire_binding()),
            (4, self.vpls.as_entire_binding()),
            (5, nodes.as_entire_binding()),
            (6, triangles.as_entire_binding()),
            (8, texture(targets.output)),
        ];
        if let Some(earlier) = targets.earlier {
            resources.push((9, texture(earlier)));
        }
        let bind = kernels.bind(entry_point, &resources);
        let groups = [width.div_ceil(8), height.div_ceil(8)];
        self.dispatch(kernels, encoder, entry_point, &bind, groups);
    }

    /// Returns the parameters that a kernel with `vpl_at` binds as its `lit`.
    #[must_use]
    pub fn params(&self, shadows: Option<&VplShadows<'_>>) -> VplParams {
        match shadows {
            Some(by) => {
                let shape = by.scene.shape();
                VplParams::shadowed(
                    self.used_vpls,
                    by.local_from_space,
                    shape.nodes as u32,
                    shape.extent,
                    by.dim,
                )
            }
            None => VplParams::unshadowed(self.used_vpls),
        }
    }

    /// Returns the buffers that such a kernel binds as its `nodes` and `triangles`.
    #[must_use]
    pub fn tree<'a>(&'a self, shadows: Option<&VplShadows<'a>>) -> [&'a wgpu::Buffer; 2] {
        match shadows {
            Some(by) => [&by.scene.nodes, &by.scene.triangles],
            None => [&self.empty_bvh[0], &self.empty_bvh[1]],
        }
    }

    /// Returns the buffer that such a kernel binds as its `vpls`. It has [`RsmBuffers::vpl_count`]
    /// elements of type [`Vpl`].
    #[must_use]
    pub fn vpls(&self) -> &wgpu::Buffer {
        &self.vpls
    }

    /// Returns the texels of the last recorded light, for tests and tools.
    #[must_use]
    pub fn texels(&self) -> &wgpu::Buffer {
        &self.texels
    }

    /// Returns the number of virtual point lights of this frame's lights.
    #[must_use]
    pub fn vpl_count(&self) -> u32 {
        self.used_vpls
    }

    /// Returns the work recorded so far.
    #[must_use]
    pub fn counters(&self) -> GpuCounters {
        self.counters
    }

    /// Returns the number of buffers on the device.
    #[must_use]
    pub fn buffers(&self) -> u32 {
        4 + self.uniforms.len() as u32
    }

    /// Returns the size of its buffers in bytes.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        let own = [
            &self.texels,
            &self.vpls,
            &self.empty_bvh[0],
            &self.empty_bvh[1],
        ];
        let all = own.into_iter().chain(&self.uniforms);
        all.map(wgpu::Buffer::size).sum()
    }

    /// Writes parameters into a uniform buffer that this frame has not used yet.
    fn uniform<T: Pod>(
        &mut self,
        kernels: &KernelPipelines,
        queue: &wgpu::Queue,
        data: &T,
    ) -> usize {
        if self.used_uniforms == self.uniforms.len() {
            let buffer = kernels.device().create_buffer(&wgpu::BufferDescriptor {
                label: Some("reflective map"),
                size: UNIFORM,
                usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
                mapped_at_creation: false,
            });
            self.uniforms.push(buffer);
        }
        queue.write_buffer(
            &self.uniforms[self.used_uniforms],
            0,
            bytemuck::bytes_of(data),
        );
        self.used_uniforms += 1;
        self.used_uniforms - 1
    }

    fn dispatch(
        &mut self,
        kernels: &KernelPipelines,
        encoder: &mut wgpu::CommandEncoder,
        entry_point: EntryPoint,
        bind: &wgpu::BindGroup,
        [x, y]: [u32; 2],
    ) {
        let mut pass = compute(encoder, entry_point.entry().1.name);
        pass.set_pipeline(&kernels.compute_kernel(entry_point).pipeline);
        pass.set_bind_group(0, bind, &[]);
        pass.dispatch_workgroups(x, y, 1);
        self.counters.dispatches[entry_point as usize] += 1;
    }
}

/// Creates a storage buffer of zeros for `count` elements, at least one.
fn storage<T>(
    device: &wgpu::Device,
    what: &'static str,
    count: u32,
) -> Result<wgpu::Buffer, GpuError> {
    let bytes = size_of::<T>() as u64 * u64::from(count.max(1));
    let limit = device.limits().max_storage_buffer_binding_size;
    if bytes > limit {
        return Err(GpuError::TooLarge { what, bytes, limit });
    }
    Ok(device.create_buffer(&wgpu::BufferDescriptor {
        label: Some(what),
        size: bytes,
        usage: wgpu::BufferUsages::STORAGE
            | wgpu::BufferUsages::COPY_DST
            | wgpu::BufferUsages::COPY_SRC,
        mapped_at_creation: false,
    }))
}

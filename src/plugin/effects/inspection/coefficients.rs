//! Asynchronous readback of coefficients for the gizmos ([L08] Figure 1, the green dots).
//!
//! The render world copies the vector irradiances of a scene to a mappable buffer and maps it. Some
//! frames later their lengths are stored for the main world. Nothing is allocated while the gizmos
//! are off.

use crate::plan::SceneId;
use crate::plugin::effect_states::EffectState;
use bevy::ecs::prelude::*;
use meshless_gi::internals::frame::VectorIrradiance;
use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

/// The size of each point's vector irradiance, W/m², of the scenes that the gizmos show. Shared by
/// both worlds.
#[derive(Resource, Clone, Default)]
pub struct SharedCoefficients(Arc<Mutex<BTreeMap<u64, Arc<Vec<f32>>>>>);

impl SharedCoefficients {
    /// Returns the newest values of the scene on `root`, one per point. `None` before the first
    /// values have arrived.
    #[must_use]
    pub fn get(&self, root: Entity) -> Option<Arc<Vec<f32>>> {
        self.0
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .get(&root.to_bits())
            .cloned()
    }

    fn set(&self, scene: u64, values: Vec<f32>) {
        self.0
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .insert(scene, Arc::new(values));
    }

    fn remove(&self, scene: u64) {
        self.0
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .remove(&scene);
    }
}

/// Copies a scene's vector irradiances to the CPU, one copy at a time. Removes the values of the
/// scene when it is dropped.
pub(crate) struct CoefficientReadback {
    scene: SceneId,
    shared: SharedCoefficients,
    staging: wgpu::Buffer,
    /// A copy is on its way: recorded, or being mapped.
    busy: Arc<AtomicBool>,
    recorded: bool,
}

impl CoefficientReadback {
    /// Creates a buffer for a copy of `bytes` bytes. The values go to `shared`.
    pub fn new(
        device: &wgpu::Device,
        bytes: u64,
        scene: SceneId,
        shared: &SharedCoefficients,
    ) -> Self {
        Self {
            scene,
            shared: shared.clone(),
            staging: device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("meshless_gi coefficients"),
                size: bytes,
                usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
                mapped_at_creation: false,
            }),
            busy: Arc::default(),
            recorded: false,
        }
    }

    /// Records a copy, unless one is on its way.
    pub fn copy(&mut self, encoder: &mut wgpu::CommandEncoder, values: &wgpu::Buffer) {
        if values.size() == self.staging.size() && !self.busy.swap(true, Ordering::AcqRel) {
            encoder.copy_buffer_to_buffer(values, 0, &self.staging, 0, values.size());
            self.recorded = true;
        }
    }
}

impl Drop for CoefficientReadback {
    fn drop(&mut self) {
        self.shared.remove(self.scene.0);
    }
}

impl EffectState for CoefficientReadback {
    fn size(&self) -> (u32, u64) {
        (1, self.staging.size())
    }

    fn is_transient(&self) -> bool {
        true
    }

    /// Maps the copy and stores its values when that is done.
    fn finish_frame(&mut self) {
        if !std::mem::take(&mut self.recorded) {
            return;
        }
        let (staging, busy, scene) = (self.staging.clone(), self.busy.clone(), self.scene.0);
        let to = self.shared.clone();
        self.staging
            .map_async(wgpu::MapMode::Read, .., move |mapped| {
                if mapped.is_ok() {
                    let size = |e: &VectorIrradiance| {
                        let square: f32 = [e.x, e.y, e.z]
                            .iter()
                            .flat_map(|axis| &axis[..3])
                            .map(|v| v * v)
                            .sum();
                        square.sqrt()
                    };
                    let values: Vec<f32> = {
                        let bytes = staging.get_mapped_range(..);
                        bytemuck::pod_collect_to_vec::<u8, VectorIrradiance>(&bytes)
                            .iter()
                            .map(size)
                            .collect()
                    };
                    staging.unmap();
                    to.set(scene, values);
                }
                busy.store(false, Ordering::Release);
            });
    }
}

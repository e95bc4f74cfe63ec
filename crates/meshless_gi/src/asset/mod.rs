//! Baked scene: the data of a frame, and its `.mgi` container (`docs/FORMAT.md`).
//!
//! [`BakedScene::to_bytes`] and [`BakedScene::from_bytes`] are inverse to each other.
//! [`BakedScene::read`] and [`BakedScene::write`] do the same for files. No bytes cause a panic, or
//! use of more memory than [`Limits`] allows. A scene that was read has passed
//! [`BakedScene::validate`].

mod baked;
mod codec;
mod container;
mod disk;
mod error;
mod fingerprint;
mod fmm;
mod info;
mod layouts;
mod link_section;
mod materials;
mod occluders;
mod probes;
mod scene_data;
mod section_info;
mod section_io;
mod sections;
mod sky;
mod stats;
mod validate;
mod validate_bvh;
mod validate_columns;
mod violation;
mod visibility;

pub use baked::BakedScene;
pub use container::{VERSION as FORMAT_VERSION, is_container};
pub use disk::{check_writable, write_file};
pub use error::{AssetError, Limits};
pub use fingerprint::fingerprint;
pub use info::{BakeInfo, EnergyInfo, TierInfo};
pub use materials::{DynamicMaterials, MaterialCoverage};
pub use occluders::Occluders;
pub use probes::Probes;
pub use scene_data::{FlatBasis, LightSamples, PointSurface, SceneData};
pub use section_info::SectionInfo;
pub use sections::list_sections;
pub use sky::SkyVisibility;
pub use stats::BakedStats;
pub use violation::Violation;

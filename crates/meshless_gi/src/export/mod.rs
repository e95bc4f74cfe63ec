//! Baked light in files that other programs read without this crate: for devices without compute
//! shaders, and for games whose lights never change.
//!
//! | what | files |
//! |---|---|
//! | [`ExportedVolume`] | an irradiance volume of Bevy's for one set of lights: a texture (`.ktx2`), and a [`VolumePlacement`] (`.ron`) |

mod ktx2;
mod placement;
mod volume;

pub use placement::VolumePlacement;
pub use volume::{ExportError, ExportedVolume, VolumeExport};

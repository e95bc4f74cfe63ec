//! Baked light in files that other programs read without this crate. For devices without compute
//! shaders, and for games with constant lights.
//!
//! | type | file |
//! |---|---|
//! | [`ExportedVolume`] | Bevy irradiance volume for one set of lights: texture (`.ktx2`) |
//! | [`VolumePlacement`] | description of that texture (`.ron`) |

mod ktx2;
mod placement;
mod volume;

pub use placement::VolumePlacement;
pub use volume::{ExportError, ExportedVolume, VolumeExport};

//! Description of an exported volume: the file next to its texture.

use serde::{Deserialize, Serialize};

/// Transform and intensity of an irradiance volume. Written as RON to the file next to the texture.
///
/// In Bevy it is an entity with `IrradianceVolume { voxels, intensity, .. }`, a `LightProbe` and a
/// `Transform` of `translation`, `rotation` and `scale`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct VolumePlacement {
    /// Version of this format: [`VolumePlacement::VERSION`].
    pub version: u32,
    /// File of the texture, in the same folder.
    pub texture: String,
    /// File name of the lights that the volume was computed for.
    pub lights: String,
    /// Center of the volume, meters in the space of the bake.
    pub translation: [f32; 3],
    /// Quaternion x, y, z, w. Always the identity, since voxels are parallel to the axes.
    pub rotation: [f32; 4],
    /// Edges of the volume, meters. Bevy's volume is a cube from −0.5 to 0.5.
    pub scale: [f32; 3],
    /// Voxels along each edge. The texture is twice as high and three times as deep.
    pub resolution: [u32; 3],
    /// Factor of the texture, a power of two. Above 1 if light is too bright for half floats, below
    /// 1 if it is too dim.
    pub intensity: f32,
}

impl VolumePlacement {
    /// Version of the format that this crate writes and reads.
    pub const VERSION: u32 = 1;

    /// Returns the text of the file, RON.
    ///
    /// # Errors
    /// Errors of the serializer.
    pub fn to_ron(&self) -> Result<String, ron::Error> {
        let mut text = ron::ser::to_string_pretty(self, ron::ser::PrettyConfig::default())?;
        text.push('\n');
        Ok(text)
    }

    /// Reads the text of a file.
    ///
    /// # Errors
    /// [`ron::Error`] with the position in the text, or if the version differs.
    pub fn from_ron(text: &str) -> Result<Self, ron::Error> {
        let found: Self =
            ron::from_str(text).map_err(|error| ron::Error::Message(error.to_string()))?;
        match found.version {
            Self::VERSION => Ok(found),
            other => Err(ron::Error::Message(format!(
                "version {other}, only {} can be read",
                Self::VERSION
            ))),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn volume_placement_text_round_trips() {
        let placement = VolumePlacement {
            version: VolumePlacement::VERSION,
            texture: "room.ktx2".into(),
            lights: "lights.json".into(),
            translation: [0.0, 1.1, -3.25e-7],
            rotation: [0.0, 0.0, 0.0, 1.0],
            scale: [2.2; 3],
            resolution: [22, 21, 20],
            intensity: 4.0,
        };
        let text = placement.to_ron().unwrap();
        assert!(text.contains("texture: \"room.ktx2\""), "{text}");
        assert_eq!(VolumePlacement::from_ron(&text), Ok(placement));
        assert!(VolumePlacement::from_ron("(version: 1)").is_err());
        let newer = VolumePlacement::from_ron(&text.replace("version: 1", "version: 2"));
        assert!(newer.unwrap_err().to_string().contains("version 2"));
    }
}

//! SCENE.json: the geometry files of a scene and its lights. The tool and the accuracy tests read
//! it.
//!
//! Unknown fields are ignored. Invalid values of lights are errors that name their position.

use super::{InputBudget, Light, SceneError, SkyRadiance};
use glam::Vec3;
use serde::Deserialize;
use std::path::{Path, PathBuf};

/// Largest description, bytes. A parsed description takes up to forty times its size.
const MAX_BYTES: u64 = 1 << 26;

#[derive(Deserialize)]
struct RawScene {
    #[serde(default)]
    geometry: Vec<RawGeometry>,
    #[serde(default)]
    lights: Vec<serde_json::Value>,
}

#[derive(Deserialize)]
struct RawGeometry {
    file: String,
}

/// Light in the format of the file. Units as in [`Light`], such as E = I cos θ / d².
#[derive(Deserialize)]
#[serde(tag = "type", rename_all = "lowercase")]
enum RawLight {
    Point {
        position: [f32; 3],
        intensity: [f32; 3],
        range: Option<f32>,
    },
    Spot {
        position: [f32; 3],
        direction: [f32; 3],
        intensity: [f32; 3],
        inner_deg: f32,
        outer_deg: f32,
        range: Option<f32>,
    },
    Directional {
        direction: [f32; 3],
        irradiance: [f32; 3],
    },
    Rect {
        center: [f32; 3],
        u: [f32; 3],
        v: [f32; 3],
        radiance: [f32; 3],
    },
    Sky {
        radiance: Option<[f32; 3]>,
        zenith: Option<[f32; 3]>,
        horizon: Option<[f32; 3]>,
        ground: Option<[f32; 3]>,
        harmonics: Option<[[f32; 3]; 9]>,
    },
}

/// Scene of a SCENE.json.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SceneDescription {
    /// Geometry files. Relative names are relative to the folder of the description.
    pub geometry: Vec<PathBuf>,
    /// Lights.
    pub lights: Vec<Light>,
}

impl SceneDescription {
    /// Reads a description from a file.
    ///
    /// # Errors
    /// [`SceneError::Io`] and [`SceneError::Refused`] if the file cannot be read. Other errors if
    /// its content is not valid.
    pub fn read(path: impl AsRef<Path>) -> Result<Self, SceneError> {
        Self::read_within(path, &mut InputBudget::default())
    }

    /// Reads a description like [`read`](Self::read) within `budget`.
    ///
    /// # Errors
    /// Those of [`read`](Self::read).
    pub fn read_within(
        path: impl AsRef<Path>,
        budget: &mut InputBudget,
    ) -> Result<Self, SceneError> {
        let path = path.as_ref();
        let text = (budget.read(path)).map_err(|error| SceneError::reading(path, error))?;
        let folder = path.parent().unwrap_or(Path::new(""));
        Self::parse(&text, &path.display().to_string(), folder)
    }

    /// Reads a description from text. `file` is the file name in errors. File names in the text are
    /// relative to `folder`.
    pub fn parse(text: &[u8], file: &str, folder: &Path) -> Result<Self, SceneError> {
        if text.len() as u64 > MAX_BYTES {
            return Err(SceneError::TooLarge {
                file: file.into(),
                what: "bytes of a scene description",
                count: text.len() as u64,
                limit: MAX_BYTES,
            });
        }
        let raw: RawScene = serde_json::from_slice(text).map_err(|e| SceneError::Format {
            file: file.into(),
            reason: e.to_string(),
        })?;
        let mut lights = Vec::with_capacity(raw.lights.len());
        for (i, value) in raw.lights.into_iter().enumerate() {
            let wrong = |reason: String| SceneError::Value {
                file: file.into(),
                location: format!("lights[{i}]"),
                reason,
            };
            let raw: RawLight = serde_json::from_value(value).map_err(|e| wrong(e.to_string()))?;
            lights.push(light(raw).map_err(wrong)?);
        }
        Ok(Self {
            geometry: raw.geometry.iter().map(|g| folder.join(&g.file)).collect(),
            lights,
        })
    }
}

fn finite_vector(name: &str, v: [f32; 3]) -> Result<Vec3, String> {
    let v = Vec3::from_array(v);
    v.is_finite()
        .then_some(v)
        .ok_or_else(|| format!("{name} is not finite: {v}"))
}

fn unit(name: &str, v: [f32; 3]) -> Result<Vec3, String> {
    let v = finite_vector(name, v)?;
    v.try_normalize()
        .ok_or_else(|| format!("{name} has no length"))
}

fn strength(name: &str, v: [f32; 3]) -> Result<Vec3, String> {
    let v = finite_vector(name, v)?;
    (v.min_element() >= 0.0)
        .then_some(v)
        .ok_or_else(|| format!("{name} is negative: {v}"))
}

fn reach(range: Option<f32>) -> Result<f32, String> {
    match range {
        None => Ok(f32::INFINITY),
        Some(r) if r > 0.0 => Ok(r),
        Some(r) => Err(format!("range is {r}, not above 0")),
    }
}

fn light(raw: RawLight) -> Result<Light, String> {
    Ok(match raw {
        RawLight::Point {
            position,
            intensity,
            range,
        } => Light::Point {
            position: finite_vector("position", position)?,
            intensity: strength("intensity", intensity)?,
            range: reach(range)?,
        },
        RawLight::Spot {
            position,
            direction,
            intensity,
            inner_deg,
            outer_deg,
            range,
        } => {
            if !(0.0 <= inner_deg && inner_deg <= outer_deg && outer_deg <= 180.0) {
                return Err(format!(
                    "half angles must be 0 ≤ inner_deg ≤ outer_deg ≤ 180, not {inner_deg} and {outer_deg}"
                ));
            }
            Light::Spot {
                position: finite_vector("position", position)?,
                direction: unit("direction", direction)?,
                intensity: strength("intensity", intensity)?,
                inner: inner_deg.to_radians(),
                outer: outer_deg.to_radians(),
                range: reach(range)?,
            }
        }
        RawLight::Directional {
            direction,
            irradiance,
        } => Light::Directional {
            direction: unit("direction", direction)?,
            irradiance: strength("irradiance", irradiance)?,
        },
        RawLight::Rect {
            center,
            u,
            v,
            radiance,
        } => {
            let (u, v) = (finite_vector("u", u)?, finite_vector("v", v)?);
            if u.cross(v).length() <= 0.0 {
                return Err("u and v span no area".into());
            }
            Light::Rect {
                center: finite_vector("center", center)?,
                u,
                v,
                radiance: strength("radiance", radiance)?,
            }
        }
        RawLight::Sky {
            radiance: Some(radiance),
            zenith: None,
            horizon: None,
            ground: None,
            harmonics: None,
        } => Light::Sky {
            radiance: strength("radiance", radiance)?.into(),
        },
        RawLight::Sky {
            radiance: None,
            zenith: Some(zenith),
            horizon: Some(horizon),
            ground: Some(ground),
            harmonics: None,
        } => Light::Sky {
            radiance: SkyRadiance::gradient(
                strength("zenith", zenith)?,
                strength("horizon", horizon)?,
                strength("ground", ground)?,
            ),
        },
        RawLight::Sky {
            radiance: None,
            zenith: None,
            horizon: None,
            ground: None,
            harmonics: Some([mean, terms @ ..]),
        } => {
            let mut radiance: SkyRadiance = strength("harmonics[0]", mean)?.into();
            for (k, term) in terms.into_iter().enumerate() {
                radiance.terms[k] = finite_vector(&format!("harmonics[{}]", k + 1), term)?;
            }
            Light::Sky { radiance }
        }
        RawLight::Sky { .. } => {
            return Err(
                "a sky has `radiance`, or `zenith`, `horizon` and `ground`, or nine `harmonics`"
                    .into(),
            );
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(lights: &str) -> Result<SceneDescription, SceneError> {
        let text =
            format!(r#"{{"note":"ignored","geometry":[{{"file":"a.glb"}}],"lights":[{lights}]}}"#);
        SceneDescription::parse(text.as_bytes(), "s.json", Path::new("dir"))
    }

    #[test]
    fn description_reads_every_light_type() {
        let all = parse(
            r#"{"type":"point","position":[1,2,3],"intensity":[4,5,6]},
               {"type":"spot","position":[0,1,0],"direction":[0,-2,0],"intensity":[1,1,1],"inner_deg":45,"outer_deg":90,"falloff":"gltf"},
               {"type":"directional","direction":[0,-1,0],"irradiance":[1,2,3]},
               {"type":"rect","center":[0,0,0],"u":[1,0,0],"v":[0,0,1],"radiance":[1,1,1]},
               {"type":"sky","radiance":[0.5,0.5,0.5]}"#,
        )
        .unwrap();
        assert_eq!(all.geometry, [Path::new("dir").join("a.glb")]);
        assert_eq!(all.lights.len(), 5);
        let Light::Spot {
            direction, outer, ..
        } = all.lights[1]
        else {
            panic!("{:?}", all.lights[1]);
        };
        assert_eq!(
            (direction, outer),
            (Vec3::NEG_Y, core::f32::consts::FRAC_PI_2)
        );
    }

    #[test]
    fn description_reads_every_sky_type() {
        let all = parse(
            r#"{"type":"sky","radiance":[1,2,3]},
               {"type":"sky","zenith":[1,2,3],"horizon":[1,1,1],"ground":[0,0,0]},
               {"type":"sky","harmonics":[[1,1,1],[0,0,0],[-0.5,0,0],[0,0,0],[0,0,0],[0,0,0],[0,0,0],[0,0,0],[0,0.25,0]]}"#,
        )
        .unwrap();
        let sky = |i: usize| match all.lights[i] {
            Light::Sky { radiance } => radiance,
            other => panic!("{other:?}"),
        };
        assert_eq!(sky(0), Vec3::new(1.0, 2.0, 3.0).into());
        assert!((sky(1).toward(Vec3::Y) - Vec3::new(1.0, 2.0, 3.0)).length() < 1e-6);
        assert_eq!(sky(2).terms[1], Vec3::new(-0.5, 0.0, 0.0));
        assert_eq!(sky(2).terms[7], Vec3::new(0.0, 0.25, 0.0));
    }

    #[test]
    fn description_invalid_light_value_returns_named_error() {
        let text = |l: &str| parse(l).unwrap_err().to_string();
        let sky = r#"{"type":"sky","radiance":[1,1,1]},"#;
        assert_eq!(
            text(&format!(r#"{sky}{{"type":"sky","radiance":[1,-1,1]}}"#)),
            "s.json: lights[1]: radiance is negative: [1, -1, 1]"
        );
        let half = r#"{"type":"sky","zenith":[1,1,1],"ground":[0,0,0]}"#;
        assert!(text(half).contains("a sky has `radiance`"));
        let both = r#"{"type":"sky","radiance":[1,1,1],"zenith":[1,1,1],"horizon":[1,1,1],"ground":[0,0,0]}"#;
        assert!(text(both).contains("a sky has `radiance`"));
        let below = r#"{"type":"sky","zenith":[1,1,1],"horizon":[1,1,1],"ground":[0,-1,0]}"#;
        assert!(text(below).contains("ground is negative"));
        assert!(text(r#"{"type":"light"}"#).contains("lights[0]: unknown variant `light`"));
        assert!(
            text(r#"{"type":"point","position":[0,0,0]}"#).contains("missing field `intensity`")
        );
        assert!(
            text(r#"{"type":"directional","direction":[0,0,0],"irradiance":[1,1,1]}"#)
                .contains("no length")
        );
        assert!(
            text(r#"{"type":"rect","center":[0,0,0],"u":[1,0,0],"v":[2,0,0],"radiance":[1,1,1]}"#)
                .contains("no area")
        );
        let spot = r#"{"type":"spot","position":[0,0,0],"direction":[0,1,0],"intensity":[1,1,1],"inner_deg":60,"outer_deg":50}"#;
        assert!(text(spot).contains("60 and 50"));
        assert!(SceneDescription::read("no/such.json").unwrap_err().is_io());
    }

    #[test]
    fn description_reads_published_scenes() {
        for name in ["cornell", "rooms_open"] {
            let path = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../.."))
                .join("tests/data")
                .join(name)
                .join("L0.json");
            let scene = SceneDescription::read(path).unwrap();
            assert_eq!((scene.geometry.len(), scene.lights.len()), (1, 1));
        }
    }
}

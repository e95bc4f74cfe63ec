//! Stages of a frame.

/// Kind of work in a frame. Stages are ordered by their position in the frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct FrameStage {
    position: u32,
    name: &'static str,
}

impl FrameStage {
    /// Upload of a bake to the device.
    pub const UPLOAD: Self = Self::new(10, "upload");
    /// Upload of the senders' surfaces after materials changed.
    pub const MATERIALS: Self = Self::new(20, "materials");
    /// Update of the links that occluders block, after an occluder moved.
    pub const OCCLUDE: Self = Self::new(30, "occlude");
    /// Projection of lights onto the points, slot by slot.
    pub const PROJECT: Self = Self::new(40, "project");
    /// Radiosity of the lit points, pull-push to the senders, and the bounces between them.
    pub const PULL_PUSH: Self = Self::new(50, "pull_push");
    /// Product of the operator and the senders' coefficients.
    pub const APPLY: Self = Self::new(60, "apply");
    /// Values of all points. Inactive points take the mean of their parents.
    pub const FLATTEN: Self = Self::new(70, "flatten");
    /// Probe irradiance: the operator's rows of the probes.
    pub const PROBE: Self = Self::new(80, "probe");
    /// Probe irradiance as a volume, for cameras without a G-buffer and for fog.
    pub const VOLUME: Self = Self::new(90, "volume");
    /// Irradiance that is shadowed from lights with soft shadows, at the points with visibility.
    pub const SOFT_SHADOW: Self = Self::new(100, "soft_shadow");
    /// Reflective shadow maps of a light, and the virtual point lights chosen from them.
    pub const RSM: Self = Self::new(110, "rsm");
    /// Irradiance at the pixels of a view, from the flat basis.
    pub const SPLAT: Self = Self::new(120, "splat");
    /// Irradiance at the pixels of a view that lie off the baked surfaces, from the probes.
    pub const PROBE_PIXELS: Self = Self::new(125, "probe_pixels");
    /// Irradiance at the pixels of a view, from the virtual point lights.
    pub const VPL: Self = Self::new(130, "vpl");
    /// Product of irradiance and base color, added to the picture of a view.
    pub const COMPOSITE: Self = Self::new(140, "composite");
    /// Specular reflection of the virtual point lights, added to the picture of a view.
    pub const VPL_SPECULAR: Self = Self::new(150, "vpl_specular");
    /// Soft shadows, subtracted from the picture of a view.
    pub const SUBTRACT_SHADOW: Self = Self::new(160, "subtract_shadow");
    /// Probe irradiance scattered by fog, added to the picture of a view.
    pub const FOG: Self = Self::new(170, "fog");
    /// Copy of the coefficients to the CPU.
    pub const READ_BACK: Self = Self::new(180, "read_back");

    /// Creates a stage. `position` orders it in the frame, `name` is used by diagnostics and logs.
    #[must_use]
    pub const fn new(position: u32, name: &'static str) -> Self {
        Self { position, name }
    }

    /// Name that diagnostics and logs use.
    #[must_use]
    pub const fn name(self) -> &'static str {
        self.name
    }
}

//! [`LightKind`]: the kinds of lights of a game.

/// Kind of light.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[cfg_attr(feature = "bevy", derive(bevy::reflect::Reflect))]
pub enum LightKind {
    /// Point light.
    Point,
    /// Spot light.
    Spot,
    /// Directional light.
    Directional,
    /// Rectangular area light.
    Rect,
}

impl LightKind {
    /// All kinds.
    pub const ALL: [Self; 4] = [Self::Point, Self::Spot, Self::Directional, Self::Rect];

    /// Returns the name of one light of this kind.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Point => "point light",
            Self::Spot => "spot light",
            Self::Directional => "directional light",
            Self::Rect => "rectangle light",
        }
    }
}

//! How wrong a bake is.
pub struct Estimate {
    pub nrmse: f32,
    pub interval: f32,
    pub rays: u64,
}
pub fn estimate_error(
    _scene: &crate::asset::BakedScene,
    _g: &dyn crate::scene::Geometry,
    _seed: u64,
    _p: &super::Progress,
) -> Option<Estimate> {
    Some(Estimate {
        nrmse: 0.0,
        interval: 0.0,
        rays: 0,
    })
}

//! Bevy's deferred G-buffer, one `Rgba32Uint` texel per pixel: the fields that screen-space kernels
//! read. The format is that of Bevy 0.19 (own implementation).
//!
//! | channel | bits |
//! |---|---|
//! | r | base color^(1/2.2) as three unorm8, roughness |
//! | g | emissive, rgb9e5 |
//! | b | reflectance, metallic, occlusion, clearcoat, as unorm8 |
//! | a | normal as an octahedral map of twice 12 bits, 8 flags |

use glam::Vec3;

/// Flag of unlit pixels: the base color is displayed without lighting.
pub const UNLIT: u32 = 1;
/// Gamma of the base color.
pub const GAMMA: f32 = 2.2;

/// Returns the unit normal in world space.
#[must_use]
pub fn normal(texel: [u32; 4]) -> Vec3 {
    let unorm12 = |bits: u32| (bits & 0xfff) as f32 / 4095.0;
    let (x, y) = (
        unorm12(texel[3]) * 2.0 - 1.0,
        unorm12(texel[3] >> 12) * 2.0 - 1.0,
    );
    let z = 1.0 - x.abs() - y.abs();
    // The lower half is folded over the diagonals.
    let fold = (-z).clamp(0.0, 1.0);
    Vec3::new(
        x + if x >= 0.0 { -fold } else { fold },
        y + if y >= 0.0 { -fold } else { fold },
        z,
    )
    .normalize()
}

/// Returns `true` if the pixel is unlit.
#[must_use]
pub fn is_unlit(texel: [u32; 4]) -> bool {
    (texel[3] >> 24) & UNLIT != 0
}

/// Returns the base color, linear RGB.
#[must_use]
pub fn base(texel: [u32; 4]) -> Vec3 {
    let base = [0, 8, 16].map(|shift| libm::powf(unorm8(texel[0] >> shift), GAMMA));
    Vec3::from_array(base)
}

/// Returns the diffuse reflectance, linear RGB: base color × (1 − metallic).
#[must_use]
pub fn diffuse(texel: [u32; 4]) -> Vec3 {
    base(texel) * (1.0 - metallic(texel))
}

/// Returns the metallic value, 0 to 1.
#[must_use]
pub fn metallic(texel: [u32; 4]) -> f32 {
    unorm8(texel[2] >> 8)
}

/// Returns the perceptual roughness, 0 to 1.
#[must_use]
pub fn roughness(texel: [u32; 4]) -> f32 {
    unorm8(texel[0] >> 24)
}

/// Returns the specular reflectance at normal incidence, linear RGB: 0.16 reflectance² for
/// dielectrics, the base color for metals.
#[must_use]
pub fn f0(texel: [u32; 4]) -> Vec3 {
    let reflectance = unorm8(texel[2]);
    Vec3::splat(0.16 * reflectance * reflectance).lerp(base(texel), metallic(texel))
}

/// Returns the material's ambient occlusion. 1 means no occlusion.
#[must_use]
pub fn occlusion(texel: [u32; 4]) -> f32 {
    unorm8(texel[2] >> 16)
}

/// Packs a texel as Bevy does for a base color, metalness, occlusion and normal. For tests and CPU
/// pictures.
#[must_use]
pub fn pack(base: Vec3, metallic: f32, occlusion: f32, normal: Vec3, flags: u32) -> [u32; 4] {
    let unorm = |v: f32, max: f32| (v.clamp(0.0, 1.0) * max + 0.5) as u32;
    let rgb = base
        .to_array()
        .map(|c| unorm(libm::powf(c.max(0.0), 1.0 / GAMMA), 255.0));
    let n = normal / (normal.x.abs() + normal.y.abs() + normal.z.abs());
    let sign = |v: f32| if v > 0.0 { 1.0 } else { -1.0 };
    let (x, y) = if n.z >= 0.0 {
        (n.x, n.y)
    } else {
        ((1.0 - n.y.abs()) * sign(n.x), (1.0 - n.x.abs()) * sign(n.y))
    };
    [
        rgb[0] | rgb[1] << 8 | rgb[2] << 16 | 128 << 24,
        0,
        unorm(0.5, 255.0) | unorm(metallic, 255.0) << 8 | unorm(occlusion, 255.0) << 16,
        unorm(x * 0.5 + 0.5, 4095.0) | unorm(y * 0.5 + 0.5, 4095.0) << 12 | flags << 24,
    ]
}

/// Returns the same texel with another perceptual roughness and reflectance. [`pack`] sets 128/255
/// and 0.5.
#[must_use]
pub fn with_roughness(texel: [u32; 4], roughness: f32, reflectance: f32) -> [u32; 4] {
    let byte = |v: f32| (v.clamp(0.0, 1.0) * 255.0 + 0.5) as u32;
    let [r, g, b, a] = texel;
    [
        r & 0x00ff_ffff | byte(roughness) << 24,
        g,
        b & !0xff | byte(reflectance),
        a,
    ]
}

fn unorm8(bits: u32) -> f32 {
    (bits & 0xff) as f32 / 255.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn packed_gbuffer_round_trips() {
        for (i, n) in [
            Vec3::X,
            Vec3::NEG_Z,
            Vec3::new(0.3, -0.5, -0.8),
            Vec3::new(-0.1, 0.9, 0.4),
        ]
        .into_iter()
        .enumerate()
        {
            let n = n.normalize();
            let base = Vec3::new(0.8, 0.25, 0.05);
            let texel = pack(base, 0.2, 0.6, n, i as u32 & UNLIT);
            assert!(
                (normal(texel) - n).length() < 1e-3,
                "{n}: {}",
                normal(texel)
            );
            assert!((diffuse(texel) - base * 0.8).abs().max_element() < 0.006);
            assert!((occlusion(texel) - 0.6).abs() < 0.003);
            assert_eq!(is_unlit(texel), i % 2 == 1);
            assert!((roughness(texel) - 0.5).abs() < 0.003);
            let shiny = with_roughness(texel, 0.2, 1.0);
            assert!((roughness(shiny) - 0.2).abs() < 0.003);
            assert_eq!(
                (normal(shiny), diffuse(shiny)),
                (normal(texel), diffuse(texel))
            );
            let f0 = f0(shiny) - (0.8 * 0.16 + 0.2 * base);
            assert!(f0.abs().max_element() < 0.006, "{f0}");
        }
    }
}

//! Dynamic materials: the coverage of senders by materials with base color and emission that may
//! change at run time. Data in memory, sections of the file, and validation. The four sections are
//! present together or not at all.

use super::codec::{Layout, words};
use super::container::{Container, Section, SectionKind};
use super::error::AssetError;
use super::layouts::COUNT;
use super::scene_data::SceneData;
use super::section_io::{counts, items, section, section_error, starts};
use super::validate::{MAX_RADIOSITY, TOLERANCE};
use super::violation::Check;
use crate::scene::MaterialFactors;
use crate::transport::SenderForm;
use bytemuck::{Pod, Zeroable};

/// Coverage of a sender by a material. 28 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct MaterialCoverage {
    /// Index of the material.
    pub material: u32,
    /// Mean reflectance over the sender's positions for a base color of one, RGB. Positions with
    /// another material count as zero. From 0 to the material's fraction of the positions.
    pub albedo: [f32; 3],
    /// Mean radiance over the positions for an emissive factor of one, as `albedo`.
    pub emission: [f32; 3],
}

/// Materials of a baked scene that may change. A sender's albedo is Σ share · base color. Its
/// emitted radiosity is π Σ share · emissive factor.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct DynamicMaterials {
    /// Names of the materials. They may be empty or repeat.
    pub names: Vec<String>,
    /// Factors of the materials at bake time.
    pub factors: Vec<MaterialFactors>,
    /// First coverage of each sender, and the end of the last. A sender without coverage keeps its
    /// baked surface.
    pub starts: Vec<u32>,
    /// Coverages, sender after sender.
    pub shares: Vec<MaterialCoverage>,
}

impl DynamicMaterials {
    /// Returns the coverages of sender `j`.
    #[must_use]
    #[inline]
    pub fn row(&self, j: usize) -> &[MaterialCoverage] {
        &self.shares[self.starts[j] as usize..self.starts[j + 1] as usize]
    }

    /// Returns the size in memory, bytes.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        let bytes = |length: usize, size: u64| length as u64 * size;
        let names: usize = self.names.iter().map(String::len).sum();
        bytes(names, 1)
            + bytes(self.factors.len(), 24)
            + bytes(self.starts.len(), 4)
            + bytes(self.shares.len(), 28)
    }
}

const FACTORS: Layout = Layout::rows(&words([0, 1, 2, 3, 4, 5]));
const SHARE: Layout = Layout::columns(&words([0, 1, 2, 3, 4, 5, 6]));

/// Kinds of sections, ascending.
pub(super) const KINDS: [SectionKind; 4] = [
    SectionKind {
        code: 46,
        name: "material names",
        version: 1,
        raw: 1,
        // Memory of the text, the decoded names and the parser. An empty name takes three bytes of
        // text, and a string.
        memory: 32,
        max: 1 << 20,
    },
    SectionKind {
        code: 47,
        name: "material factors",
        version: 1,
        raw: FACTORS.item_bytes() as u64,
        memory: size_of::<MaterialFactors>() as u64,
        max: u32::MAX as u64,
    },
    SectionKind {
        code: 48,
        name: "material counts",
        version: 1,
        raw: 4,
        memory: 8,
        max: u32::MAX as u64,
    },
    SectionKind {
        code: 49,
        name: "material shares",
        version: 1,
        raw: SHARE.item_bytes() as u64,
        memory: size_of::<MaterialCoverage>() as u64,
        max: u32::MAX as u64,
    },
];

/// Returns the sections of `materials`. `kinds` are the entries of [`KINDS`] in the table.
pub(super) fn sections(
    materials: &DynamicMaterials,
    kinds: &'static [SectionKind],
) -> Result<Vec<Section>, AssetError> {
    let names = ron::to_string(&materials.names).map_err(|e| section_error(&kinds[0], e))?;
    if names.len() as u64 > kinds[0].max {
        let found = format!("{} bytes of text, at most {}", names.len(), kinds[0].max);
        return Err(section_error(&kinds[0], found));
    }
    Ok(vec![
        Section {
            kind: &kinds[0],
            items: names.len(),
            raw: names.into_bytes(),
        },
        section(&kinds[1], FACTORS, &materials.factors),
        section(&kinds[2], COUNT, &counts(&materials.starts)),
        section(&kinds[3], SHARE, &materials.shares),
    ])
}

/// Reads the materials of a file. Returns `None` if it has none.
pub(super) fn read(
    file: &Container<'_>,
    kinds: &'static [SectionKind],
) -> Result<Option<DynamicMaterials>, AssetError> {
    let Some((_, names)) = file.section(&kinds[0])? else {
        return match kinds.iter().find(|k| file.has(k)) {
            Some(kind) => Err(section_error(
                kind,
                "is present, but the section `material names` is missing",
            )),
            None => Ok(None),
        };
    };
    let names = std::str::from_utf8(&names).map_err(|e| section_error(&kinds[0], e))?;
    Ok(Some(DynamicMaterials {
        names: ron::from_str(names).map_err(|e| section_error(&kinds[0], e))?,
        factors: items(file, &kinds[1], FACTORS)?,
        starts: starts(file, &kinds[2])?,
        shares: items(file, &kinds[3], SHARE)?,
    }))
}

impl SceneData {
    /// Checks that every lookup of a frame stays within the arrays, and that no sender reflects
    /// more than it receives.
    pub(super) fn check_materials(&self, check: &mut Check) {
        let Some(materials) = &self.materials else {
            return;
        };
        let senders = self.senders();
        let (starts, count) = (&materials.starts, materials.factors.len());
        check.section(materials.names.len() == count, "material names", || {
            format!("{} for {count} materials", materials.names.len())
        });
        let sound = starts.len() == senders + 1
            && starts.first() == Some(&0)
            && starts.is_sorted()
            && starts.last().map(|&s| s as usize) == Some(materials.shares.len());
        check.section(sound, "material counts", || {
            "do not ascend over the senders to the end of the shares".into()
        });
        let dynamic_form = self.operator.form == SenderForm::Averages
            && self.bounces.is_none()
            && self.fmm.is_none();
        check.section(dynamic_form, "material shares", || {
            "are present, but require method `bounded` and bounce mode `runtime`".into()
        });
        for (i, f) in materials.factors.iter().enumerate() {
            let within = |v: [f32; 3], max: f32| v.iter().all(|c| (0.0..=max).contains(c));
            let sound = within(f.base_color, 1.0) && within(f.emissive, MAX_RADIOSITY);
            check.item(sound, "material factors", i, || format!("{f:?}"));
        }
        if !check.0.is_empty() {
            return;
        }
        for j in 0..senders {
            let mut sums = [0.0f32; 6];
            for share in materials.row(j) {
                let in_range = (share.material as usize) < count;
                check.item(in_range, "material shares", j, || {
                    format!("material {} of {count}", share.material)
                });
                for (sum, v) in sums
                    .iter_mut()
                    .zip(share.albedo.iter().chain(&share.emission))
                {
                    // Negative numbers and NaN make the sum NaN.
                    *sum += if *v >= 0.0 { *v } else { f32::NAN };
                }
            }
            let sound = sums.iter().all(|s| *s <= 1.0 + TOLERANCE);
            check.item(sound, "material shares", j, || format!("sum to {sums:?}"));
            if check.is_full() {
                return;
            }
        }
    }
}

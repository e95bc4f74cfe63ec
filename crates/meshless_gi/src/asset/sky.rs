//! Visibility of a non-uniform sky: data in memory, section of the file, and validation. Links to
//! the eight terms ([`SkyRadiance`]) are among the operator's. The senders' direct light from the
//! terms is here.

use super::codec::{Layout, words};
use super::container::{Container, Section, SectionKind};
use super::error::AssetError;
use super::scene_data::SceneData;
use super::section_io::{items, section};
use super::violation::Check;
use crate::scene::SkyRadiance;
use crate::transport::SenderForm;

/// Visibility of the sky's terms at the senders.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SkyVisibility {
    /// Integrals (1/π) ∫ p_k(ω) (n·ω) dω of each sender over the unoccluded directions. The p_k are
    /// the polynomials of the sky's terms. Dimensionless, within ±1.
    pub senders: Vec<[f32; SkyRadiance::TERMS]>,
}

const TERMS: Layout = Layout::rows(&words([0, 1, 2, 3, 4, 5, 6, 7]));

/// Kind of section.
pub(super) const KIND: SectionKind = SectionKind {
    code: 45,
    name: "sky terms",
    version: 1,
    raw: TERMS.item_bytes() as u64,
    memory: size_of::<[f32; SkyRadiance::TERMS]>() as u64,
    max: u32::MAX as u64,
};

/// Returns the section of `sky`. `kind` is the entry of [`KIND`] in the table.
pub(super) fn sections(sky: &SkyVisibility, kind: &'static SectionKind) -> Section {
    section(kind, TERMS, &sky.senders)
}

/// Reads the sky visibility of a file. Returns `None` if it has none.
pub(super) fn read(
    file: &Container<'_>,
    kind: &'static SectionKind,
) -> Result<Option<SkyVisibility>, AssetError> {
    if !file.has(kind) {
        return Ok(None);
    }
    Ok(Some(SkyVisibility {
        senders: items(file, kind, TERMS)?,
    }))
}

impl SceneData {
    /// Returns the number of sky terms, which links may name after the sky itself.
    pub(super) fn sky_terms(&self) -> usize {
        match self.sky {
            Some(_) => SkyRadiance::TERMS,
            None => 0,
        }
    }

    /// Checks that there is one entry per sender, and that the operator supports links to the
    /// terms.
    pub(super) fn check_sky(&self, check: &mut Check) {
        let Some(sky) = &self.sky else { return };
        let (found, senders) = (sky.senders.len(), self.senders());
        check.section(found == senders, "sky terms", || {
            format!("{found} instead of {senders}")
        });
        let averages = self.operator.form == SenderForm::Averages && self.fmm.is_none();
        check.section(averages, "sky terms", || {
            "are present, but the operator has no links to them".into()
        });
        for (i, terms) in sky.senders.iter().enumerate() {
            let sound = terms.iter().all(|t| (-1.01..=1.01).contains(t));
            check.item(sound, "sky terms", i, || format!("{terms:?}"));
            if check.is_full() {
                return;
            }
        }
    }
}

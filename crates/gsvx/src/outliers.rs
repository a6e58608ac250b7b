//! Gaussians outside the cube, coded exactly: see [`crate::split_outliers`] for which.

use crate::encode::used_degree;
use crate::error::{Error, Result};
use crate::lossless::layout::{blank, columns, gather_rows, scatter};
use crate::stream::Container;
use crate::stream::SectionKind;
use gs_model::Scene;

/// What an encoder is to code exactly: nothing, or a scene that fits the one of the leaves.
pub(crate) fn of<'a>(outliers: Option<&'a Scene>, leaves: &Scene) -> Result<Option<&'a Scene>> {
    let Some(outliers) = outliers.filter(|o| !o.is_empty()) else { return Ok(None) };
    if outliers.sh_degree > leaves.sh_degree {
        return Err(Error::Option {
            option: "SH degree of the outliers",
            value: outliers.sh_degree.into(),
            range: "at most that of the leaves",
        });
    }
    for (len, each) in [
        (outliers.rotations.len(), 1),
        (outliers.log_scales.len(), 1),
        (outliers.opacity_logits.len(), 1),
        (outliers.sh.len(), outliers.sh_len()),
    ] {
        if len != outliers.len() * each {
            return Err(Error::CountMismatch { scene: outliers.len(), leaves: len / each });
        }
    }
    match outliers.invalid().first {
        Some(first) => Err(Error::InvalidOutlier { index: first.index, field: first.field }),
        None => Ok(Some(outliers)),
    }
}

/// The highest degree, up to `most`, that the outliers use: the header's is not lower.
pub(crate) fn degree(outliers: Option<&Scene>, most: u8) -> u8 {
    outliers.map_or(0, |o| used_degree(o, most))
}

/// The payload: rows of little-endian floats at the stream's SH degree.
pub(crate) fn encode(outliers: &Scene, sh_degree: u8) -> Vec<u8> {
    let order: Vec<u32> = (0..outliers.len() as u32).collect();
    let mut at_degree = Scene { sh_degree, ..Scene::default() };
    at_degree.append(outliers);
    let rows = gather_rows(&at_degree, &order);
    rows.into_iter().flat_map(u32::to_le_bytes).collect()
}

/// The outliers of a payload, which alone says how many there are.
///
/// # Errors
/// [`Error::Corrupt`] if it is empty, not whole rows, or a Gaussian is invalid.
pub(crate) fn decode(payload: &[u8], sh_degree: u8) -> Result<Scene> {
    let row = row_bytes(sh_degree);
    if payload.is_empty() || !payload.len().is_multiple_of(row) {
        return Err(Error::Corrupt { what: "length of the outliers", value: payload.len() as u64 });
    }
    let mut scene = blank(payload.len() / row, sh_degree);
    let mut values = Vec::with_capacity(columns(sh_degree));
    for (i, row) in payload.chunks_exact(row).enumerate() {
        values.clear();
        values.extend(row.chunks_exact(4).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]])));
        scatter(&mut scene, i, &values);
    }
    match scene.invalid().first {
        Some(first) => Err(Error::Corrupt { what: "invalid outlier", value: first.index as u64 }),
        None => Ok(scene),
    }
}

/// Bytes of one outlier.
fn row_bytes(sh_degree: u8) -> usize {
    4 * columns(sh_degree)
}

impl Container<'_> {
    /// Gaussians coded exactly, beside [`crate::stream::Header::count`], as the table of contents
    /// has it.
    #[must_use]
    pub fn outliers(&self) -> u64 {
        let entry = self.toc.iter().find(|e| e.kind == SectionKind::Outliers);
        entry.map_or(0, |e| e.len / row_bytes(self.header.sh_degree) as u64)
    }
}

//! `meta.json`: counts, bounds, codebooks and the names of the images.

use std::path::Path;

use serde::Deserialize;

use super::malformed;
use crate::error::Result;

#[derive(Deserialize)]
pub(super) struct Meta {
    pub(super) count: usize,
    pub(super) means: Means,
    pub(super) scales: Indexed,
    quats: Files,
    pub(super) sh0: Indexed,
    #[serde(rename = "shN")]
    pub(super) sh_n: Option<Palette>,
}

/// Bounds of `sign(x) ln(1 + |x|)`; images of the low and of the high bytes.
#[derive(Deserialize)]
pub(super) struct Means {
    pub(super) mins: [f64; 3],
    pub(super) maxs: [f64; 3],
    files: [String; 2],
}

#[derive(Deserialize)]
struct Files {
    files: [String; 1],
}

/// An image of indices, and the numbers that they stand for.
#[derive(Deserialize)]
pub(super) struct Indexed {
    pub(super) codebook: Vec<f32>,
    files: [String; 1],
}

/// The palette of higher SH coefficients, and the image of each Gaussian's place in it.
#[derive(Deserialize)]
pub(super) struct Palette {
    pub(super) count: usize,
    bands: u8,
    pub(super) codebook: Vec<f32>,
    files: [String; 2],
}

/// What says the version; version 1 has none.
#[derive(Deserialize)]
struct Version {
    version: Option<u64>,
}

impl Meta {
    pub(super) fn parse(file: &Path, json: &[u8]) -> Result<Self> {
        let bad = |reason: &str| malformed(file, "meta.json", reason);
        let not_meta = |e: serde_json::Error| bad(&format!("is not that of a SOG: {e}"));
        let version: Version = serde_json::from_slice(json).map_err(not_meta)?;
        match version.version {
            Some(2) => {}
            None | Some(1) => {
                return Err(bad("has version 1; write it again as version 2 with splat-transform"));
            }
            Some(other) => return Err(bad(&format!("has version {other}; 2 is read"))),
        }
        let meta: Self = serde_json::from_slice(json).map_err(not_meta)?;
        if meta.sh_n.as_ref().is_some_and(|p| !(1..=3).contains(&p.bands)) {
            return Err(bad("shN: bands is not 1, 2 or 3"));
        }
        Ok(meta)
    }

    pub(super) fn sh_degree(&self) -> u8 {
        self.sh_n.as_ref().map_or(0, |palette| palette.bands)
    }

    /// The names of the images: low and high bytes of the means, rotations, scales, colours, and where
    /// there is a palette, the palette and the places in it.
    pub(super) fn textures(&self) -> Vec<&str> {
        let first = self.means.files.iter().chain(&self.quats.files);
        let first = first.chain(&self.scales.files).chain(&self.sh0.files);
        first.chain(self.sh_n.iter().flat_map(|p| &p.files)).map(String::as_str).collect()
    }
}

//! `meta.json`: counts, bounds, codebooks and the names of the images, of both versions.

use std::path::Path;

use serde::Deserialize;

use crate::error::{Error, Result};
use crate::scene::sh_len;
use crate::splat::opacity_logit;

/// What the bytes of the images stand for, whatever the version.
pub(super) struct Meta {
    pub(super) version: u8,
    /// Gaussians.
    pub(super) count: usize,
    /// Least and greatest values of `sign(x) ln(1 + |x|)` of the means.
    pub(super) means: [[f64; 3]; 2],
    /// Of each axis, the log-scales of the bytes.
    pub(super) scales: [Vec<f32>; 3],
    /// Of each channel, the SH coefficients of degree 0 of the bytes.
    pub(super) colours: [Vec<f32>; 3],
    /// The opacity logits of the bytes.
    pub(super) opacities: Vec<f32>,
    pub(super) palette: Option<Palette>,
    /// The names of the images: low and high bytes of the means, rotations, scales, colours, and where
    /// there is a palette, the palette and the places in it.
    pub(super) files: Vec<String>,
}

/// The palette of higher SH coefficients.
pub(super) struct Palette {
    pub(super) sh_degree: u8,
    /// Entries, at most.
    pub(super) entries: usize,
    /// The coefficients of the bytes.
    pub(super) values: Vec<f32>,
}

/// What says the version; version 1 has none.
#[derive(Deserialize)]
struct Version {
    version: Option<u64>,
}

#[derive(Deserialize)]
struct Files {
    files: [String; 1],
}

/// A part of version 1, or the means of version 2, which have no shape: bytes are steps between bounds.
#[derive(Deserialize)]
struct Steps<B, F = [String; 1]> {
    #[serde(default)]
    shape: Vec<usize>,
    mins: B,
    maxs: B,
    files: F,
}

#[derive(Deserialize)]
struct Meta1 {
    means: Steps<[f64; 3], [String; 2]>,
    scales: Steps<[f32; 3]>,
    quats: Files,
    sh0: Steps<[f32; 4]>,
    #[serde(rename = "shN")]
    sh_n: Option<Steps<f32, [String; 2]>>,
}

/// A part of version 2: bytes are indices of a codebook.
#[derive(Deserialize)]
struct Indexed {
    codebook: Vec<f32>,
    files: [String; 1],
}

#[derive(Deserialize)]
struct Palette2 {
    count: usize,
    bands: u8,
    codebook: Vec<f32>,
    files: [String; 2],
}

#[derive(Deserialize)]
struct Meta2 {
    count: usize,
    means: Steps<[f64; 3], [String; 2]>,
    scales: Indexed,
    quats: Files,
    sh0: Indexed,
    #[serde(rename = "shN")]
    sh_n: Option<Palette2>,
}

/// What each byte stands for between two bounds.
fn steps(low: f32, high: f32) -> Vec<f32> {
    let (low, high) = (f64::from(low), f64::from(high));
    (0..=255).map(|b| (low + (high - low) * (f64::from(b) / 255.0)) as f32).collect()
}

impl Meta {
    pub(super) fn parse(file: &Path, json: &[u8]) -> Result<Self> {
        let not_meta = |e| Error::json(file, "a SOG's meta.json", e);
        let bad = |reason: &str| Error::malformed(file, "meta.json", reason);
        let version: Version = serde_json::from_slice(json).map_err(not_meta)?;
        match version.version {
            None | Some(1) => {
                serde_json::from_slice::<Meta1>(json).map_err(not_meta)?.meta().map_err(bad)
            }
            Some(2) => serde_json::from_slice::<Meta2>(json).map_err(not_meta)?.meta().map_err(bad),
            Some(other) => Err(Error::version(file, "SOG", other, "1 and 2 are")),
        }
    }

    pub(super) fn sh_degree(&self) -> u8 {
        self.palette.as_ref().map_or(0, |palette| palette.sh_degree)
    }
}

impl Meta1 {
    fn meta(self) -> Result<Meta, &'static str> {
        let Self { means, scales, quats, sh0, sh_n } = self;
        let count = *means.shape.first().ok_or("means: its shape is empty or missing")?;
        if scales.shape.first() != Some(&count) || sh0.shape.first() != Some(&count) {
            return Err("means, scales and sh0 have different shapes");
        }
        let mut files = [&means.files[..], &quats.files, &scales.files, &sh0.files].concat();
        let palette = sh_n.map(|sh| {
            files.extend(sh.files);
            let per_gaussian = sh.shape.get(1).copied().unwrap_or(0);
            let degree = (1..=3u8).find(|&d| 3 * (sh_len(d) - 1) == per_gaussian);
            let sh_degree = degree.ok_or("shN: its shape is not N by 9, 24 or 45")?;
            // Places in the palette have 16 bits.
            let values = steps(sh.mins, sh.maxs);
            Ok::<_, &'static str>(Palette { sh_degree, entries: 1 << 16, values })
        });
        Ok(Meta {
            version: 1,
            count,
            means: [means.mins, means.maxs],
            scales: [0, 1, 2].map(|k| steps(scales.mins[k], scales.maxs[k])),
            colours: [0, 1, 2].map(|k| steps(sh0.mins[k], sh0.maxs[k])),
            opacities: steps(sh0.mins[3], sh0.maxs[3]),
            palette: palette.transpose()?,
            files,
        })
    }
}

impl Meta2 {
    fn meta(self) -> Result<Meta, &'static str> {
        let Self { count, means, scales, quats, sh0, sh_n } = self;
        let mut files = [&means.files[..], &quats.files, &scales.files, &sh0.files].concat();
        let palette = sh_n.map(|sh| {
            files.extend(sh.files);
            Palette { sh_degree: sh.bands, entries: sh.count, values: sh.codebook }
        });
        if palette.as_ref().is_some_and(|p| !(1..=3).contains(&p.sh_degree)) {
            return Err("shN: bands is not 1, 2 or 3");
        }
        Ok(Meta {
            version: 2,
            count,
            means: [means.mins, means.maxs],
            scales: [(); 3].map(|()| scales.codebook.clone()),
            colours: [(); 3].map(|()| sh0.codebook.clone()),
            opacities: (0..=255).map(opacity_logit).collect(),
            palette,
            files,
        })
    }
}

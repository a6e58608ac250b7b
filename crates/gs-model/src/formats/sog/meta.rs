//! `meta.json`: counts, bounds, codebooks and the names of the images, of both versions.

use std::collections::BTreeMap;
use std::path::Path;

use serde::Deserialize;
use serde::de::IgnoredAny;

use crate::error::{Error, Result, excerpt};
use crate::formats::splat::opacity_logit;
use crate::json::without_nan;
use crate::scene::sh_len;

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
    pub(super) antialiased: bool,
    /// The names of the images: low and high bytes of the means, rotations, scales, colours, and where
    /// there is a palette, the palette and the places in it.
    pub(super) files: Vec<String>,
    /// What was read as something else, and what was not read: a sentence each.
    pub(super) notes: Vec<String>,
}

/// The palette of higher SH coefficients.
pub(super) struct Palette {
    pub(super) sh_degree: u8,
    /// Entries, at most.
    pub(super) entries: usize,
    /// The coefficients of the bytes.
    pub(super) values: Vec<f32>,
}

/// What says the version, which version 1 does not, and how the model is drawn.
#[derive(Deserialize)]
struct Version {
    version: Option<u64>,
    /// `antialiased`, as SplatTransform writes it.
    model: Option<String>,
    /// The name of the same in the first versions of the specification.
    antialias: Option<bool>,
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
    #[serde(flatten)]
    others: BTreeMap<String, IgnoredAny>,
}

/// A part of version 2: bytes are indices of a codebook.
#[derive(Deserialize)]
struct CodebookImage {
    codebook: Codebook,
    files: [String; 1],
}

#[derive(Deserialize)]
struct Palette2 {
    count: usize,
    bands: u8,
    codebook: Codebook,
    files: [String; 2],
}

#[derive(Deserialize)]
struct Meta2 {
    count: usize,
    means: Steps<[f64; 3], [String; 2]>,
    scales: CodebookImage,
    quats: Files,
    sh0: CodebookImage,
    #[serde(rename = "shN")]
    sh_n: Option<Palette2>,
    #[serde(flatten)]
    others: BTreeMap<String, IgnoredAny>,
}

/// Numbers in ascending order. JSON makes null of what is not finite.
#[derive(Deserialize)]
struct Codebook(Vec<Option<f32>>);

impl Codebook {
    /// The numbers. One that is missing lies on the line through its neighbours; at the ends, on that through all.
    /// This is what PlayCanvas does for the first. `part` is for the error and the note.
    fn numbers(self, part: &str, notes: &mut Vec<String>) -> Result<Vec<f32>, String> {
        let Self(entries) = self;
        let known = |&k: &usize| entries[k].is_some();
        let at = |k: usize| f64::from(entries[k].unwrap_or_default());
        let missing = entries.iter().filter(|entry| entry.is_none()).count();
        let (first, last) = ((0..entries.len()).find(known), (0..entries.len()).rfind(known));
        let (Some(first), Some(last)) = (first, last) else {
            return Err(format!("{part}: its codebook has no number"));
        };
        let mean_step = (at(last) - at(first)) / (entries.len().max(2) - 1) as f64;
        let number = |k: usize| match k {
            _ if known(&k) => at(k),
            _ if k < first => at(first) - (first - k) as f64 * mean_step,
            _ if k > last => at(last) + (k - last) as f64 * mean_step,
            _ => {
                let below = (0..k).rfind(known).unwrap_or(first);
                let above = (k..last).find(known).unwrap_or(last);
                at(below) + (at(above) - at(below)) * (k - below) as f64 / (above - below) as f64
            }
        };
        if missing > 0 {
            let what = if missing == 1 { "entry" } else { "entries" };
            notes.push(format!(
                "{missing} {what} of the codebook of {part} missing (null); read as the neighbours suggest"
            ));
        }
        Ok((0..entries.len()).map(|k| number(k) as f32).collect())
    }
}

/// A sentence about the parts of a meta.json that are not read.
fn unread(others: BTreeMap<String, IgnoredAny>) -> Vec<String> {
    const SAY_NOTHING: [&str; 2] = ["asset", "version"];
    let names = others.into_keys().filter(|name| !SAY_NOTHING.contains(&name.as_str()));
    names.map(|name| format!("{:?} of meta.json is not used", excerpt(name.as_bytes()))).collect()
}

/// What each byte stands for between two bounds.
fn steps(low: f32, high: f32) -> Vec<f32> {
    let (low, high) = (f64::from(low), f64::from(high));
    (0..=255).map(|b| (low + (high - low) * (f64::from(b) / 255.0)) as f32).collect()
}

impl Meta {
    pub(super) fn parse(file: &Path, json: &[u8]) -> Result<Self> {
        let json = &without_nan(json);
        let not_meta = |e| Error::json(file, "a SOG's meta.json", &e);
        let bad = |reason: String| Error::malformed(file, "meta.json", reason);
        let version: Version = serde_json::from_slice(json).map_err(not_meta)?;
        let antialiased = match version.model {
            Some(model) => model.eq_ignore_ascii_case("antialiased"),
            None => version.antialias == Some(true),
        };
        let meta = match version.version {
            None | Some(1) => {
                let meta = serde_json::from_slice::<Meta1>(json).map_err(not_meta)?.meta();
                meta.map_err(|reason| bad(reason.into()))
            }
            Some(2) => serde_json::from_slice::<Meta2>(json).map_err(not_meta)?.meta().map_err(bad),
            Some(other) => Err(Error::version(file, "SOG", other, "1 and 2 are")),
        };
        Ok(Self { antialiased, ..meta? })
    }

    pub(super) fn sh_degree(&self) -> u8 {
        self.palette.as_ref().map_or(0, |palette| palette.sh_degree)
    }
}

impl Meta1 {
    fn meta(self) -> Result<Meta, &'static str> {
        let Self { means, scales, quats, sh0, sh_n, others } = self;
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
            antialiased: false,
            files,
            notes: unread(others),
        })
    }
}

impl Meta2 {
    fn meta(self) -> Result<Meta, String> {
        let Self { count, means, scales, quats, sh0, sh_n, others } = self;
        let mut files = [&means.files[..], &quats.files, &scales.files, &sh0.files].concat();
        let mut notes = unread(others);
        let palette = sh_n.map(|sh| {
            files.extend(sh.files);
            let values = sh.codebook.numbers("shN", &mut notes)?;
            Ok::<_, String>(Palette { sh_degree: sh.bands, entries: sh.count, values })
        });
        let palette = palette.transpose()?;
        if palette.as_ref().is_some_and(|p| !(1..=3).contains(&p.sh_degree)) {
            return Err("shN: bands is not 1, 2 or 3".into());
        }
        let scale = scales.codebook.numbers("scales", &mut notes)?;
        let colour = sh0.codebook.numbers("sh0", &mut notes)?;
        Ok(Meta {
            version: 2,
            count,
            means: [means.mins, means.maxs],
            scales: [(); 3].map(|()| scale.clone()),
            colours: [(); 3].map(|()| colour.clone()),
            opacities: (0..=255).map(opacity_logit).collect(),
            palette,
            antialiased: false,
            files,
            notes,
        })
    }
}

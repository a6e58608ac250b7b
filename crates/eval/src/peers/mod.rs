//! Other projects' codecs, run as their own tools on the same model: SPZ, splat-transform and the
//! paper's chain around tmc3. Each implements [`Codec`].
//!
//! A tool that is absent or fails is a line of the report, not an error: the curves of this project
//! do not depend on them.

mod splat_transform;
mod spz;
mod tmc3;
mod tool;

use std::path::{Path, PathBuf};
use std::time::Duration;

use anyhow::Result;
use gs_model::{CLAMPED_OPACITY_LOGIT, Invalid, ReadOptions, Scene};
use serde::{Deserialize, Serialize};

use crate::cache::{self, Cache};
use crate::codec::{Codec, measure_point};
use crate::published::{Other, OtherPoint};
use crate::report::{Table, megabits};
use crate::scenes::TestScene;

pub use splat_transform::{Format, SplatTransform};
pub use spz::Spz;
pub use tmc3::Tmc3;

/// Which peers run, and where their tools are.
#[derive(Clone, Debug)]
pub struct Options {
    /// MPEG's tmc3, for the paper's own chain; on the PATH if not given.
    pub tmc3: Option<PathBuf>,
    /// Folder with SPZ's `ply_to_spz` and `spz_to_ply`; on the PATH if not given.
    pub spz: Option<PathBuf>,
    /// PlayCanvas' splat-transform; on the PATH if not given.
    pub splat_transform: Option<PathBuf>,
    /// Let splat-transform make SOG too. Without a GPU that is hours of k-means.
    pub sog: bool,
    /// Longest run of a tool.
    pub limit: Duration,
    /// Run no peer.
    pub none: bool,
}

impl Default for Options {
    fn default() -> Self {
        let limit = Duration::from_secs(600);
        Self { tmc3: None, spz: None, splat_transform: None, sog: false, limit, none: false }
    }
}

/// What came of one peer at one setting.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct Outcome {
    /// Codec.
    pub(crate) peer: String,
    /// Its settings.
    pub(crate) settings: String,
    /// A point, or why there is none.
    pub(crate) fate: Fate,
}

/// A point, or why there is none.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Fate {
    /// It ran.
    Measured(Measured),
    /// It is not here.
    Absent(String),
    /// It is here, but it failed.
    Failed(String),
}

/// A peer's point.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct Measured {
    /// Size of its stream.
    pub(crate) bytes: u64,
    /// Gaussians decoded.
    pub(crate) gaussians: usize,
    /// Mean PSNR at the held-out views, dB.
    pub(crate) psnr_db: f64,
    /// Mean SSIM.
    pub(crate) ssim: f64,
    /// Seconds of its encoder processes.
    pub(crate) encode_seconds: f64,
    /// Seconds of its decoder processes.
    pub(crate) decode_seconds: f64,
}

impl Outcome {
    fn absent(peer: &str, why: impl Into<String>) -> Self {
        Self { peer: peer.into(), settings: String::new(), fate: Fate::Absent(why.into()) }
    }

    /// The line of a peer that has no point.
    pub(crate) fn absence(&self) -> Option<String> {
        match &self.fate {
            Fate::Measured(_) => None,
            Fate::Absent(why) => Some(format!("{}: not run; {why}", self.peer)),
            Fate::Failed(why) => Some(format!("{}, {}: failed; {why}", self.peer, self.settings)),
        }
    }
}

/// Runs one peer at one setting, unless that was done before with the same tool.
fn measured(
    cache: &Cache,
    scene: &TestScene,
    (peer, settings): (&str, &str),
    tool: &Path,
    (codec, quality): (&dyn Codec, f32),
) -> Result<Outcome> {
    let key = (cache::hash_file(tool)?, peer, settings);
    let measure = || -> Result<Measured> {
        let point = measure_point(codec, scene, quality)?;
        Ok(Measured {
            bytes: point.bytes,
            gaussians: point.gaussians,
            psnr_db: point.score.psnr_db,
            ssim: point.score.ssim,
            encode_seconds: point.encode_seconds,
            decode_seconds: point.decode_seconds,
        })
    };
    let fate = match cache.run("peer", &key, measure) {
        Ok(measured) => Fate::Measured(measured),
        Err(why) => Fate::Failed(format!("{why:#}").replace('\n', " ")),
    };
    Ok(Outcome { peer: peer.into(), settings: settings.into(), fate })
}

/// Reads what a peer decoded. Opacities of 0 and 1 come as infinite logits from codecs of 8-bit
/// opacities: such Gaussians are transparent or opaque, not broken.
fn read(path: &Path) -> Result<Scene> {
    let options =
        ReadOptions { invalid: Invalid::Drop, clamp_infinite_opacity: Some(CLAMPED_OPACITY_LOGIT) };
    Ok(gs_model::ply::read_with(path, &options)?.0)
}

/// Runs the peers whose tools are there. `depth` is that of the uniform octree of the paper's chain.
pub(crate) fn run(
    options: &Options,
    cache: &Cache,
    scene: &TestScene,
    depth: u8,
) -> Result<Vec<Outcome>> {
    if options.none {
        return Ok(Vec::new());
    }
    let limit = options.limit;
    let mut out = Vec::new();
    match Spz::find(options.spz.as_deref(), limit) {
        Ok(spz) => {
            out.push(measured(cache, scene, ("SPZ", "default"), spz.program(), (&spz, 0.0))?);
        }
        Err(why) => out.push(Outcome::absent("SPZ", why)),
    }
    let given = options.splat_transform.as_deref();
    for format in Format::ALL {
        match SplatTransform::find(given, format, limit) {
            Err(why) => {
                out.push(Outcome::absent("splat-transform", why));
                break;
            }
            Ok(_) if format == Format::Sog && !options.sog => out.push(Outcome::absent(
                "splat-transform, SOG",
                "hours of k-means without a GPU; --sog --peer-seconds N runs it",
            )),
            Ok(codec) => {
                let names = ("splat-transform", format.name());
                out.push(measured(cache, scene, names, codec.program(), (&codec, 0.0))?);
            }
        }
    }
    match Tmc3::find(options.tmc3.as_deref(), depth, limit) {
        Ok(tmc3) => {
            for quality in tmc3::QUALITIES {
                let settings = tmc3.settings(quality);
                let codec: (&dyn Codec, f32) = (&tmc3, quality);
                out.push(measured(cache, scene, ("tmc3", &settings), tmc3.program(), codec)?);
            }
        }
        Err(why) => out.push(Outcome::absent("tmc3", why)),
    }
    Ok(out)
}

/// The points of those that ran.
pub(crate) fn table(all: &[Outcome]) -> Table {
    let mut table = Table::new(&[
        "peer",
        "settings",
        "bytes",
        "Mbit",
        "PSNR dB",
        "SSIM",
        "Gaussians",
        "encode s",
        "decode s",
    ]);
    for outcome in all {
        let Fate::Measured(m) = &outcome.fate else { continue };
        table.rows.push(vec![
            outcome.peer.clone(),
            outcome.settings.clone(),
            m.bytes.to_string(),
            megabits(m.bytes),
            format!("{:.3}", m.psnr_db),
            format!("{:.4}", m.ssim),
            m.gaussians.to_string(),
            format!("{:.2}", m.encode_seconds),
            format!("{:.2}", m.decode_seconds),
        ]);
    }
    table
}

/// The points as curves: tmc3's settings are one, each format of the other tools is its own.
pub(crate) fn curves(all: &[Outcome]) -> Vec<Other> {
    let mut out: Vec<Other> = Vec::new();
    for outcome in all {
        let Fate::Measured(m) = &outcome.fate else { continue };
        let point = OtherPoint {
            label: outcome.settings.clone(),
            bytes: m.bytes,
            psnr_db: m.psnr_db,
            ssim: Some(m.ssim),
        };
        let name = match outcome.peer.as_str() {
            "tmc3" => "paper's chain (tmc3)".to_owned(),
            peer => format!("{peer}, {}", outcome.settings),
        };
        match out.iter_mut().find(|o| o.name == name) {
            Some(other) => other.points.push(point),
            None => out.push(Other { name, source: "run here".into(), points: vec![point] }),
        }
    }
    out
}

#[cfg(test)]
mod tests;

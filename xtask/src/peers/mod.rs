//! Other codecs' own tools, run on the same model and rendered like ours.
//!
//! A tool that is not there is a line of the report, and so is one that fails: what we measure of
//! ourselves does not depend on them.

mod splat_transform;
mod spz;
mod tmc3;
mod tool;

use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use gs_model::Scene;
use gs_model::ply::{CLAMPED_OPACITY_LOGIT, Invalid, ReadOptions};
use serde::{Deserialize, Serialize};

use crate::cache::{self, Cache};
use crate::measure::{self, Shot};
use crate::progress::Bar;
use crate::published::{Other, OtherPoint};
use crate::report::{Table, megabits};

/// Where the peers' tools are.
#[derive(Clone, Debug, Default, clap::Args)]
pub(crate) struct Flags {
    /// MPEG's tmc3, for the paper's own chain [default: on the PATH]
    #[arg(long, value_name = "FILE", help_heading = "Peers")]
    tmc3: Option<PathBuf>,
    /// Folder with SPZ's ply_to_spz and spz_to_ply [default: on the PATH]
    #[arg(long, value_name = "DIR", help_heading = "Peers")]
    spz: Option<PathBuf>,
    /// PlayCanvas' splat-transform [default: on the PATH]
    #[arg(long, value_name = "FILE", help_heading = "Peers")]
    splat_transform: Option<PathBuf>,
    /// Let splat-transform make SOG too: without a GPU, hours of k-means
    #[arg(long, help_heading = "Peers")]
    sog: bool,
    /// Longest run of a peer's tool, in seconds
    #[arg(long, default_value_t = 600, value_parser = clap::value_parser!(u64).range(1..), help_heading = "Peers")]
    peer_seconds: u64,
    /// Run no peer
    #[arg(long, help_heading = "Peers")]
    no_peers: bool,
}

/// What came of one peer at one setting.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct Outcome {
    /// Codec.
    pub(crate) peer: String,
    /// Its settings.
    pub(crate) settings: String,
    /// Measured, or why not.
    pub(crate) fate: Fate,
}

/// Measured, or why not.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Fate {
    /// It ran.
    Measured(Measured),
    /// It is not here.
    Absent(String),
    /// It is here and did not work.
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

/// What a peer works on.
pub(crate) struct Task<'a> {
    /// Finished stages.
    pub(crate) cache: &'a Cache,
    /// The model's file.
    pub(crate) model: &'a Path,
    /// The same, read.
    pub(crate) scene: &'a Scene,
    /// Where its quality is measured.
    pub(crate) shots: &'a [Shot],
    /// Depth of the octree, for a codec that needs one.
    pub(crate) depth: u8,
}

/// What a peer's encoder and decoder made.
struct Coded {
    bytes: u64,
    scene: Scene,
    encode_seconds: f64,
    decode_seconds: f64,
}

impl Task<'_> {
    /// Runs `work` in an empty folder and measures what it decoded, unless that was done before
    /// with the same tool.
    fn measure(
        &self,
        peer: &str,
        settings: &str,
        tool: &Path,
        work: impl FnOnce(&Path) -> Result<Coded>,
    ) -> Result<Outcome> {
        let key = (cache::hash_file(tool)?, peer, settings);
        let measured = || -> Result<Measured> {
            let dir = tempfile::tempdir().context("make a folder for a peer")?;
            let bar = Bar::new(&format!("{peer}, {settings}"), self.shots.len() as u64);
            let coded = work(dir.path())?;
            let (score, _) = measure::score(&coded.scene, self.shots, &bar);
            bar.done();
            Ok(Measured {
                bytes: coded.bytes,
                gaussians: coded.scene.len(),
                psnr_db: score.psnr_db,
                ssim: score.ssim,
                encode_seconds: coded.encode_seconds,
                decode_seconds: coded.decode_seconds,
            })
        };
        let fate = match self.cache.run("peer", &key, measured) {
            Ok(measured) => Fate::Measured(measured),
            Err(why) => Fate::Failed(format!("{why:#}").replace('\n', " ")),
        };
        Ok(Outcome { peer: peer.into(), settings: settings.into(), fate })
    }
}

/// Reads what a peer decoded. Opacities of 0 and 1 come as infinite logits from codecs of 8-bit
/// opacities: such Gaussians are transparent or opaque, not broken.
fn read(path: &Path) -> Result<Scene> {
    let options =
        ReadOptions { invalid: Invalid::Drop, clamp_infinite_opacity: Some(CLAMPED_OPACITY_LOGIT) };
    Ok(gs_model::ply::read_with(path, &options)?.0)
}

/// Runs the peers that are there.
pub(crate) fn run(flags: &Flags, task: &Task<'_>) -> Result<Vec<Outcome>> {
    if flags.no_peers {
        return Ok(Vec::new());
    }
    let limit = std::time::Duration::from_secs(flags.peer_seconds);
    let mut out = Vec::new();
    match tool::pair(flags.spz.as_deref(), ["ply_to_spz", "spz_to_ply"]) {
        Ok([encoder, decoder]) => out.push(spz::run(task, &encoder, &decoder, limit)?),
        Err(why) => out.push(Outcome::absent("SPZ", why)),
    }
    match tool::find(flags.splat_transform.as_deref(), "splat-transform") {
        Ok(tool) => out.extend(splat_transform::run(task, &tool, flags.sog, limit)?),
        Err(why) => out.push(Outcome::absent("splat-transform", why)),
    }
    match tool::find(flags.tmc3.as_deref(), "tmc3") {
        Ok(tool) => out.extend(tmc3::run(task, &tool, limit)?),
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
            "tmc3" => "paper's chain (tmc3), run here".to_owned(),
            peer => format!("{peer}, {}, run here", outcome.settings),
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

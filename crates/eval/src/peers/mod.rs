//! Other projects' codecs, run as their own tools on the same model: SPZ, splat-transform and the
//! paper's chain around tmc3.
//!
//! A tool that is absent or fails is a line of the report, not an error: the curves of this project
//! do not depend on them.

mod converter;
mod tmc3;
mod tool;

use std::path::{Path, PathBuf};
use std::time::Duration;

use anyhow::Result;
use gs_model::{CLAMPED_OPACITY_LOGIT, Invalid, ReadOptions, Scene};
use serde::{Deserialize, Serialize};

use crate::cache::{self, Cache};
use crate::cells;
use crate::codec::{Codec, CodedPoint, measure_point};
use crate::page::Table;
use crate::published::{Other, OtherPoint};
use crate::report::megabits;
use crate::scenes::TestScene;

use converter::Converter;
use tmc3::Tmc3;

/// Which peers run, and where their tools are.
#[derive(Clone, Debug, clap::Args)]
#[cfg_attr(test, derive(Default))]
#[command(next_help_heading = "Peers")]
pub(crate) struct PeerOptions {
    /// MPEG's tmc3, for the paper's own chain [default: on the PATH]
    #[arg(long, value_name = "FILE")]
    tmc3: Option<PathBuf>,
    /// Folder with SPZ's ply_to_spz and spz_to_ply [default: on the PATH]
    #[arg(long, value_name = "DIR")]
    spz: Option<PathBuf>,
    /// PlayCanvas' splat-transform [default: on the PATH]
    #[arg(long, value_name = "FILE")]
    splat_transform: Option<PathBuf>,
    /// Let splat-transform make SOG too: without a GPU, hours of k-means
    #[arg(long)]
    sog: bool,
    /// Longest run of a peer's tool, in seconds
    #[arg(long, default_value_t = 600, value_parser = clap::value_parser!(u64).range(1..))]
    peer_seconds: u64,
    /// Run no peer
    #[arg(long)]
    pub(crate) no_peers: bool,
}

/// What came of one peer at one setting.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct ToolOutcome {
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
    Measured(CodedPoint),
    /// It is not here.
    Absent(String),
    /// It is here, but it failed.
    Failed(String),
}

impl ToolOutcome {
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

/// A peer at one setting.
struct Setting<'a> {
    peer: &'a str,
    settings: &'a str,
    /// Its program, whose hash tells versions apart.
    tool: &'a Path,
    codec: &'a dyn Codec,
    quality: f32,
}

/// Runs one peer at one setting, unless that was done before with the same tool.
fn measured(cache: &Cache, scene: &TestScene, of: &Setting<'_>) -> Result<ToolOutcome> {
    let key = (cache::hash_file(of.tool)?, of.peer, of.settings);
    let fate = match cache.run("peer", &key, || measure_point(of.codec, scene, of.quality)) {
        Ok(point) => Fate::Measured(point),
        Err(why) => Fate::Failed(format!("{why:#}").replace('\n', " ")),
    };
    Ok(ToolOutcome { peer: of.peer.into(), settings: of.settings.into(), fate })
}

/// Reads what a peer decoded. Opacities of 0 and 1 come as infinite logits from codecs of 8-bit
/// opacities: such Gaussians are transparent or opaque, not broken.
fn read(path: &Path) -> Result<Scene> {
    let options = ReadOptions {
        invalid: Invalid::Drop,
        clamp_infinite_opacity: Some(CLAMPED_OPACITY_LOGIT),
        ..Default::default()
    };
    Ok(gs_model::ply::read_with(path, &options)?.0)
}

/// Runs the peers whose tools are there. `depth` is that of the uniform octree of the paper's chain.
pub(crate) fn run(
    options: &PeerOptions,
    cache: &Cache,
    scene: &TestScene,
    depth: u8,
) -> Result<Vec<ToolOutcome>> {
    if options.no_peers {
        return Ok(Vec::new());
    }
    let limit = Duration::from_secs(options.peer_seconds);
    let mut out = Vec::new();
    let mut convert = |peer: &str, found: Result<Converter, String>| -> Result<()> {
        out.push(match found {
            Err(why) => ToolOutcome::absent(peer, why),
            Ok(codec) => {
                let (settings, tool) = (codec.format, codec.program());
                measured(
                    cache,
                    scene,
                    &Setting { peer, settings, tool, codec: &codec, quality: 0.0 },
                )?
            }
        });
        Ok(())
    };
    convert("SPZ", Converter::spz(options.spz.as_deref(), limit))?;
    let given = options.splat_transform.as_deref();
    for format in [converter::COMPRESSED_PLY, converter::SPZ] {
        convert("splat-transform", Converter::splat_transform(given, format, limit))?;
    }
    let sog = match options.sog {
        true => Converter::splat_transform(given, converter::SOG, limit),
        false => Err("hours of k-means without a GPU; --sog --peer-seconds N runs it".into()),
    };
    convert(if sog.is_ok() { "splat-transform" } else { "splat-transform, SOG" }, sog)?;
    match Tmc3::find(options.tmc3.as_deref(), depth, limit) {
        Ok(tmc3) => {
            for quality in tmc3::QUALITIES {
                let (settings, tool) = (&tmc3.settings(quality), tmc3.program());
                let of = Setting { peer: "tmc3", settings, tool, codec: &tmc3, quality };
                out.push(measured(cache, scene, &of)?);
            }
        }
        Err(why) => out.push(ToolOutcome::absent("tmc3", why)),
    }
    // Without splat-transform, neither of its formats is there: one line.
    out.dedup_by_key(|o| o.absence().unwrap_or(o.settings.clone()));
    Ok(out)
}

/// The points of those that ran.
pub(crate) fn table(all: &[ToolOutcome]) -> Table {
    let mut table = Table::new(
        "peer | settings | bytes | Mbit | PSNR dB | SSIM | Gaussians | encode s | decode s",
    );
    for outcome in all {
        let Fate::Measured(m) = &outcome.fate else { continue };
        table.row(cells![
            outcome.peer,
            outcome.settings,
            m.bytes,
            megabits(m.bytes),
            format!("{:.3}", m.score.psnr_db),
            format!("{:.4}", m.score.ssim),
            m.gaussians,
            format!("{:.2}", m.encode_seconds),
            format!("{:.2}", m.decode_seconds),
        ]);
    }
    table
}

/// The points as curves: tmc3's settings are one, each format of the other tools is its own.
pub(crate) fn curves(all: &[ToolOutcome]) -> Vec<Other> {
    let mut out: Vec<Other> = Vec::new();
    for outcome in all {
        let Fate::Measured(m) = &outcome.fate else { continue };
        let point = OtherPoint {
            label: outcome.settings.clone(),
            bytes: m.bytes,
            psnr_db: m.score.psnr_db,
            ssim: Some(m.score.ssim),
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

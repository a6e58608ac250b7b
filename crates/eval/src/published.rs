//! Points of other codecs: those of `data/published.json`, which were published, and those recorded
//! beside a scene (`paper-chain.json`, `peers.json`).

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use anyhow::{Context, Result};
use serde::{Deserialize, Serialize};

use crate::bd::Point;
use crate::measure::Metric;

/// `data/published.json`.
#[derive(Deserialize)]
struct Published {
    scenes: BTreeMap<String, PublishedScene>,
}

/// The curves of one scene.
#[derive(Deserialize)]
struct PublishedScene {
    lists: Vec<List>,
}

/// One curve.
#[derive(Deserialize)]
struct List {
    /// Codec and configuration.
    name: String,
    /// Covariance mode, for the paper's own lists.
    covariance: Option<String>,
    /// Bits to one unit of the rates below.
    unit_bits: f64,
    /// Rate and PSNR in dB.
    points: Vec<[f64; 2]>,
}

/// The published curves of a scene; they are built in.
fn published(scene: &str) -> Result<Vec<Other>> {
    let text = include_str!("../data/published.json");
    let all: Published = serde_json::from_str(text).context("data/published.json")?;
    let lists = all.scenes.get(scene).map(|s| s.lists.as_slice()).unwrap_or_default();
    Ok(lists.iter().map(List::other).collect())
}

/// All points that the paper's authors published of a scene, uniform and adaptive.
pub(crate) fn uniform_and_adaptive(scene: &str) -> Result<[Vec<Point>; 2]> {
    let all = published(scene)?;
    Ok(["paper, uniform", "paper, adaptive"].map(|name| {
        all.iter()
            .filter(|o| o.name.starts_with(name))
            .flat_map(|o| o.rates(Metric::Psnr))
            .collect()
    }))
}

/// A curve of another codec on a scene, in bytes.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct Other {
    /// Codec and configuration.
    pub(crate) name: String,
    /// Where the points come from.
    pub(crate) source: String,
    /// Its points: bytes, PSNR in dB, SSIM where known.
    pub(crate) points: Vec<OtherPoint>,
}

/// One point of an [`Other`].
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct OtherPoint {
    /// What distinguishes the point (settings).
    pub(crate) label: String,
    /// Size in bytes.
    pub(crate) bytes: u64,
    /// Mean PSNR, dB.
    pub(crate) psnr_db: f64,
    /// Mean SSIM.
    pub(crate) ssim: Option<f64>,
    /// Mean SSIMULACRA2; recorded and published points have none.
    pub(crate) ssimulacra2: Option<f64>,
}

impl OtherPoint {
    /// Its bytes and its score, if that is known.
    pub(crate) fn rate(&self, metric: Metric) -> Option<Point> {
        let score = match metric {
            Metric::Psnr => Some(self.psnr_db),
            Metric::Ssim => self.ssim,
            Metric::Ssimulacra2 => self.ssimulacra2,
        };
        Some(Point { rate: self.bytes as f64, score: score? })
    }
}

impl Other {
    /// Whether the points are of another model of the same photos.
    pub(crate) fn is_published(&self) -> bool {
        self.source.starts_with("published")
    }

    /// Whether a BD-rate against it means something: it was measured on this very model, at three rates or more.
    pub(crate) fn is_comparable(&self) -> bool {
        self.points.len() >= 3 && !self.is_published()
    }

    /// The points of which the score is known, with rates in bytes.
    pub(crate) fn rates(&self, metric: Metric) -> Vec<Point> {
        self.points.iter().filter_map(|p| p.rate(metric)).collect()
    }
}

/// `paper-chain.json` beside a scene.
#[derive(Deserialize)]
struct PaperChain {
    points: Vec<PaperPoint>,
}

#[derive(Deserialize)]
struct PaperPoint {
    voxelization: String,
    qp_ac_dc_opacity: [i32; 3],
    total_bytes: u64,
    psnr_db: f64,
    ssim: f64,
}

/// One entry of `peers.json` beside a scene.
#[derive(Deserialize)]
struct Peer {
    peer: String,
    total_bytes: u64,
    psnr_db: f64,
    ssim: f64,
}

/// How the names of the paper's lists without initialisation (Fig. 6 and 7) begin; reports leave them out.
pub(crate) const NO_INIT: &str = "paper, no initialisation";

/// Name of the curve that holds the paper's coding chain as recorded beside a scene.
pub(crate) const PAPER_CHAIN: &str = "paper's chain (TMC13)";

/// What is known of other codecs on the scene in `dir` called `name`.
pub(crate) fn others(dir: &Path, name: &str) -> Result<Vec<Other>> {
    let mut out = Vec::new();
    if let Some(chain) = json::<PaperChain>(&dir.join("paper-chain.json"))? {
        let points = chain.points.into_iter().map(|p| {
            let [ac, dc, opacity] = p.qp_ac_dc_opacity;
            OtherPoint {
                label: format!("{}, QP {ac}/{dc}/{opacity}", p.voxelization),
                bytes: p.total_bytes,
                psnr_db: p.psnr_db,
                ssim: Some(p.ssim),
                ssimulacra2: None,
            }
        });
        let source = "paper-chain.json, recorded with the authors' tools".to_owned();
        out.push(Other { name: PAPER_CHAIN.to_owned(), source, points: points.collect() });
    }
    if let Some(peers) = json::<Vec<Peer>>(&dir.join("peers.json"))? {
        let mut families: BTreeMap<String, Vec<OtherPoint>> = BTreeMap::new();
        for p in peers {
            let family = p.peer.split([',', '(']).next().unwrap_or_default().trim().to_owned();
            let (bytes, psnr_db, ssim) = (p.total_bytes, p.psnr_db, Some(p.ssim));
            let point = OtherPoint { label: p.peer, bytes, psnr_db, ssim, ssimulacra2: None };
            families.entry(family).or_default().push(point);
        }
        for (name, points) in families {
            out.push(Other { name, source: "peers.json, recorded".to_owned(), points });
        }
    }
    out.extend(published(name)?);
    Ok(out)
}

impl List {
    fn other(&self) -> Other {
        let name = match &self.covariance {
            Some(mode) => format!("{}, {mode} covariance", self.name),
            None => self.name.clone(),
        };
        let point = |&[rate, psnr_db]: &[f64; 2]| OtherPoint {
            label: String::new(),
            bytes: (rate * self.unit_bits / 8.0).round() as u64,
            psnr_db,
            ssim: None,
            ssimulacra2: None,
        };
        let source = "published by the paper's authors; another model of the same photos".into();
        Other { name, source, points: self.points.iter().map(point).collect() }
    }
}

/// A JSON file, or `None` if there is none.
fn json<T: serde::de::DeserializeOwned>(path: &Path) -> Result<Option<T>> {
    if !path.is_file() {
        return Ok(None);
    }
    let text = fs::read_to_string(path).with_context(|| format!("read {}", path.display()))?;
    let value = serde_json::from_str(&text).with_context(|| format!("parse {}", path.display()))?;
    Ok(Some(value))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn their_megabits_become_bytes() {
        let other = others(Path::new("no such folder"), "playroom").unwrap();
        let uniform = other.iter().find(|o| o.name.starts_with("paper, uniform")).unwrap();
        // 137.46453 Mibit.
        assert_eq!(uniform.points[0].bytes, 18_017_751);
        let rdo = other.iter().find(|o| o.name == "RDO-GS").unwrap();
        assert_eq!(rdo.points[0].bytes, 13_110_000);
        assert!(rdo.is_published());
    }

    #[test]
    fn recorded_files_are_read() {
        let dir = tempfile::tempdir().unwrap();
        fs::write(
            dir.path().join("peers.json"),
            r#"[{"peer": "SPZ v4, a", "total_bytes": 5, "psnr_db": 30.0, "ssim": 0.9},
                {"peer": "SPZ v4, b", "total_bytes": 7, "psnr_db": 31.0, "ssim": 0.9}]"#,
        )
        .unwrap();
        let other = others(dir.path(), "nameless").unwrap();
        assert_eq!((other.len(), other[0].points.len()), (1, 2));
        fs::write(dir.path().join("peers.json"), "[").unwrap();
        let error = format!("{:#}", others(dir.path(), "nameless").unwrap_err());
        assert!(error.contains("peers.json"), "{error}");
    }
}

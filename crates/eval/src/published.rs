//! Points of other codecs: those of `data/published.json`, which were published, and those recorded
//! beside a scene (`paper-chain.json`, `peers.json`).

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use anyhow::{Context, Result};
use serde::Deserialize;

use crate::bd::Point;
use crate::measure::{Metric, Score};
use crate::record::{Curve, Record};

/// `data/published.json`.
#[derive(Deserialize)]
struct PublishedCurves {
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
fn published(scene: &str) -> Result<Vec<Curve>> {
    let text = include_str!("../data/published.json");
    let mut all: PublishedCurves = serde_json::from_str(text).context("data/published.json")?;
    let lists = all.scenes.remove(scene).map(|s| s.lists).unwrap_or_default();
    Ok(lists.into_iter().map(List::curve).collect())
}

/// All points that the paper's authors published of a scene, uniform and adaptive.
pub(crate) fn uniform_and_adaptive(scene: &str) -> Result<[Vec<Point>; 2]> {
    let all = published(scene)?;
    Ok(["paper, uniform", "paper, adaptive"].map(|name| {
        let named = all.iter().filter(|c| c.name.starts_with(name));
        named.flat_map(|c| c.rates(Metric::Psnr)).collect()
    }))
}

impl List {
    fn curve(self) -> Curve {
        let name = match &self.covariance {
            Some(mode) => format!("{}, {mode} covariance", self.name),
            None => self.name,
        };
        let bytes = |rate: f64| (rate * self.unit_bits / 8.0).round() as u64;
        let points = self.points.iter().map(|&[rate, db]| point("", bytes(rate), db, f64::NAN));
        let what = "published by the paper's authors; another model of the same photos".into();
        Curve { name, what, points: points.collect(), ..Curve::default() }
    }
}

/// A point of which no more is known.
fn point(setting: &str, bytes: u64, psnr_db: f64, ssim: f64) -> Record {
    let score = Score { psnr_db, ssim, ..Score::default() };
    Record { setting: setting.to_owned(), bytes, score, ..Record::default() }
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

/// Name of the curve that holds the paper's coding chain as recorded beside a scene.
pub(crate) const PAPER_CHAIN: &str = "paper's chain (TMC13)";

/// What is known of other codecs on the scene in `dir` called `name`.
pub(crate) fn others(dir: &Path, name: &str) -> Result<Vec<Curve>> {
    let mut out = Vec::new();
    let mut add = |name: String, what: &str, points| {
        out.push(Curve { name, what: what.into(), points, ..Curve::default() });
    };
    if let Some(chain) = json::<PaperChain>(&dir.join("paper-chain.json"))? {
        let point = |p: PaperPoint| {
            let [ac, dc, opacity] = p.qp_ac_dc_opacity;
            let setting = format!("{}, QP {ac}/{dc}/{opacity}", p.voxelization);
            point(&setting, p.total_bytes, p.psnr_db, p.ssim)
        };
        let points = chain.points.into_iter().map(point).collect();
        add(PAPER_CHAIN.into(), "paper-chain.json, recorded with the authors' tools", points);
    }
    let mut families: BTreeMap<String, Vec<Record>> = BTreeMap::new();
    for p in json::<Vec<Peer>>(&dir.join("peers.json"))?.unwrap_or_default() {
        let family = p.peer.split([',', '(']).next().unwrap_or_default().trim().to_owned();
        let point = point(&p.peer, p.total_bytes, p.psnr_db, p.ssim);
        families.entry(family).or_default().push(point);
    }
    families.into_iter().for_each(|(name, points)| add(name, "peers.json, recorded", points));
    out.extend(published(name)?);
    Ok(out)
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

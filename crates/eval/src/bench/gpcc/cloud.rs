//! The test clouds and the peer's recorded results.

use std::path::Path;

use anyhow::{Context, Result};
use gpcc_lite::{Leaf, Octree, morton};

use crate::cloud::{self, Channels};

/// A voxelized cloud with one attribute, in Morton order.
pub(super) struct Cloud {
    pub(super) octree: Octree,
    /// Three 8-bit channels, or one 16-bit channel.
    pub(super) channels: Vec<Vec<i32>>,
}

/// Reads the cloud `name` with an attribute; nothing if it is not there. The octree depth ends its name.
pub(super) fn read(dir: &Path, name: &str, attribute: &str) -> Result<Option<Cloud>> {
    let path = dir.join(format!("{name}_{attribute}.ply"));
    if !path.exists() {
        return Ok(None);
    }
    let j =
        name.trim_start_matches(char::is_alphabetic).parse().context("a cloud without depth")?;
    let (positions, channels) = cloud::read(&path)?;
    let leaf = |&p: &[u32; 3]| Leaf { morton: morton::encode(p), depth: j };
    let channels = match channels {
        Channels::Colour(all) => {
            (0..3).map(|c| all.iter().map(|v| i32::from(v[c])).collect()).collect()
        }
        Channels::Scalar(all) => vec![all.into_iter().map(i32::from).collect()],
    };
    let octree = Octree::of_points(j, positions.iter().map(leaf).collect())?;
    Ok(Some(Cloud { octree, channels }))
}

/// One recorded run of the peer.
#[derive(Clone, Debug)]
pub(super) struct Peer {
    pub(super) name: String,
    pub(super) cloud: String,
    pub(super) attribute: String,
    pub(super) geometry_bits: f64,
    pub(super) attribute_bits: f64,
    /// Sum over channels, in stored 8-bit units (16-bit ones divided by 257).
    pub(super) mse: f64,
}

/// Reads `tmc13.jsonl`.
pub(super) fn peers(path: &Path) -> Result<Vec<Peer>> {
    let text = std::fs::read_to_string(path).with_context(|| format!("read {}", path.display()))?;
    let peer = |line: &str| {
        let v: serde_json::Value = serde_json::from_str(line)?;
        let s = |k: &str| v[k].as_str().unwrap_or_default().to_string();
        let f = |k: &str| v[k].as_f64().unwrap_or(0.0);
        let mse = match v["mse_yuv"].as_array() {
            Some(a) => a.iter().filter_map(serde_json::Value::as_f64).sum(),
            None => f("mse") / (257.0 * 257.0),
        };
        Ok(Peer {
            name: s("name"),
            cloud: s("cloud"),
            attribute: s("attr"),
            geometry_bits: f("geo_bpp"),
            attribute_bits: f("col_bpp") + f("ref_bpp"),
            mse,
        })
    };
    text.lines().map(peer).collect()
}

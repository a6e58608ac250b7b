//! Reading the test clouds and the peer's recorded results.

use std::path::Path;

use anyhow::{Context, Result, bail};
use gpcc_lite::{Leaf, morton};

/// A voxelized cloud with one attribute, in Morton order.
pub(super) struct Cloud {
    pub(super) leaves: Vec<Leaf>,
    pub(super) j: u8,
    /// Three 8-bit channels, or one 16-bit channel.
    pub(super) channels: Vec<Vec<i32>>,
}

/// The octree depth that ends a cloud's name.
pub(super) fn depth_of(name: &str) -> Result<u8> {
    name.trim_start_matches(char::is_alphabetic).parse().context("cloud name without depth")
}

/// Reads `NAME_ATTR.ply`: float32 x, y, z, then three uchar or one ushort.
pub(super) fn read(path: &Path, j: u8) -> Result<Cloud> {
    let data = std::fs::read(path).with_context(|| format!("cannot read {}", path.display()))?;
    let end = data
        .windows(11)
        .position(|w| w == b"end_header\n")
        .with_context(|| format!("{}: no end_header", path.display()))?
        + 11;
    let header = String::from_utf8_lossy(&data[..end]);
    let n: usize = header
        .lines()
        .find_map(|l| l.strip_prefix("element vertex "))
        .context("no vertex count")?
        .trim()
        .parse()?;
    let wide = header.contains("ushort reflectance");
    let row = if wide { 14 } else { 15 };
    let body = &data[end..];
    if body.len() != n * row {
        bail!("{}: {} bytes for {n} rows of {row}", path.display(), body.len());
    }
    let mut points: Vec<(u64, [i32; 3])> = body
        .chunks_exact(row)
        .map(|r| {
            let axis = |k: usize| f32::from_le_bytes([r[k], r[k + 1], r[k + 2], r[k + 3]]) as u32;
            let value = if wide {
                [i32::from(u16::from_le_bytes([r[12], r[13]])), 0, 0]
            } else {
                [i32::from(r[12]), i32::from(r[13]), i32::from(r[14])]
            };
            (morton::encode([axis(0), axis(4), axis(8)]), value)
        })
        .collect();
    points.sort_unstable();
    let width = if wide { 1 } else { 3 };
    Ok(Cloud {
        leaves: points.iter().map(|p| Leaf { morton: p.0, depth: j }).collect(),
        j,
        channels: (0..width).map(|c| points.iter().map(|p| p.1[c]).collect()).collect(),
    })
}

/// One recorded run of the peer.
#[derive(Clone, Debug)]
pub(super) struct Peer {
    pub(super) name: String,
    pub(super) cloud: String,
    pub(super) attr: String,
    pub(super) qp: Option<u8>,
    pub(super) geo_bpp: f64,
    pub(super) attr_bpp: f64,
    /// Sum over channels, in stored 8-bit units (16-bit ones divided by 257).
    pub(super) mse: f64,
}

/// Reads `tmc13.jsonl`.
pub(super) fn peers(path: &Path) -> Result<Vec<Peer>> {
    let text =
        std::fs::read_to_string(path).with_context(|| format!("cannot read {}", path.display()))?;
    text.lines()
        .map(|line| {
            let v: serde_json::Value = serde_json::from_str(line)?;
            let s = |k: &str| v[k].as_str().unwrap_or_default().to_string();
            let f = |k: &str| v[k].as_f64().unwrap_or(0.0);
            let mse = match v["mse_yuv"].as_array() {
                Some(a) => a.iter().filter_map(serde_json::Value::as_f64).sum(),
                None => f("mse") / (257.0 * 257.0),
            };
            let qp = s("args")
                .split_whitespace()
                .find_map(|a| a.strip_prefix("--qp=").and_then(|q| q.parse().ok()));
            Ok(Peer {
                name: s("name"),
                cloud: s("cloud"),
                attr: s("attr"),
                qp,
                geo_bpp: f("geo_bpp"),
                attr_bpp: f("col_bpp") + f("ref_bpp"),
                mse,
            })
        })
        .collect()
}

//! Our rates beside the peer's: geometry and lossless channels. Lossy channels are in [`super::lossy`].

use std::fmt::Write as _;
use std::path::Path;

use anyhow::{Result, ensure};
use gpcc_lite::predict::{self, Neighbours};
use gpcc_lite::{Limits, geometry};

use super::cloud::{Peer, depth_of, read};
use super::speed::best;

/// Bits per point, or a dash where the peer has no record.
fn bits(x: f64) -> String {
    if x.is_nan() { "-".into() } else { format!("{x:.3}") }
}

/// `ours` against `theirs` in percent.
fn against(ours: f64, theirs: f64) -> String {
    if theirs.is_nan() { "-".into() } else { format!("{:+.2} %", (ours / theirs - 1.0) * 100.0) }
}

/// Cells of a row: the peer with the authors' settings and at its best, ours, and ours against both.
fn cells(authors: f64, best: f64, ours: f64) -> String {
    format!(
        "{} | {} | {ours:.3} | {} | {}",
        bits(authors),
        bits(best),
        against(ours, authors),
        against(ours, best)
    )
}

/// Geometry of each cloud against the authors' settings and the best of the peer's options.
pub(super) fn geometry_table(dir: &Path, clouds: &[&str], peers: &[Peer]) -> Result<String> {
    let mut out = String::from(
        "| cloud | points | TMC13 authors (colour) | TMC13 best | gpcc-lite | against authors | against best | encode / decode s |\n|---|---|---|---|---|---|---|---|\n",
    );
    for name in clouds {
        let cloud = read(&dir.join(format!("{name}_dc.ply")), depth_of(name)?)?;
        let n = cloud.leaves.len() as f64;
        let (enc, bytes) = best(3, || geometry::encode(&cloud.leaves, cloud.j));
        let bytes = bytes?;
        let (dec, back) = best(3, || geometry::decode(&bytes, &Limits::for_stream(bytes.len())));
        let back = back?;
        ensure!(back.leaves == cloud.leaves, "{name}: geometry differs");
        let bpp = bytes.len() as f64 * 8.0 / n;
        let of = |p: &&Peer| p.cloud == *name && p.name.starts_with("g_") && p.geo_bpp > 0.0;
        let authors =
            peers.iter().filter(of).find(|p| p.name == "g_default").map_or(f64::NAN, |p| p.geo_bpp);
        let best = peers.iter().filter(of).map(|p| p.geo_bpp).fold(f64::NAN, f64::min);
        writeln!(out, "| {name} | {n} | {} | {enc:.3} / {dec:.3} |", cells(authors, best, bpp))?;
    }
    Ok(out)
}

/// Lossless channels.
pub(super) fn lossless_table(
    dir: &Path,
    clouds: &[&str],
    attrs: &[&str],
    peers: &[Peer],
) -> Result<String> {
    let mut out = String::from(
        "| cloud | attribute | TMC13 authors | TMC13 best | gpcc-lite | against authors | against best | neighbours s | encode / decode s |\n|---|---|---|---|---|---|---|---|---|\n",
    );
    for name in clouds {
        for attr in attrs {
            let path = dir.join(format!("{name}_{attr}.ply"));
            if !path.exists() {
                continue;
            }
            let cloud = read(&path, depth_of(name)?)?;
            let n = cloud.leaves.len() as f64;
            let (find, near) = best(1, || Neighbours::new(&cloud.leaves, cloud.j));
            let near = near?;
            let refs: Vec<&[i32]> = cloud.channels.iter().map(Vec::as_slice).collect();
            let (enc, bytes) = best(1, || predict::encode_lossless(&near, &refs));
            let bytes = bytes?;
            let (dec, back) = best(1, || predict::decode_lossless(&near, &bytes, refs.len()));
            ensure!(back? == cloud.channels, "{name} {attr}: channels differ");
            let bpp = bytes.len() as f64 * 8.0 / n;
            let of =
                |p: &&Peer| p.cloud == *name && p.attr == *attr && p.mse == 0.0 && p.attr_bpp > 0.0;
            let authors = peers
                .iter()
                .filter(of)
                .find(|p| p.name == "p_auth" || p.name == "p_auth_col")
                .map_or(f64::NAN, |p| p.attr_bpp);
            let best = peers.iter().filter(of).map(|p| p.attr_bpp).fold(f64::NAN, f64::min);
            writeln!(
                out,
                "| {name} | {attr} | {} | {find:.3} | {enc:.3} / {dec:.3} |",
                cells(authors, best, bpp)
            )?;
        }
    }
    Ok(out)
}

//! Our rates beside the peer's.

use std::fmt::Write as _;
use std::path::Path;
use std::time::Instant;

use anyhow::{Context, Result, ensure};
use gpcc_lite::attribute::{self, Options};
use gpcc_lite::coeffs::Mode;
use gpcc_lite::predict::{self, Neighbours};
use gpcc_lite::quant::Step;
use gpcc_lite::raht::Plan;
use gpcc_lite::{Limits, geometry};

use super::cloud::{Cloud, Peer, read};
use super::speed::best;

/// Bits per point, or a dash where the peer has no record.
fn bits(x: f64) -> String {
    if x.is_nan() { "-".into() } else { format!("{x:.3}") }
}

/// `ours` against `theirs` in percent.
fn against(ours: f64, theirs: f64) -> String {
    if theirs.is_nan() { "-".into() } else { format!("{:+.2} %", (ours / theirs - 1.0) * 100.0) }
}

fn depth_of(name: &str) -> Result<u8> {
    name.trim_start_matches(char::is_alphabetic).parse().context("cloud name without depth")
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
        writeln!(
            out,
            "| {name} | {n} | {} | {} | {bpp:.3} | {} | {} | {enc:.3} / {dec:.3} |",
            bits(authors),
            bits(best),
            against(bpp, authors),
            against(bpp, best),
        )?;
    }
    Ok(out)
}

/// Squared error summed over channels, of values clipped to 8 bits as a consumer would.
fn mse(a: &[Vec<i32>], b: &[Vec<i32>]) -> f64 {
    let mut sum = 0.0;
    for (x, y) in a.iter().zip(b) {
        let e: f64 = x.iter().zip(y).map(|(&x, &y)| f64::from(x - y.clamp(0, 255)).powi(2)).sum();
        sum += e / x.len() as f64;
    }
    sum
}

/// Bits per point at the step whose error is `target`.
fn rate_at(plan: &Plan, cloud: &Cloud, target: f64, o: &Options) -> Result<(f64, f64)> {
    let refs: Vec<&[i32]> = cloud.channels.iter().map(Vec::as_slice).collect();
    let n = cloud.leaves.len() as f64;
    let run = |log_step: f64| -> Result<(f64, f64)> {
        let steps = vec![Step::new(log_step.exp()); refs.len()];
        let e = attribute::encode(plan, &refs, &steps, o)?;
        Ok((e.bytes.len() as f64 * 8.0 / n, mse(&cloud.channels, &e.reconstruction)))
    };
    // Secant on log(mse) against log(step), then log-linear interpolation of the rate.
    let mut x = (target * 12.0 / refs.len() as f64).sqrt().ln();
    let mut low: Option<(f64, f64, f64)> = None;
    let mut high: Option<(f64, f64, f64)> = None;
    for _ in 0..12 {
        let (rate, e) = run(x)?;
        let y = e.max(1e-9).ln() - target.ln();
        if y.abs() < 0.002 {
            // At high rate one bit is a factor of 4 in error: correct the remainder.
            if let (Some(l), Some(h)) = (low, high) {
                let slope = (h.2 - l.2) / (h.1 - l.1);
                return Ok((rate - slope * y, x.exp()));
            }
            return Ok((rate, x.exp()));
        }
        if y < 0.0 {
            low = Some((x, y, rate));
        } else {
            high = Some((x, y, rate));
        }
        x = match (low, high) {
            (Some(l), Some(h)) => l.0 + (h.0 - l.0) * (-l.1 / (h.1 - l.1)).clamp(0.05, 0.95),
            _ => x - y * 0.55,
        };
    }
    Ok((run(x)?.0, x.exp()))
}

/// RAHT at the peer's error.
pub(super) fn raht_table(
    dir: &Path,
    clouds: &[&str],
    attrs: &[&str],
    qps: &[u8],
    peers: &[Peer],
) -> Result<String> {
    let mut out = String::from(
        "| cloud | attribute | QP | squared error | TMC13 authors | TMC13 prediction | gpcc-lite range | against authors | against prediction (at its error) | gpcc-lite RLGR | against authors |\n|---|---|---|---|---|---|---|---|---|---|---|\n",
    );
    for name in clouds {
        for attr in attrs {
            let path = dir.join(format!("{name}_{attr}.ply"));
            if !path.exists() {
                continue;
            }
            let mut cloud = read(&path, depth_of(name)?)?;
            if *attr == "opacity" {
                for v in &mut cloud.channels[0] {
                    *v /= 257;
                }
            }
            let plan = Plan::new(&cloud.leaves, cloud.j)?;
            for &qp in qps {
                let find = |prefix: &str| {
                    peers.iter().find(|p| {
                        p.cloud == *name
                            && p.attr == *attr
                            && p.qp == Some(qp)
                            && p.name == format!("{prefix}_q{qp}")
                    })
                };
                let Some(auth) = find("r_auth") else { continue };
                let o = Options { by_means: true, ..Options::default() };
                let (rate, _) = rate_at(&plan, &cloud, auth.mse, &o)?;
                let rlgr = Options { mode: Mode::Rlgr, ..o };
                let (fast, _) = rate_at(&plan, &cloud, auth.mse, &rlgr)?;
                let (pred, versus) = match find("r_pred") {
                    Some(p) => {
                        let (r, _) = rate_at(&plan, &cloud, p.mse, &o)?;
                        (p.attr_bpp, (r / p.attr_bpp - 1.0) * 100.0)
                    }
                    None => (f64::NAN, f64::NAN),
                };
                writeln!(
                    out,
                    "| {name} | {attr} | {qp} | {:.3} | {:.3} | {pred:.3} | {rate:.3} | {:+.2} % | {versus:+.2} % | {fast:.3} | {:+.2} % |",
                    auth.mse,
                    auth.attr_bpp,
                    (rate / auth.attr_bpp - 1.0) * 100.0,
                    (fast / auth.attr_bpp - 1.0) * 100.0,
                )?;
                eprintln!("{}", out.lines().last().unwrap_or_default());
            }
        }
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
            let t = Instant::now();
            let near = Neighbours::new(&cloud.leaves, cloud.j)?;
            let find = t.elapsed().as_secs_f64();
            let refs: Vec<&[i32]> = cloud.channels.iter().map(Vec::as_slice).collect();
            let t = Instant::now();
            let bytes = predict::encode_lossless(&near, &refs)?;
            let enc = t.elapsed().as_secs_f64();
            let t = Instant::now();
            let back = predict::decode_lossless(&near, &bytes, refs.len())?;
            let dec = t.elapsed().as_secs_f64();
            ensure!(back == cloud.channels, "{name} {attr}: channels differ");
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
                "| {name} | {attr} | {} | {} | {bpp:.3} | {} | {} | {find:.3} | {enc:.3} / {dec:.3} |",
                bits(authors),
                bits(best),
                against(bpp, authors),
                against(bpp, best),
            )?;
        }
    }
    Ok(out)
}

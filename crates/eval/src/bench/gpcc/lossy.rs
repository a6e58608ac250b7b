//! Lossy channels at the peer's error: the attribute coder, and plain RAHT with RLGR as the paper has it.

use std::path::Path;

use anyhow::{Result, ensure};
use gpcc_lite::attribute::{self, Options};
use gpcc_lite::coder::{Decoder, Encoder};
use gpcc_lite::quant::Step;
use gpcc_lite::raht::{Plan, Rows};
use gpcc_lite::rlgr;

use super::cloud::{Cloud, Peer, depth_of, read};

/// Bytes that tell the decoder the step of a channel.
const HEADER_BYTES: usize = 1;

/// What one step gives: bits per point, and the squared error.
#[derive(Clone, Copy)]
struct Coded {
    bits: f64,
    error: f64,
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

/// The channels of a cloud, leaf by leaf.
pub(super) fn rows_of(channels: &[Vec<i32>]) -> Rows {
    let mut rows = Rows::new(channels.first().map_or(0, Vec::len), channels.len());
    for (c, values) in channels.iter().enumerate() {
        values.iter().enumerate().for_each(|(i, &v)| rows.row_mut(i)[c] = v as f32);
    }
    rows
}

/// The same step for each channel.
pub(super) fn steps_of(step: Step, channels: usize) -> Vec<f32> {
    vec![step.value() as f32; channels]
}

fn coded(bytes: usize, cloud: &Cloud, decoded: &[Vec<i32>]) -> Coded {
    let bytes = bytes + HEADER_BYTES * cloud.channels.len();
    let bits = bytes as f64 * 8.0 / cloud.leaves.len() as f64;
    Coded { bits, error: mse(&cloud.channels, decoded) }
}

/// Codes a cloud with the attribute coder, decodes it and compares with the encoder's reconstruction.
fn by_contexts(plan: &Plan, cloud: &Cloud, step: Step) -> Result<Coded> {
    let steps = steps_of(step, cloud.channels.len());
    let mut rows = rows_of(&cloud.channels);
    let mut coder = Encoder::default();
    attribute::encode(&mut coder, plan, &steps, &Options::default(), &mut rows)?;
    let bytes = coder.finish();
    let mut back = Rows::new(rows.leaves(), rows.channels());
    let mut decoder = Decoder::new(&bytes)?;
    attribute::decode(&mut decoder, plan, &steps, &mut back)?;
    decoder.finish()?;
    ensure!(back == rows, "the decoder's values are not those of the encoder");
    let channel = |c: usize| (0..back.leaves()).map(|i| back.row(i)[c].round() as i32).collect();
    let decoded: Vec<Vec<i32>> = (0..back.channels()).map(channel).collect();
    Ok(coded(bytes.len(), cloud, &decoded))
}

/// RAHT coefficients of a channel, rounded to multiples of the step.
pub(super) fn levels(plan: &Plan, values: &[i32], step: Step) -> Result<Vec<i32>> {
    let mut coefficients: Vec<f64> = values.iter().map(|&v| f64::from(v)).collect();
    plan.forward_f64(&mut coefficients)?;
    Ok(coefficients.iter().map(|c| (c / step.value()).round() as i32).collect())
}

/// Codes a cloud as the paper does: RAHT, a uniform quantiser, RLGR for each channel.
fn by_rlgr(plan: &Plan, cloud: &Cloud, step: Step) -> Result<Coded> {
    let (mut bytes, mut decoded) = (0, Vec::new());
    for values in &cloud.channels {
        let stream = rlgr::encode(&levels(plan, values, step)?);
        bytes += stream.len();
        let levels = rlgr::decode(&stream, values.len())?;
        let mut back: Vec<f64> = levels.iter().map(|&q| f64::from(q) * step.value()).collect();
        plan.inverse_f64(&mut back)?;
        decoded.push(back.iter().map(|v| v.round() as i32).collect());
    }
    Ok(coded(bytes, cloud, &decoded))
}

/// Bits per point at the step whose error is `target`.
fn rate_at(target: f64, channels: usize, run: impl Fn(Step) -> Result<Coded>) -> Result<f64> {
    // Secant on log(error) against log(step), then log-linear interpolation of the rate.
    let mut x = (target * 12.0 / channels as f64).sqrt().ln();
    let mut low: Option<(f64, f64, f64)> = None;
    let mut high: Option<(f64, f64, f64)> = None;
    for _ in 0..12 {
        let Coded { bits, error } = run(Step::new(x.exp()))?;
        let y = error.max(1e-9).ln() - target.ln();
        if y.abs() < 0.002 {
            // At high rate one bit is a factor of 4 in error: correct the remainder.
            if let (Some(l), Some(h)) = (low, high) {
                let slope = (h.2 - l.2) / (h.1 - l.1);
                return Ok(bits - slope * y);
            }
            return Ok(bits);
        }
        if y < 0.0 {
            low = Some((x, y, bits));
        } else {
            high = Some((x, y, bits));
        }
        x = match (low, high) {
            (Some(l), Some(h)) => l.0 + (h.0 - l.0) * (-l.1 / (h.1 - l.1)).clamp(0.05, 0.95),
            _ => x - y * 0.55,
        };
    }
    Ok(run(Step::new(x.exp()))?.bits)
}

/// One cloud and attribute at one QP of the peer.
struct Row {
    cloud: String,
    attribute: String,
    /// Our rate against the peer's with the authors' settings, per cent.
    against_authors: f64,
    /// The same against the peer with prediction, at that run's error.
    against_prediction: Option<f64>,
    /// RAHT with RLGR against the authors' settings.
    rlgr: f64,
    /// All figures, a row of the long table.
    line: String,
}

/// RAHT at the peer's error: a table with a row for each QP, and its summary.
pub(super) fn tables(
    dir: &Path,
    clouds: &[&str],
    attrs: &[&str],
    qps: &[u8],
    peers: &[Peer],
) -> Result<[String; 2]> {
    let mut rows = Vec::new();
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
                let of_cloud = |p: &&Peer| p.cloud == *name && p.attr == *attr && p.qp == Some(qp);
                let find = |prefix: &str| {
                    let run = format!("{prefix}_q{qp}");
                    peers.iter().filter(of_cloud).find(|p| p.name == run)
                };
                let Some(authors) = find("r_auth") else { continue };
                let row = row(&plan, &cloud, authors, find("r_pred"))?;
                eprintln!("{}", row.line);
                rows.push(row);
            }
        }
    }
    let details = rows.iter().fold(String::from(HEAD), |out, row| out + &row.line + "\n");
    Ok([details, summary(&rows)])
}

const HEAD: &str = "| cloud | attribute | QP | squared error | TMC13 authors | TMC13 prediction | gpcc-lite | against authors | against prediction (at its error) | RAHT and RLGR | against authors |\n|---|---|---|---|---|---|---|---|---|---|---|\n";

/// Mean over the QPs for each cloud and attribute.
fn summary(rows: &[Row]) -> String {
    let mut out = String::from(
        "| cloud | attribute | QPs | against authors, mean | least | greatest | against prediction, mean | \
         RAHT and RLGR against authors, mean |\n|---|---|---:|---:|---:|---:|---:|---:|\n",
    );
    for of in rows.chunk_by(|a, b| a.cloud == b.cloud && a.attribute == b.attribute) {
        let authors = || of.iter().map(|r| r.against_authors);
        let predicted: Vec<f64> = of.iter().filter_map(|r| r.against_prediction).collect();
        let mean = |sum: f64, n: usize| match n {
            0 => "-".to_owned(),
            n => format!("{:+.2} %", sum / n as f64),
        };
        out += &format!(
            "| {} | {} | {} | {} | {:+.2} % | {:+.2} % | {} | {} |\n",
            of[0].cloud,
            of[0].attribute,
            of.len(),
            mean(authors().sum(), of.len()),
            authors().fold(f64::INFINITY, f64::min),
            authors().fold(f64::NEG_INFINITY, f64::max),
            mean(predicted.iter().sum(), predicted.len()),
            mean(of.iter().map(|r| r.rlgr).sum(), of.len()),
        );
    }
    out
}

/// One QP: the peer with the authors' settings, and with its prediction.
fn row(plan: &Plan, cloud: &Cloud, authors: &Peer, predicted: Option<&Peer>) -> Result<Row> {
    let channels = cloud.channels.len();
    let contexts = |target| rate_at(target, channels, |step| by_contexts(plan, cloud, step));
    let percent = |ours: f64, theirs: f64| (ours / theirs - 1.0) * 100.0;
    let bits = contexts(authors.mse)?;
    let rlgr_bits = rate_at(authors.mse, channels, |step| by_rlgr(plan, cloud, step))?;
    let (against_authors, rlgr) =
        (percent(bits, authors.attr_bpp), percent(rlgr_bits, authors.attr_bpp));
    let against_prediction = match predicted {
        Some(p) => Some(percent(contexts(p.mse)?, p.attr_bpp)),
        None => None,
    };
    let line = format!(
        "| {} | {} | {} | {:.3} | {:.3} | {} | {bits:.3} | {against_authors:+.2} % | {} | {rlgr_bits:.3} | {rlgr:+.2} % |",
        authors.cloud,
        authors.attr,
        authors.qp.unwrap_or_default(),
        authors.mse,
        authors.attr_bpp,
        predicted.map_or("-".into(), |p| format!("{:.3}", p.attr_bpp)),
        against_prediction.map_or("-".into(), |a| format!("{a:+.2} %")),
    );
    Ok(Row {
        cloud: authors.cloud.clone(),
        attribute: authors.attr.clone(),
        against_authors,
        against_prediction,
        rlgr,
        line,
    })
}

//! Lossy channels at the peer's error: the attribute coder, and plain RAHT with RLGR as the paper has it.

use std::path::Path;

use anyhow::{Result, ensure};
use gpcc_lite::attribute::{self, Quantisation};
use gpcc_lite::coder::{RansDecoder, RansEncoder};
use gpcc_lite::quant::Step;
use gpcc_lite::raht::{RahtPlan, Rows};
use gpcc_lite::rlgr;

use super::cloud::{Cloud, Peer, read};
use crate::cells;
use crate::page::{Table, signed};

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
fn rows_of(channels: &[Vec<i32>]) -> Rows {
    let mut rows = Rows::new(channels.first().map_or(0, Vec::len), channels.len());
    for (c, values) in channels.iter().enumerate() {
        values.iter().enumerate().for_each(|(i, &v)| rows.row_mut(i)[c] = v as f32);
    }
    rows
}

fn coded(bytes: usize, cloud: &Cloud, decoded: &[Vec<i32>]) -> Coded {
    let bytes = bytes + HEADER_BYTES * cloud.channels.len();
    let bits = bytes as f64 * 8.0 / cloud.octree.len() as f64;
    Coded { bits, error: mse(&cloud.channels, decoded) }
}

/// Codes a cloud with the attribute coder, decodes it and compares with the encoder's reconstruction.
fn by_contexts(plan: &RahtPlan, cloud: &Cloud, step: Step) -> Result<Coded> {
    let steps = vec![step.value() as f32; cloud.channels.len()];
    let mut rows = rows_of(&cloud.channels);
    let mut coder = RansEncoder::default();
    attribute::encode(&mut coder, plan, &Quantisation::new(&steps), &mut rows)?;
    let bytes = coder.finish();
    let mut back = Rows::new(rows.leaves(), rows.channels());
    let mut decoder = RansDecoder::new(&bytes)?;
    attribute::decode(&mut decoder, plan, &steps, &mut back)?;
    decoder.finish()?;
    ensure!(back == rows, "the decoder's values are not those of the encoder");
    let channel = |c: usize| (0..back.leaves()).map(|i| back.row(i)[c].round() as i32).collect();
    let decoded: Vec<Vec<i32>> = (0..back.channels()).map(channel).collect();
    Ok(coded(bytes.len(), cloud, &decoded))
}

/// RAHT coefficients of a channel, rounded to multiples of the step.
fn levels(plan: &RahtPlan, values: &[i32], step: Step) -> Result<Vec<i32>> {
    let mut coefficients: Vec<f64> = values.iter().map(|&v| f64::from(v)).collect();
    plan.forward_f64(&mut coefficients)?;
    Ok(coefficients.iter().map(|c| (c / step.value()).round() as i32).collect())
}

/// Codes a cloud as the paper does: RAHT, a uniform quantiser, RLGR for each channel.
fn by_rlgr(plan: &RahtPlan, cloud: &Cloud, step: Step) -> Result<Coded> {
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

/// The comparisons with the recorded QPs of one cloud and attribute, per cent.
#[derive(Default)]
struct Against {
    authors: Vec<f64>,
    /// The peer with prediction, at that run's error.
    prediction: Vec<f64>,
    /// RAHT with RLGR against the authors' settings.
    rlgr: Vec<f64>,
}

/// RAHT at the peer's error: a row for each cloud and attribute, the mean over the QPs.
pub(super) fn table(dir: &Path, clouds: &[String], qps: &[u8], peers: &[Peer]) -> Result<Table> {
    let mut table = Table::new(
        "cloud | attribute | QPs | against authors, mean | least | greatest | against prediction, mean | RAHT and \
         RLGR against authors, mean",
    );
    for name in clouds {
        for attribute in ["dc", "opacity", "rest"] {
            let Some(mut cloud) = read(dir, name, attribute)? else { continue };
            if attribute == "opacity" {
                cloud.channels[0].iter_mut().for_each(|v| *v /= 257);
            }
            let of_cloud = |p: &&Peer| p.cloud == *name && p.attribute == attribute;
            let find = |run: String| peers.iter().filter(of_cloud).find(|p| p.name == run);
            let mut all = Against::default();
            for qp in qps {
                if let Some(authors) = find(format!("r_auth_q{qp}")) {
                    all.add(&cloud, authors, find(format!("r_pred_q{qp}")))?;
                }
            }
            if all.authors.is_empty() {
                continue;
            }
            let mean = |of: &[f64]| {
                let mean = of.iter().sum::<f64>() / of.len() as f64;
                signed((!of.is_empty()).then_some(mean), 2, " %")
            };
            let end = |pick: fn(f64, f64) -> f64| {
                signed(all.authors.iter().copied().reduce(pick), 2, " %")
            };
            table.told(cells![
                name,
                attribute,
                all.authors.len(),
                mean(&all.authors),
                end(f64::min),
                end(f64::max),
                mean(&all.prediction),
                mean(&all.rlgr),
            ]);
        }
    }
    Ok(table)
}

impl Against {
    /// One QP: the peer with the authors' settings, and with its prediction.
    fn add(&mut self, cloud: &Cloud, authors: &Peer, predicted: Option<&Peer>) -> Result<()> {
        let plan = RahtPlan::new(cloud.octree.clone());
        let channels = cloud.channels.len();
        let percent = |ours: f64, theirs: &Peer| (ours / theirs.attribute_bits - 1.0) * 100.0;
        let contexts = |peer: &Peer| {
            rate_at(peer.mse, channels, |step| by_contexts(&plan, cloud, step))
                .map(|bits| percent(bits, peer))
        };
        self.authors.push(contexts(authors)?);
        let rlgr = rate_at(authors.mse, channels, |step| by_rlgr(&plan, cloud, step))?;
        self.rlgr.push(percent(rlgr, authors));
        if let Some(peer) = predicted {
            self.prediction.push(contexts(peer)?);
        }
        Ok(())
    }
}

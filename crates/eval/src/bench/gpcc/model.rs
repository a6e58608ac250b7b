//! A whole model of 59 channels on all cores: time and peak memory.

use std::path::Path;
use std::time::Instant;

use anyhow::{Result, ensure};
use gpcc_lite::attribute::{self, Encoded, Options};
use gpcc_lite::coeffs::Mode;
use gpcc_lite::predict::{Neighbours, decode_lossless, encode_lossless};
use gpcc_lite::quant::Step;
use gpcc_lite::raht::Plan;
use gpcc_lite::{Leaf, Limits, geometry};
use rayon::prelude::*;

use super::cloud::read;
use super::speed::{random, yardstick};
use crate::usage::{self, cpu_seconds};

/// Peak resident memory of this process in units of 2^20 bytes.
fn peak_mb() -> f64 {
    usage::peak_bytes() as f64 / 1024.0 / 1024.0
}

struct Model {
    geometry: Vec<u8>,
    lossy: Vec<Vec<u8>>,
    lossless: Vec<u8>,
}

fn encode(
    leaves: &[Leaf],
    lossy: &[Vec<Vec<i32>>],
    exact: &[Vec<i32>],
    mode: Mode,
) -> Result<Model> {
    let geometry = match mode {
        Mode::Range => geometry::encode(leaves, 15)?,
        _ => geometry::encode_fast(leaves, 15)?,
    };
    let refs: Vec<&[i32]> = exact.iter().map(Vec::as_slice).collect();
    let lossless = encode_lossless(&Neighbours::new(leaves, 15)?, &refs)?;
    let plan = Plan::new(leaves, 15)?;
    // Prediction costs more time than RLGR.
    let prediction = mode == Mode::Range;
    if prediction {
        plan.prepare_prediction();
    }
    let o =
        Options { mode, prediction, by_means: true, reconstruction: false, ..Options::default() };
    let one = |group: &Vec<Vec<i32>>| -> Result<Vec<u8>> {
        let refs: Vec<&[i32]> = group.iter().map(Vec::as_slice).collect();
        let steps = vec![Step::from_qp(28); refs.len()];
        let Encoded { bytes, .. } = attribute::encode(&plan, &refs, &steps, &o)?;
        Ok(bytes)
    };
    let lossy = lossy.par_iter().map(one).collect::<Result<_>>()?;
    Ok(Model { geometry, lossy, lossless })
}

fn decode(m: &Model) -> Result<usize> {
    let g = geometry::decode(&m.geometry, &Limits::for_stream(m.geometry.len()))?;
    let exact = decode_lossless(&Neighbours::new(&g.leaves, g.j_high)?, &m.lossless, 7)?;
    let plan = Plan::new(&g.leaves, g.j_high)?;
    let lossy: Vec<usize> = m
        .lossy
        .par_iter()
        .map(|b| attribute::decode(&plan, b, 3).map(|v| v.len()))
        .collect::<Result<_, _>>()?;
    Ok(exact.len() + lossy.iter().sum::<usize>())
}

/// 500 k points: DC and 15 SH-like triples at QP 28, opacity, 7 lossless 16-bit channels.
///
/// The recorded clouds hold one attribute each, so the SH-like triples are the DC of other points
/// of the same cloud, mixed with noise, and the seven lossless channels are the recorded one with
/// noise in the low bits.
pub(super) fn report(dir: &Path) -> Result<String> {
    let dc = read(&dir.join("syn15_dc.ply"), 15)?;
    let scale = read(&dir.join("syn15_scale.ply"), 15)?;
    let opacity = read(&dir.join("syn15_opacity.ply"), 15)?;
    let n = dc.leaves.len();
    let noise = random(n);
    let mut lossy = vec![dc.channels.clone()];
    for t in 0..15u32 {
        let one = |c: &Vec<i32>| -> Vec<i32> {
            let mix = |i: usize| 128 + (c[i] - 128) / 3 + (noise[i].rotate_left(t * 4) & 15) as i32;
            (0..n).map(mix).collect()
        };
        lossy.push(dc.channels.iter().map(one).collect());
    }
    lossy.push(vec![opacity.channels[0].iter().map(|v| v / 257).collect()]);
    let exact: Vec<Vec<i32>> = (0..7u32)
        .map(|t| {
            let low = |i: usize| (noise[i].rotate_left(t * 7) & 255) as i32;
            scale.channels[0].iter().enumerate().map(|(i, v)| v ^ low(i)).collect()
        })
        .collect();
    let sort = yardstick();
    let before = peak_mb();
    let mut out = format!(
        "{} threads; `sort_unstable` of 500 k random u64: {:.1} ms; resident before: {before:.0} MB.\n\n| mode | encode s of all cores | per core, x sort | decode s of all cores | per core, x sort | wall s | MB | peak above the input after encode + decode, MB |\n|---|---|---|---|---|---|---|---|\n",
        rayon::current_num_threads(),
        sort * 1e3,
    );
    let threads = rayon::current_num_threads() as f64;
    let modes = [("range", Mode::Range), ("symbols", Mode::Symbols), ("RLGR", Mode::Rlgr)];
    for (name, mode) in modes {
        let (t, c) = (Instant::now(), cpu_seconds());
        let m = encode(&dc.leaves, &lossy, &exact, mode)?;
        let (enc_wall, enc) = (t.elapsed().as_secs_f64(), cpu_seconds() - c);
        let (t, c) = (Instant::now(), cpu_seconds());
        ensure!(decode(&m)? == 56, "channels lost");
        let (dec_wall, dec) = (t.elapsed().as_secs_f64(), cpu_seconds() - c);
        let size =
            m.geometry.len() + m.lossless.len() + m.lossy.iter().map(Vec::len).sum::<usize>();
        out += &format!(
            "| {name} | {enc:.2} | {:.0} | {dec:.2} | {:.0} | {enc_wall:.1} / {dec_wall:.1} | {:.2} | {:.0} |\n",
            enc / sort / threads,
            dec / sort / threads,
            size as f64 / 1e6,
            peak_mb() - before
        );
    }
    Ok(out)
}

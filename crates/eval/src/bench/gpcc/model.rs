//! A whole model of 56 coded channels on all cores: time and peak memory.

use std::path::Path;
use std::time::Instant;

use anyhow::{Result, ensure};
use gpcc_lite::attribute::{self, Options};
use gpcc_lite::coder::{Decoder, Encoder};
use gpcc_lite::predict::{Neighbours, decode_lossless, encode_lossless};
use gpcc_lite::quant::Step;
use gpcc_lite::raht::{Plan, Rows};
use gpcc_lite::{Leaf, Limits, geometry};
use rayon::prelude::*;

use super::cloud::read;
use super::lossy::{rows_of, steps_of};
use super::speed::{random, yardstick};
use crate::usage::{self, cpu_seconds};

/// Peak resident memory of this process in units of 2^20 bytes.
fn peak_mb() -> f64 {
    usage::peak_bytes() as f64 / 1024.0 / 1024.0
}

/// Channels that are coded without loss.
const EXACT: usize = 7;

struct Model {
    geometry: Vec<u8>,
    lossy: Vec<Vec<u8>>,
    lossless: Vec<u8>,
}

/// The quantisation parameter of all lossy groups.
const QP: u8 = 28;

fn encode(leaves: &[Leaf], lossy: &[Vec<Vec<i32>>], exact: &[Vec<i32>]) -> Result<Model> {
    let geometry = geometry::encode(leaves, 15)?;
    let exact: Vec<&[i32]> = exact.iter().map(Vec::as_slice).collect();
    let lossless = encode_lossless(&Neighbours::new(leaves, 15)?, &exact)?;
    let plan = Plan::new(leaves, 15)?;
    let one = |group: &Vec<Vec<i32>>| -> Result<Vec<u8>> {
        let steps = steps_of(Step::from_qp(QP), group.len());
        let mut coder = Encoder::default();
        let mut rows = rows_of(group);
        attribute::encode(&mut coder, &plan, &steps, &Options::default(), &mut rows)?;
        Ok(coder.finish())
    };
    let lossy = lossy.par_iter().map(one).collect::<Result<_>>()?;
    Ok(Model { geometry, lossy, lossless })
}

/// Decodes a model whose lossy groups have these numbers of channels; returns the number of all channels.
fn decode(m: &Model, groups: &[usize]) -> Result<usize> {
    let g = geometry::decode(&m.geometry, &Limits::for_stream(m.geometry.len()))?;
    let exact = decode_lossless(&Neighbours::new(&g.leaves, g.j_high)?, &m.lossless, EXACT)?;
    let plan = Plan::new(&g.leaves, g.j_high)?;
    let one = |(bytes, &channels): (&Vec<u8>, &usize)| -> Result<usize> {
        let steps = steps_of(Step::from_qp(QP), channels);
        let mut rows = Rows::new(plan.len(), channels);
        let mut coder = Decoder::new(bytes)?;
        attribute::decode(&mut coder, &plan, &steps, &mut rows)?;
        coder.finish()?;
        Ok(channels)
    };
    let lossy = m.lossy.par_iter().zip(groups).map(one).collect::<Result<Vec<usize>>>()?;
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
    let exact: Vec<Vec<i32>> = (0..EXACT as u32)
        .map(|t| {
            let low = |i: usize| (noise[i].rotate_left(t * 7) & 255) as i32;
            scale.channels[0].iter().enumerate().map(|(i, v)| v ^ low(i)).collect()
        })
        .collect();
    let sort = yardstick();
    let threads = rayon::current_num_threads() as f64;
    let before = peak_mb();
    let mut out = format!(
        "{threads} threads; `sort_unstable` of 500 k random u64: {:.1} ms; resident before: {before:.0} MB.\n\n| encode s of all cores | per core, x sort | decode s of all cores | per core, x sort | wall s | MB | peak above the input after encode + decode, MB |\n|---|---|---|---|---|---|---|\n",
        sort * 1e3,
    );
    let groups: Vec<usize> = lossy.iter().map(Vec::len).collect();
    let all = EXACT + groups.iter().sum::<usize>();
    let (t, c) = (Instant::now(), cpu_seconds());
    let m = encode(&dc.leaves, &lossy, &exact)?;
    let (enc_wall, enc) = (t.elapsed().as_secs_f64(), cpu_seconds() - c);
    let (t, c) = (Instant::now(), cpu_seconds());
    ensure!(decode(&m, &groups)? == all, "channels lost");
    let (dec_wall, dec) = (t.elapsed().as_secs_f64(), cpu_seconds() - c);
    let size = m.geometry.len() + m.lossless.len() + m.lossy.iter().map(Vec::len).sum::<usize>();
    out += &format!(
        "| {enc:.2} | {:.0} | {dec:.2} | {:.0} | {enc_wall:.1} / {dec_wall:.1} | {:.2} | {:.0} |\n",
        enc / sort / threads,
        dec / sort / threads,
        size as f64 / 1e6,
        peak_mb() - before
    );
    Ok(out)
}

//! Error against time of the three forms of RAHT.

use std::fmt::Write as _;

use anyhow::Result;
use gpcc_lite::raht::Plan;
use gpcc_lite::{Leaf, morton};

use super::speed::{best, random};

/// `n` points spread over a cube of depth `j`, 16-bit values.
fn cloud(n: usize, j: u8) -> (Vec<Leaf>, Vec<i32>) {
    let mask = (1u64 << j) - 1;
    let mut leaves: Vec<Leaf> = random(n)
        .into_iter()
        .map(|r| {
            // A thin slab, so that shallow trees hold many points and deep ones stay sparse.
            let p = [r & mask, (r >> 21) & mask, (r >> 42) & mask & (mask >> 2)];
            Leaf { morton: morton::encode(p.map(|v| v as u32)), depth: j }
        })
        .collect();
    leaves.sort_unstable();
    leaves.dedup();
    let values = random(leaves.len()).into_iter().map(|r| (r >> 40) as i32 & 0xffff).collect();
    (leaves, values)
}

fn errors(a: impl Iterator<Item = f64>, b: &[i32]) -> (f64, f64) {
    let (mut max, mut sum) = (0.0f64, 0.0);
    for (a, &b) in a.zip(b) {
        let e = (a - f64::from(b)).abs();
        max = max.max(e);
        sum += e * e;
    }
    (max, (sum / b.len().max(1) as f64).sqrt())
}

/// Forward and inverse of one channel of 16-bit values.
pub(super) fn table() -> Result<String> {
    let mut out = String::from(
        "| points | depth | f32 max / RMS error | f32 ms | f64 max / RMS error | f64 ms | fixed max / RMS error | fixed ms |\n|---|---|---|---|---|---|---|---|\n",
    );
    for (n, j) in [
        (1_000, 10),
        (1_000, 21),
        (30_000, 12),
        (500_000, 15),
        (500_000, 21),
        (2_000_000, 18),
        (2_000_000, 21),
    ] {
        let (leaves, values) = cloud(n, j);
        let plan = Plan::new(&leaves, j)?;
        let (t32, v32) = best(3, || {
            let mut v: Vec<f32> = values.iter().map(|&v| v as f32).collect();
            plan.forward_f32(&mut v).and_then(|()| plan.inverse_f32(&mut v)).map(|()| v)
        });
        let (t64, v64) = best(3, || {
            let mut v: Vec<f64> = values.iter().map(|&v| f64::from(v)).collect();
            plan.forward_f64(&mut v).and_then(|()| plan.inverse_f64(&mut v)).map(|()| v)
        });
        let (tfx, vfx) = best(3, || {
            let mut v: Vec<i64> = values.iter().map(|&v| i64::from(v) << 12).collect();
            plan.forward_fixed(&mut v).and_then(|()| plan.inverse_fixed(&mut v)).map(|()| v)
        });
        let e32 = errors(v32?.iter().map(|&v| f64::from(v)), &values);
        let e64 = errors(v64?.iter().copied(), &values);
        let efx = errors(vfx?.iter().map(|&v| v as f64 / 4096.0), &values);
        writeln!(
            out,
            "| {} | {j} | {:.1e} / {:.1e} | {:.1} | {:.1e} / {:.1e} | {:.1} | {:.1e} / {:.1e} | {:.1} |",
            leaves.len(),
            e32.0,
            e32.1,
            t32 * 1e3,
            e64.0,
            e64.1,
            t64 * 1e3,
            efx.0,
            efx.1,
            tfx * 1e3
        )?;
    }
    Ok(out)
}

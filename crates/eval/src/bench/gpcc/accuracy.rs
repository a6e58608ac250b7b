//! Error and time of RAHT in single precision, which streams use, against double precision.

use std::fmt::Write as _;

use anyhow::Result;
use gpcc_lite::raht::{self, Plan, Rows};
use gpcc_lite::{Leaf, morton};

use super::speed::{best, random};

/// `n` points spread over a cube of depth `j`.
fn leaves(n: usize, j: u8) -> Vec<Leaf> {
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
    leaves
}

/// Importance classes that weights follow.
const CLASSES: u64 = 12;

/// Greatest and root mean square difference.
fn errors(a: impl Iterator<Item = f64>, b: &[f64]) -> [f64; 2] {
    let (mut max, mut sum) = (0.0f64, 0.0);
    for (a, &b) in a.zip(b) {
        let e = (a - b).abs();
        max = max.max(e);
        sum += e * e;
    }
    [max, (sum / b.len().max(1) as f64).sqrt()]
}

/// Sum of all weights of a plan of more than one leaf.
fn weight_of(plan: &Plan) -> f64 {
    plan.child_weights(1).iter().sum()
}

/// Coefficients in coefficient order, from rows that hold the mean and differences of means.
fn coefficients(plan: &Plan, rows: &Rows) -> Vec<f64> {
    let mean = f64::from(rows.row(0)[0]) * weight_of(plan).sqrt();
    let high_pass = (1..plan.len()).map(|k| {
        let [a, b] = plan.child_weights(k);
        f64::from(rows.row(plan.split_leaf(k))[0]) * (a * b / (a + b)).sqrt()
    });
    std::iter::once(mean).chain(high_pass).collect()
}

/// Number of points, depth, greatest value, and whether leaves have weights.
const CASES: [(usize, u8, f64, bool); 12] = [
    (1_000, 10, 65_535.0, false),
    (1_000, 21, 65_535.0, false),
    (30_000, 12, 65_535.0, false),
    (500_000, 15, 65_535.0, false),
    (500_000, 21, 65_535.0, false),
    (2_000_000, 18, 65_535.0, false),
    (2_000_000, 21, 65_535.0, false),
    (500_000, 21, 1.0, false),
    (500_000, 21, 18_900.0, false),
    (500_000, 21, 1.0, true),
    (500_000, 21, 18_900.0, true),
    (2_000_000, 21, 65_535.0, true),
];

/// Forward and inverse of one channel: all cases as a table, and the greatest differences in a sentence.
pub(super) fn tables() -> Result<[String; 2]> {
    let mut greatest_of = [0.0f64; 3];
    let mut out = String::from(
        "Values are random, from 0 to the greatest. \"There and back\": greatest and root mean square \
         difference from the values. \"Forward\": difference of the coefficients in f32 from those in f64, as the \
         weighted root mean square difference of values that it stands for (the transform is orthonormal in \
         the weights). All differences are relative to the greatest value. Weights: 4^c for importance \
         classes c of 0 to 11.\n\n\
         | points | depth | greatest value | weights | f32 there and back, max / RMS | f32 forward, RMS | f32 ms | f64 there and back, max / RMS | f64 ms |\n|---|---|---|---|---|---|---|---|---|\n",
    );
    for (n, j, greatest, weighted) in CASES {
        let leaves = leaves(n, j);
        let random = random(2 * leaves.len());
        let (classes, numbers) = random.split_at(leaves.len());
        let plan = if weighted {
            let weights: Vec<u32> =
                classes.iter().map(|r| 1 << (2 * ((r >> 40) % CLASSES))).collect();
            Plan::with_weights(&leaves, j, &weights)?
        } else {
            Plan::new(&leaves, j)?
        };
        let values: Vec<f64> = numbers
            .iter()
            .map(|r| f64::from(((r >> 40) as f64 / (1u64 << 24) as f64 * greatest) as f32))
            .collect();
        let line = row(&plan, &values)?;
        let (at, weights) = (leaves.len(), if weighted { "4^c" } else { "1" });
        let relative =
            |[max, rms]: [f64; 2]| format!("{:.1e} / {:.1e}", max / greatest, rms / greatest);
        let (single, double) = (relative(line.single), relative(line.double));
        let forward = line.forward / greatest;
        let found = [line.single[0] / greatest, forward, line.double[0] / greatest];
        greatest_of = std::array::from_fn(|k| greatest_of[k].max(found[k]));
        let [single_ms, double_ms] = line.seconds.map(|s| s * 1e3);
        writeln!(
            out,
            "| {at} | {j} | {greatest} | {weights} | {single} | {forward:.1e} | {single_ms:.1} | {double} | {double_ms:.1} |",
        )?;
    }
    let [single, forward, double] = greatest_of;
    let summary = format!(
        "{} cases of up to 2,000,000 points, depths to 21, weights to 4^11. Greatest differences, relative \
         to the greatest value: there and back {single:.1e} in f32 (which streams use) and {double:.1e} in \
         f64; forward in f32 against f64 {forward:.1e} RMS.\n",
        CASES.len()
    );
    Ok([out, summary])
}

/// What [`row`] measured.
struct Measured {
    /// Greatest and root mean square difference, there and back.
    single: [f64; 2],
    double: [f64; 2],
    /// Weighted root mean square difference of the forward transforms.
    forward: f64,
    /// Least times there and back: f32, f64.
    seconds: [f64; 2],
}

fn row(plan: &Plan, values: &[f64]) -> Result<Measured> {
    let filled = || {
        let mut rows = Rows::new(values.len(), 1);
        values.iter().enumerate().for_each(|(i, &v)| rows.row_mut(i)[0] = v as f32);
        rows
    };
    let (single_s, back) = best(3, || {
        let mut rows = filled();
        raht::forward(plan, &mut rows).and_then(|()| raht::inverse(plan, &mut rows)).map(|()| rows)
    });
    let back = back?;
    let (double_s, double) = best(3, || {
        let mut v = values.to_vec();
        plan.forward_f64(&mut v).and_then(|()| plan.inverse_f64(&mut v)).map(|()| v)
    });
    let mut there = filled();
    raht::forward(plan, &mut there)?;
    let mut exact = values.to_vec();
    plan.forward_f64(&mut exact)?;
    let found = coefficients(plan, &there);
    let squares = found.iter().zip(&exact).map(|(a, b)| (a - b) * (a - b));
    Ok(Measured {
        single: errors((0..values.len()).map(|i| f64::from(back.row(i)[0])), values),
        double: errors(double?.into_iter(), values),
        forward: (squares.sum::<f64>() / weight_of(plan)).sqrt(),
        seconds: [single_s, double_s],
    })
}

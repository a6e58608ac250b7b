//! Times on one thread, also as multiples of the time of a sort in the same run.

use std::fmt::Write as _;
use std::path::Path;
use std::time::Instant;

use anyhow::{Result, ensure};
use gpcc_lite::attribute::{self, Options};
use gpcc_lite::coeffs::Mode;
use gpcc_lite::quant::Step;
use gpcc_lite::raht::Plan;
use gpcc_lite::{Limits, geometry};

use super::cloud::read;

/// Seconds that this thread has run, which other processes on a shared machine do not change. The
/// wall clock where the kernel does not report it.
fn thread_seconds(start: Instant) -> f64 {
    std::fs::read_to_string("/proc/thread-self/schedstat")
        .ok()
        .and_then(|s| s.split(' ').next()?.parse::<f64>().ok())
        .filter(|&ns| ns > 0.0)
        .map_or_else(|| start.elapsed().as_secs_f64(), |ns| ns * 1e-9)
}

/// Least time of `runs` runs on one thread, in seconds.
pub(super) fn best<T>(runs: usize, mut f: impl FnMut() -> T) -> (f64, T) {
    let mut least = f64::INFINITY;
    let mut out = None;
    let start = Instant::now();
    for _ in 0..runs {
        let t = thread_seconds(start);
        let v = std::hint::black_box(f());
        least = least.min(thread_seconds(start) - t);
        out = Some(v);
    }
    // proof: runs >= 1 at every call below.
    (least, out.unwrap_or_else(|| unreachable!()))
}

/// Reproducible random words.
pub(super) fn random(n: usize) -> Vec<u64> {
    let mut s = 0x9e37_79b9_7f4a_7c15u64;
    let mut next = || {
        s ^= s << 13;
        s ^= s >> 7;
        s ^= s << 17;
        s
    };
    (0..n).map(|_| next()).collect()
}

/// `sort_unstable` of 500 k random u64, the mean of 40: the thread clock has ticks of some ms.
pub(super) fn yardstick() -> f64 {
    let source = random(500_000);
    let many = best(2, || {
        for _ in 0..20 {
            let mut v = source.clone();
            v.sort_unstable();
            std::hint::black_box(&v);
        }
    });
    many.0 / 20.0
}

/// One thread, 500 k points, J = 15: geometry and three-channel RAHT.
pub(super) fn speed_table(dir: &Path) -> Result<String> {
    let cloud = read(&dir.join("syn15_dc.ply"), 15)?;
    let sort = yardstick();
    let mut out = format!(
        "`sort_unstable` of 500 k random u64: {:.1} ms. Times below in ms, and as multiples of it.\n\n| stage | encode ms | x sort | decode ms | x sort |\n|---|---|---|---|---|\n",
        sort * 1e3
    );
    let mut row = |name: &str, enc: f64, dec: f64| {
        writeln!(
            out,
            "| {name} | {:.1} | {:.2} | {:.1} | {:.2} |",
            enc * 1e3,
            enc / sort,
            dec * 1e3,
            dec / sort
        )
    };
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build()?;
    pool.install(|| -> Result<()> {
        let (g_enc, bytes) = best(3, || geometry::encode(&cloud.leaves, cloud.j));
        let bytes = bytes?;
        let (g_dec, back) = best(3, || geometry::decode(&bytes, &Limits::for_stream(bytes.len())));
        ensure!(back?.leaves == cloud.leaves, "geometry differs");
        row("geometry", g_enc, g_dec)?;
        let (f_enc, bytes) = best(3, || geometry::encode_fast(&cloud.leaves, cloud.j));
        let bytes = bytes?;
        let (f_dec, back) = best(3, || geometry::decode(&bytes, &Limits::for_stream(bytes.len())));
        ensure!(back?.leaves == cloud.leaves, "geometry differs");
        row("geometry, fast", f_enc, f_dec)?;
        let (plan_s, plan) = best(3, || Plan::new(&cloud.leaves, cloud.j));
        drop(plan?);
        row("RAHT plan (merges)", plan_s, plan_s)?;
        let (near_s, plan) = best(3, || -> Result<Plan> {
            let plan = Plan::new(&cloud.leaves, cloud.j)?;
            plan.prepare_prediction();
            Ok(plan)
        });
        drop(plan?);
        row("RAHT plan with what prediction needs", near_s, near_s)?;
        let refs: Vec<&[i32]> = cloud.channels.iter().map(Vec::as_slice).collect();
        for (name, mode, prediction) in [
            ("range", Mode::Range, true),
            ("range, no prediction", Mode::Range, false),
            ("symbols", Mode::Symbols, true),
            ("symbols, no prediction", Mode::Symbols, false),
            ("RLGR", Mode::Rlgr, true),
            ("RLGR, no prediction", Mode::Rlgr, false),
        ] {
            let (geometry, shape_enc, shape_dec) = match mode {
                Mode::Range => ("geometry", g_enc, g_dec),
                _ => ("fast geometry", f_enc, f_dec),
            };
            for qp in [16, 28] {
                let truth = Options { mode, prediction, ..Options::default() };
                let o = Options { reconstruction: false, ..truth };
                let steps = vec![Step::from_qp(qp); refs.len()];
                // A new plan each time: what it computes on first use is part of the cost.
                let (enc, coded) = best(3, || {
                    let plan = Plan::new(&cloud.leaves, cloud.j)?;
                    attribute::encode(&plan, &refs, &steps, &o)
                });
                let coded = coded?;
                let (dec, values) = best(3, || {
                    let plan = Plan::new(&cloud.leaves, cloud.j)?;
                    attribute::decode(&plan, &coded.bytes, refs.len())
                });
                let told =
                    attribute::encode(&Plan::new(&cloud.leaves, cloud.j)?, &refs, &steps, &truth)?;
                ensure!(told.bytes == coded.bytes, "streams differ");
                ensure!(values? == told.reconstruction, "values differ");
                row(&format!("plan + 3 channels, {name}, QP {qp}"), enc, dec)?;
                let total = format!("total with {geometry}, {name}, QP {qp}");
                row(&total, enc + shape_enc, dec + shape_dec)?;
            }
        }
        Ok(())
    })?;
    Ok(out)
}

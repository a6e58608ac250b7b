//! Times on one thread, also as multiples of the time of a sort in the same run.

use std::fmt::Write as _;
use std::path::Path;
use std::time::Instant;

use anyhow::{Result, ensure};
use gpcc_lite::attribute::{self, Options};
use gpcc_lite::coder::{Decoder, Encoder};
use gpcc_lite::quant::Step;
use gpcc_lite::raht::{Plan, Rows};
use gpcc_lite::{Limits, geometry, rlgr};

use super::cloud::{Cloud, read};
use super::lossy::{levels, rows_of, steps_of};

/// Seconds that this thread has run, which other processes on a shared machine do not change. The
/// wall clock where the kernel does not report it.
fn thread_seconds(start: Instant) -> f64 {
    std::fs::read_to_string("/proc/thread-self/schedstat")
        .ok()
        .and_then(|s| s.split(' ').next()?.parse::<f64>().ok())
        .filter(|&ns| ns > 0.0)
        .map_or_else(|| start.elapsed().as_secs_f64(), |ns| ns * 1e-9)
}

/// Least time of `runs` runs on one thread, in seconds, and the result of the last. There is always
/// one run.
pub(super) fn best<T>(runs: usize, mut f: impl FnMut() -> T) -> (f64, T) {
    let start = Instant::now();
    let mut one = || {
        let before = thread_seconds(start);
        let result = std::hint::black_box(f());
        (thread_seconds(start) - before, result)
    };
    let (mut least, mut last) = one();
    for _ in 1..runs {
        let (seconds, result) = one();
        (least, last) = (least.min(seconds), result);
    }
    (least, last)
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

/// One row of the table.
struct Row {
    stage: String,
    /// Seconds.
    encode: f64,
    decode: f64,
}

/// One thread, 500 k points, J = 15: geometry, three-channel RAHT, and RLGR of its levels.
pub(super) fn speed_table(dir: &Path) -> Result<String> {
    let cloud = read(&dir.join("syn15_dc.ply"), 15)?;
    let sort = yardstick();
    let mut out = format!(
        "`sort_unstable` of 500 k random u64: {:.1} ms. Times below in ms, and as multiples of it.\n\n| stage | encode ms | x sort | decode ms | x sort |\n|---|---|---|---|---|\n",
        sort * 1e3
    );
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build()?;
    for Row { stage, encode, decode } in pool.install(|| rows(&cloud))? {
        writeln!(
            out,
            "| {stage} | {:.1} | {:.2} | {:.1} | {:.2} |",
            encode * 1e3,
            encode / sort,
            decode * 1e3,
            decode / sort
        )?;
    }
    Ok(out)
}

fn rows(cloud: &Cloud) -> Result<Vec<Row>> {
    let mut out = Vec::new();
    let mut row = |stage: &str, encode: f64, decode: f64| {
        out.push(Row { stage: stage.into(), encode, decode });
    };
    let (shape_enc, bytes) = best(3, || geometry::encode(&cloud.leaves, cloud.j));
    let bytes = bytes?;
    let (shape_dec, back) = best(3, || geometry::decode(&bytes, &Limits::for_stream(bytes.len())));
    ensure!(back?.leaves == cloud.leaves, "geometry differs");
    row("geometry", shape_enc, shape_dec);
    let (plan_s, plan) = best(3, || Plan::new(&cloud.leaves, cloud.j));
    let plan = plan?;
    row("RAHT plan (merges)", plan_s, plan_s);
    for qp in [16, 28] {
        let step = Step::from_qp(qp);
        let (enc, dec) = three_channels(cloud, step)?;
        row(&format!("plan + 3 channels, QP {qp}"), enc, dec);
        row(&format!("total with geometry, QP {qp}"), enc + shape_enc, dec + shape_dec);
        let levels: Vec<Vec<i32>> =
            cloud.channels.iter().map(|v| levels(&plan, v, step)).collect::<Result<_>>()?;
        let (enc, streams) = best(3, || levels.iter().map(|v| rlgr::encode(v)).collect::<Vec<_>>());
        let n = cloud.leaves.len();
        let (dec, back) =
            best(3, || streams.iter().map(|s| rlgr::decode(s, n)).collect::<Result<Vec<_>, _>>());
        ensure!(back? == levels, "levels differ");
        row(&format!("RLGR of the levels of 3 channels, QP {qp}"), enc, dec);
    }
    Ok(out)
}

/// Seconds to encode and to decode three channels, the plan included.
fn three_channels(cloud: &Cloud, step: Step) -> Result<(f64, f64)> {
    let steps = steps_of(step, cloud.channels.len());
    let values = rows_of(&cloud.channels);
    let (enc, coded) = best(3, || -> Result<(Vec<u8>, Rows)> {
        let plan = Plan::new(&cloud.leaves, cloud.j)?;
        let (mut coder, mut rows) = (Encoder::default(), values.clone());
        attribute::encode(&mut coder, &plan, &steps, &Options::default(), &mut rows)?;
        Ok((coder.finish(), rows))
    });
    let (bytes, told) = coded?;
    let (dec, decoded) = best(3, || -> Result<Rows> {
        let plan = Plan::new(&cloud.leaves, cloud.j)?;
        let mut rows = Rows::new(values.leaves(), values.channels());
        let mut coder = Decoder::new(&bytes)?;
        attribute::decode(&mut coder, &plan, &steps, &mut rows)?;
        coder.finish()?;
        Ok(rows)
    });
    ensure!(decoded? == told, "values differ");
    Ok((enc, dec))
}

//! temporary
#![allow(
    missing_docs,
    clippy::disallowed_methods,
    unreachable_pub,
    dead_code,
    reason = "temporary"
)]
#[path = "../../../xtask/src/bench_gpcc/cloud.rs"]
mod cloud;
use gpcc_lite::attribute::{self, Options};
use gpcc_lite::quant::Step;
use gpcc_lite::raht::Plan;
fn cpu() -> f64 {
    let s = std::fs::read_to_string("/proc/thread-self/schedstat").unwrap();
    s.split(' ').next().unwrap().parse::<f64>().unwrap() * 1e-6
}
fn t<T>(name: &str, mut f: impl FnMut() -> T) -> T {
    let s = cpu();
    let runs = if name == "sort" { 40 } else { 5 };
    for _ in 0..runs - 1 {
        f();
    }
    let r = f();
    println!("{name:30} {:8.1} ms cpu", (cpu() - s) / runs as f64);
    r
}
fn main() -> anyhow::Result<()> {
    let c = cloud::read(std::path::Path::new("../shared/clouds/syn15_dc.ply"), 15)?;
    let mut x = 88172645463325252u64;
    let r: Vec<u64> = (0..500000)
        .map(|_| {
            x ^= x << 13;
            x ^= x >> 7;
            x ^= x << 17;
            x
        })
        .collect();
    t("sort", || {
        let mut v = r.clone();
        v.sort_unstable();
        v
    });
    let b = t("geometry enc", || gpcc_lite::geometry::encode(&c.leaves, 15).unwrap());
    t("geometry dec", || {
        gpcc_lite::geometry::decode(&b, &gpcc_lite::Limits::for_stream(b.len())).unwrap()
    });
    if std::env::args().nth(1).is_some() {
        return Ok(());
    }
    let plan = t("plan", || Plan::new(&c.leaves, 15).unwrap());
    t("plan+pyramid", || {
        let p = Plan::new(&c.leaves, 15).unwrap();
        p.prepare_prediction();
        p
    });
    plan.prepare_prediction();
    let v: Vec<i64> = c.channels[0].iter().map(|&v| (v as i64) << 12).collect();
    let f = t("forward", || {
        let mut v = v.clone();
        plan.forward_fixed(&mut v).unwrap();
        v
    });
    t("inverse", || {
        let mut v = f.clone();
        plan.inverse_fixed(&mut v).unwrap();
        v
    });
    let refs: Vec<&[i32]> = c.channels.iter().map(Vec::as_slice).collect();
    for qp in [16, 28] {
        for prediction in [true, false] {
            for mode in [gpcc_lite::coeffs::Mode::Range, gpcc_lite::coeffs::Mode::Rlgr] {
                let o = Options { prediction, mode, ..Options::default() };
                let e = t(&format!("attr enc {qp} {prediction} {mode:?}"), || {
                    attribute::encode(&plan, &refs, &[Step::from_qp(qp); 3], &o).unwrap()
                });
                t("  dec", || attribute::decode(&plan, &e.bytes, 3).unwrap());
            }
        }
    }
    Ok(())
}

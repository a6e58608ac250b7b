//! `cargo xtask bench-gpcc`: gpcc-lite beside the peer's recorded figures.

#[path = "bench_gpcc/cloud.rs"]
mod cloud;
#[path = "bench_gpcc/rates.rs"]
mod rates;
#[path = "bench_gpcc/speed.rs"]
mod speed;

use std::path::PathBuf;

use anyhow::Result;
use clap::Args;

/// Measures gpcc-lite on the test clouds and writes docs/results/gpcc.md.
#[derive(Debug, Args)]
pub(crate) struct BenchArgs {
    /// Directory of the clouds and `tmc13.jsonl`
    #[arg(long, default_value = "../shared/clouds")]
    pub(crate) clouds: PathBuf,
    /// Only these parts: geometry, raht, lossless (all if none)
    #[arg(long)]
    pub(crate) only: Vec<String>,
    /// Only these clouds (all if none)
    #[arg(long)]
    pub(crate) cloud: Vec<String>,
    /// Only these attributes (all if none)
    #[arg(long)]
    pub(crate) attr: Vec<String>,
    /// Only these quantisation parameters
    #[arg(long)]
    pub(crate) qp: Vec<u8>,
}

const CLOUDS: [&str; 6] = ["vic12", "vic15", "jus15", "gsv12", "kac15", "syn15"];

/// Runs the benchmark.
pub(crate) fn run(args: &BenchArgs) -> Result<()> {
    let pick = |chosen: &[String], all: &[&'static str]| -> Vec<&'static str> {
        let keep = |x: &&&str| chosen.is_empty() || chosen.iter().any(|c| c == **x);
        all.iter().filter(keep).copied().collect()
    };
    let clouds = pick(&args.cloud, &CLOUDS);
    let attrs = pick(&args.attr, &["dc", "opacity", "rest", "scale", "rot"]);
    let lossy: Vec<&str> =
        attrs.iter().copied().filter(|a| ["dc", "opacity", "rest"].contains(a)).collect();
    let lossless: Vec<&str> = attrs.iter().copied().filter(|a| *a != "opacity").collect();
    let qps = if args.qp.is_empty() { vec![4, 16, 28, 34, 40] } else { args.qp.clone() };
    let wants = |part: &str| args.only.is_empty() || args.only.iter().any(|o| o == part);
    let peers = cloud::peers(&args.clouds.join("tmc13.jsonl"))?;
    if wants("speed") {
        println!("{}", speed::speed_table(&args.clouds)?);
    }
    if wants("geometry") {
        println!("{}", rates::geometry_table(&args.clouds, &clouds, &peers)?);
    }
    if wants("lossless") {
        println!("{}", rates::lossless_table(&args.clouds, &clouds, &lossless, &peers)?);
    }
    if wants("raht") {
        println!("{}", rates::raht_table(&args.clouds, &clouds, &lossy, &qps, &peers)?);
    }
    Ok(())
}

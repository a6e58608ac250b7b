//! Stand-in for `cargo xtask bench-gpcc` while it is being written.
#![allow(missing_docs, clippy::disallowed_methods, unreachable_pub, reason = "temporary")]
#[path = "../../../xtask/src/bench_gpcc.rs"]
mod bench_gpcc;
#[derive(clap::Parser)]
struct Cli {
    #[command(flatten)]
    args: bench_gpcc::BenchArgs,
}
fn main() -> anyhow::Result<()> {
    bench_gpcc::run(&<Cli as clap::Parser>::parse().args)
}

//! The page of docs/results on safety: what the decoder makes of broken streams.

use std::path::Path;

use anyhow::Result;
use eval::page::{Page, Table};

use super::damage::Findings;

/// Writes the page of a run without a failure.
pub(super) fn write(out: &Path, held: usize, broken: &[(&str, Findings)]) -> Result<()> {
    let streams: usize = broken.iter().map(|(_, seen)| seen.streams).sum();
    let mut page = Page::new(out, "How safe?");
    page.text(format!(
        "`cargo xtask conformance --page {}`: {held} checks hold. Four of them decode {streams} broken streams, made \
         from the golden ones. Each is refused; only salvage, damage in another level of detail, a splice of equal parts, and a forgery with right checksums may give a valid scene. A panic or five seconds fail the check.",
        out.display(),
    ));
    let mut table =
        Table::new("damage | decodes | refused with an error | a scene came out | slowest, ms");
    for (kind, seen) in broken {
        let (all, decoded, slowest) = (seen.streams, seen.decoded, seen.slowest_ms());
        table.row(format!("{kind} | {all} | {} | {decoded} | {slowest:.0}", all - decoded));
    }
    page.table(&table);
    page.text(
        "Memory follows what is decoded, not what a stream claims. The limit of [format.md](../format.md), 10, can be set (`max_gaussians` in Rust, C and Python, `--max-gaussians`, `limits.gaussians` in JavaScript). While a chunk is decoded it takes up to three times the memory of its Gaussians. Where the system has no memory the decoder returns an error.",
    );
    page.text(
        "100,000 forged streams, most with right checksums, some with claims of up to 2^63 Gaussians, fail at no border \
         (`cargo xtask forged --count 100000`: Rust on 64 and 32 bits, WebAssembly, C, Python, npm); all agree on the 19,263 \
         scenes that come out.",
    );
    page.text(
        "19 libFuzzer targets ([xtask](../../xtask)) have no open finding after 10 million executions each (sog: 1.8 \
         million).",
    );
    page.write()
}

//! The page of docs/results on safety: what the decoder makes of broken streams.

use std::fmt::Write as _;
use std::path::Path;

use anyhow::Result;
use eval::chart::{Axis, Chart, Series};

use super::damage::Seen;

/// Writes the page of a run without a failure.
pub(super) fn write(out: &Path, held: usize, broken: &[(&str, Seen)]) -> Result<()> {
    let streams: usize = broken.iter().map(|(_, seen)| seen.times.len()).sum();
    let mut text = format!(
        "# How safe?\n\n\
         `cargo xtask conformance --page {}`: {held} checks hold. Four of them decode {streams} broken \
         streams, made from the golden ones. A stream that is cut, spliced or has a bit flipped must be \
         refused. A valid scene may come out as well where salvage is asked for, where the damage lies in \
         another level of detail, where a splice joins equal parts, and where a stream is forged with right \
         checksums. A panic, or a decode of more than five seconds, fails the check. None did.\n\n\
         {}\n\n\
         | damage | decodes | refused with an error | a scene came out | panics | slowest, ms |\n\
         |---|---:|---:|---:|---:|---:|\n",
        out.display(),
        eval::page::picture(out, "Time to refuse or decode a broken stream, sorted"),
    );
    for (kind, seen) in broken {
        let all = seen.times.len();
        writeln!(
            text,
            "| {kind} | {all} | {} | {} | 0 | {:.0} |",
            all - seen.decoded,
            seen.decoded,
            seen.slowest_ms()
        )?;
    }
    text += "\nThe crates deny `unsafe`, but for two small modules of the fine-tune and the command \
             ([architecture](../architecture.md)). The decoder refuses a stream that claims more \
             Gaussians than its bytes can hold, or than the caller allows (`max_gaussians`), before it asks \
             for memory. Long runs of libFuzzer: \
             [fuzz.md](fuzz.md).\n";
    eval::page::write(out, &text, Some(&chart(broken)))
}

/// Times of each kind of damage, sorted.
fn chart(broken: &[(&str, Seen)]) -> Chart {
    let milliseconds = |seen: &Seen| seen.times.iter().map(|t| t.as_secs_f64() * 1e3).collect();
    let line = |(kind, seen): &(&str, Seen)| Series::sorted(kind, milliseconds(seen));
    Chart::new(
        "Time to refuse or decode a broken stream",
        Axis::linear("streams, sorted, per cent"),
        Axis::logarithmic("milliseconds"),
        broken.iter().map(line).collect(),
        None,
    )
}

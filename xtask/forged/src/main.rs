//! `gsvx-forged FIRST COUNT`: decodes forged streams, then the golden ones, and prints what became of them, as JSON.
//! `gsvx-forged write FIRST COUNT`: writes them, each behind its length as u32.

use std::io::Write;
use std::panic::catch_unwind;

use gsvx_forged::{FIRST_GOLDEN, join, outcome, stream};

fn main() -> std::io::Result<()> {
    let mut words: Vec<String> = std::env::args().skip(1).collect();
    let write = words.first().is_some_and(|w| w == "write");
    if write {
        words.remove(0);
    }
    let numbers: Vec<u64> = words.iter().filter_map(|w| w.parse().ok()).collect();
    let [first, count] = numbers[..] else {
        return Err(std::io::Error::other("gsvx-forged: [write] FIRST COUNT"));
    };
    let numbers = first..first + count;
    if write {
        let mut out = std::io::BufWriter::new(std::io::stdout().lock());
        for number in numbers {
            let stream = stream(number);
            out.write_all(&(stream.len() as u32).to_le_bytes())?;
            out.write_all(&stream)?;
        }
        return out.flush();
    }
    std::panic::set_hook(Box::new(|panic| eprintln!("{panic}")));
    let (mut digest, mut scenes, mut accepted, mut failed) = (0, 0, 0, Vec::new());
    for number in numbers {
        let work = || {
            let stream = stream(number);
            (outcome(&stream), gsvx_forged::scenes(&stream))
        };
        match catch_unwind(work) {
            Ok((outcome, [whole, salvaged])) => {
                digest = join(digest, outcome);
                scenes = join(join(scenes, whole), salvaged);
                accepted += outcome & 1;
            }
            Err(_) => failed.push(number),
        }
    }
    // All accepted, which says nothing of forged streams.
    for number in FIRST_GOLDEN..1 << 32 {
        digest = join(digest, outcome(&stream(number)));
    }
    let peak = peak().unwrap_or(0);
    println!(
        r#"{{"accepted": {accepted}, "failed": {failed:?}, "digest": {digest}, "scenes": {scenes}, "peak": {peak}}}"#
    );
    Ok(())
}

/// The most bytes of memory that this process has had; on Linux.
fn peak() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|l| l.strip_prefix("VmHWM:"))?;
    line.trim().strip_suffix(" kB")?.parse::<u64>().ok().map(|kb| kb << 10)
}

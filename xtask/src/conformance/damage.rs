//! Broken streams, made from the golden ones: cut, with a bit flipped, spliced, and changed with
//! correct checksums. The decoder must return an error or a valid scene, and must not panic.

use std::collections::BTreeMap;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::time::{Duration, Instant};

use anyhow::{Result, bail, ensure};
use gsvx::DecodeOptions;
use gsvx::stream::{Container, SectionKind, assemble};
use testing::Rng;

use super::{Tally, Verdict, golden};

/// Longest decode of a broken stream of these sizes (some tens of kB at most). A whole stream takes
/// milliseconds, but the machine may be loaded.
const SLOWEST: Duration = Duration::from_secs(5);

/// Counts of what the decoder returned.
#[derive(Default)]
struct Seen {
    streams: usize,
    /// By the first word of the error.
    errors: BTreeMap<String, usize>,
    decoded: usize,
    slowest: Duration,
}

impl Seen {
    /// Decodes one broken stream. If `must_fail`, the only right answer is an error.
    fn decode(&mut self, bytes: &[u8], options: &DecodeOptions, must_fail: bool) -> Result<()> {
        let started = Instant::now();
        let result = catch_unwind(AssertUnwindSafe(|| gsvx::decode(bytes, options)));
        let took = started.elapsed();
        self.slowest = self.slowest.max(took);
        self.streams += 1;
        ensure!(took < SLOWEST, "a stream of {} bytes took {took:.1?}", bytes.len());
        match result {
            Err(_) => bail!("the decoder panicked on {} bytes", bytes.len()),
            Ok(Ok(decoded)) => {
                ensure!(!must_fail, "a broken stream of {} bytes was decoded", bytes.len());
                decoded.scene.validate()?;
                self.decoded += 1;
            }
            Ok(Err(error)) => {
                let kind = format!("{error:?}");
                let kind = kind.split([' ', '{', '(']).next().unwrap_or_default().to_owned();
                ensure!(!error.to_string().contains('\n'), "an error of two lines: {error}");
                *self.errors.entry(kind).or_default() += 1;
            }
        }
        Ok(())
    }

    fn verdict(self) -> Verdict {
        let kinds: Vec<String> = self.errors.iter().map(|(k, n)| format!("{n} {k}")).collect();
        let mut says = format!("{} streams", self.streams);
        if !kinds.is_empty() {
            says += &format!(": {}", kinds.join(", "));
        }
        if self.decoded > 0 {
            says += &format!(", {} decoded to a valid scene", self.decoded);
        }
        Verdict::Holds(format!("{says}; slowest {:.0} ms", self.slowest.as_secs_f64() * 1e3))
    }
}

type Sections = Vec<(SectionKind, Vec<u8>)>;

fn sections(container: &Container<'_>) -> Result<Sections> {
    let mut out = Vec::new();
    for entry in &container.toc {
        let payload = container.section(entry.kind)?;
        out.push((entry.kind, payload.unwrap_or_default().to_vec()));
    }
    Ok(out)
}

pub(super) fn checks(tally: &mut Tally, each: u32) {
    let each = each as usize;
    let streams: Vec<(String, Vec<u8>)> = match golden::streams() {
        Ok(all) => all.into_iter().map(|(name, bytes, _)| (name, bytes)).collect(),
        Err(why) => return tally.check("broken streams", || Err(why)),
    };
    let strict = DecodeOptions::default();
    let lenient = DecodeOptions { allow_truncated: true, ..DecodeOptions::default() };
    // A caught panic is reported by its check; the default hook would print it as well.
    let hook = std::panic::take_hook();
    std::panic::set_hook(Box::new(|_| ()));
    tally.check("broken streams, cut", || {
        let mut seen = Seen::default();
        for (_, bytes) in &streams {
            let step = (bytes.len() / each).max(1);
            for end in (0..bytes.len()).step_by(step) {
                seen.decode(&bytes[..end], &strict, true)?;
                seen.decode(&bytes[..end], &lenient, false)?;
            }
        }
        Ok(seen.verdict())
    });
    tally.check("broken streams, one bit flipped", || {
        let (mut seen, mut rng) = (Seen::default(), Rng::seeded(1));
        for (_, bytes) in &streams {
            for _ in 0..each {
                let mut broken = bytes.clone();
                let at = rng.below(broken.len());
                broken[at] ^= 1 << rng.below(8);
                seen.decode(&broken, &strict, true)?;
            }
        }
        Ok(seen.verdict())
    });
    tally.check("broken streams, spliced", || {
        let (mut seen, mut rng) = (Seen::default(), Rng::seeded(2));
        for (i, (_, a)) in streams.iter().enumerate() {
            for _ in 0..each {
                let (_, b) = &streams[(i + 1 + rng.below(streams.len() - 1)) % streams.len()];
                let at = 1 + rng.below(a.len().min(b.len()) - 1);
                let spliced = [&a[..at], &b[at..]].concat();
                // Two streams may begin or end with the same bytes. Then this is one of them, whole.
                let whole = spliced == *a || spliced == *b;
                seen.decode(&spliced, &strict, !whole)?;
            }
        }
        Ok(seen.verdict())
    });
    tally.check("broken streams, forged with right checksums", || forged(&streams, each));
    std::panic::set_hook(hook);
}

/// Sections cut, grown, exchanged or changed, under checksums that are right.
fn forged(streams: &[(String, Vec<u8>)], each: usize) -> Result<Verdict> {
    let (mut seen, mut rng) = (Seen::default(), Rng::seeded(3));
    let mut parsed = Vec::new();
    for (_, bytes) in streams {
        let container = Container::parse(bytes)?;
        parsed.push((container.header.clone(), sections(&container)?));
    }
    for (header, own) in parsed.iter().filter(|(_, s)| !s.is_empty()) {
        for _ in 0..each {
            let mut broken = own.clone();
            let victim = rng.below(broken.len());
            let (kind, payload) = &mut broken[victim];
            match rng.below(4) {
                0 => payload.truncate(rng.below(payload.len())),
                1 => payload.push(rng.bits() as u8),
                // Another stream's section of the same kind.
                2 => {
                    let (_, other) = &parsed[rng.below(parsed.len())];
                    if let Some((_, theirs)) = other.iter().find(|(k, _)| k == kind) {
                        payload.clone_from(theirs);
                    }
                }
                _ if payload.is_empty() => payload.push(1),
                _ => {
                    let at = rng.below(payload.len());
                    payload[at] = rng.bits() as u8;
                }
            }
            seen.decode(&assemble(header, &broken), &DecodeOptions::default(), false)?;
        }
    }
    Ok(seen.verdict())
}

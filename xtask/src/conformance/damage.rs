//! Broken streams, made from the golden ones: cut, with a bit flipped, spliced, and changed with
//! correct checksums. The decoder must return an error or a valid scene, and must not panic.

use std::collections::BTreeMap;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::time::{Duration, Instant};

use anyhow::{Result, bail, ensure};
use gsvx::{DecodeOptions, Index};
use testing::Rng;

use super::{Tally, Verdict, golden, seal};

/// Longest decode of a broken stream of these sizes (some tens of kB at most). A whole stream takes
/// milliseconds, but the machine may be loaded.
const SLOWEST: Duration = Duration::from_secs(5);

/// What the decoder returned for one kind of damage.
#[derive(Default)]
pub(super) struct Findings {
    /// Errors by the first word of each.
    errors: BTreeMap<String, usize>,
    /// Streams that were decoded to a scene.
    pub(super) decoded: usize,
    /// Streams in all.
    pub(super) streams: usize,
    slowest: Duration,
}

/// What a broken stream may give.
#[derive(Clone, Copy, PartialEq)]
enum Allowed {
    /// Only an error.
    Error,
    /// An error or a valid scene.
    Scene,
    /// An error or any scene: exact Gaussians may be any floats.
    Anything,
}

impl Findings {
    /// Decodes one broken stream.
    fn decode(&mut self, bytes: &[u8], options: &DecodeOptions, allowed: Allowed) -> Result<()> {
        let started = Instant::now();
        let result = catch_unwind(AssertUnwindSafe(|| gsvx::decode_with(bytes, options)));
        let took = started.elapsed();
        self.streams += 1;
        self.slowest = self.slowest.max(took);
        ensure!(took < SLOWEST, "a stream of {} bytes took {took:.1?}", bytes.len());
        match result {
            Err(_) => bail!("the decoder panicked on {} bytes", bytes.len()),
            Ok(Ok(decoded)) => {
                let must_fail = allowed == Allowed::Error;
                ensure!(!must_fail, "a broken stream of {} bytes was decoded", bytes.len());
                if allowed == Allowed::Scene {
                    decoded.scene.validate()?;
                }
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

    pub(super) fn slowest_ms(&self) -> f64 {
        self.slowest.as_secs_f64() * 1e3
    }

    fn verdict(&self) -> Verdict {
        let kinds: Vec<String> = self.errors.iter().map(|(k, n)| format!("{n} {k}")).collect();
        let mut says = format!("{} streams", self.streams);
        if !kinds.is_empty() {
            says += &format!(": {}", kinds.join(", "));
        }
        if self.decoded > 0 {
            says += &format!(", {} decoded to a scene", self.decoded);
        }
        Verdict::Holds(format!("{says}; slowest {:.0} ms", self.slowest_ms()))
    }
}

fn salvage() -> DecodeOptions {
    let mut options = DecodeOptions::default();
    options.salvage = true;
    options
}

/// Golden streams by name.
type Streams = [(String, Vec<u8>)];
/// Damages each stream so many times.
type Damage = fn(&Streams, usize) -> Result<Findings>;

/// The kinds of damage.
const KINDS: [(&str, Damage); 4] = [
    ("cut", cut),
    ("one bit flipped", flipped),
    ("spliced", spliced),
    ("forged with right checksums", forged),
];

/// Makes the checks and returns what the decoder did, for each kind of damage that went through.
pub(super) fn checks(tally: &mut Tally, each: u32) -> Vec<(&'static str, Findings)> {
    let each = each as usize;
    let mut found = Vec::new();
    let streams: Vec<(String, Vec<u8>)> = match golden::streams() {
        Ok(all) => all.into_iter().map(|golden| (golden.name, golden.bytes)).collect(),
        Err(why) => {
            tally.check("broken streams", || Err(why));
            return found;
        }
    };
    // A caught panic is reported by its check; the default hook would print it as well.
    let hook = std::panic::take_hook();
    std::panic::set_hook(Box::new(|_| ()));
    for (kind, damage) in KINDS {
        tally.check(&format!("broken streams, {kind}"), || {
            let seen = damage(&streams, each)?;
            let verdict = seen.verdict();
            found.push((kind, seen));
            Ok(verdict)
        });
    }
    std::panic::set_hook(hook);
    found
}

fn cut(streams: &Streams, each: usize) -> Result<Findings> {
    let mut seen = Findings::default();
    for (_, bytes) in streams {
        let step = (bytes.len() / each).max(1);
        for end in (0..bytes.len()).step_by(step) {
            seen.decode(&bytes[..end], &DecodeOptions::default(), Allowed::Error)?;
            seen.decode(&bytes[..end], &salvage(), Allowed::Scene)?;
        }
    }
    Ok(seen)
}

fn flipped(streams: &Streams, each: usize) -> Result<Findings> {
    let (mut seen, mut rng) = (Findings::default(), Rng::seeded(1));
    for (name, bytes) in streams {
        let coarsest = Index::parse(bytes)?.coarsest_lod();
        for _ in 0..each {
            let mut broken = bytes.clone();
            let at = rng.below(broken.len());
            broken[at] ^= 1 << rng.below(8);
            // Damage of a coarse level shows where that level is decoded.
            let before = seen.errors.values().sum::<usize>();
            for lod in 0..=coarsest {
                let mut options = DecodeOptions::default();
                options.lod = lod;
                seen.decode(&broken, &options, Allowed::Scene)?;
            }
            let noticed = seen.errors.values().sum::<usize>() > before;
            ensure!(noticed, "byte {at} of {name} was changed and no level shows it");
            seen.decode(&broken, &salvage(), Allowed::Scene)?;
        }
    }
    Ok(seen)
}

fn spliced(streams: &Streams, each: usize) -> Result<Findings> {
    let (mut seen, mut rng) = (Findings::default(), Rng::seeded(2));
    for (i, (_, a)) in streams.iter().enumerate() {
        for _ in 0..each {
            let (_, b) = &streams[(i + 1 + rng.below(streams.len() - 1)) % streams.len()];
            let at = 1 + rng.below(a.len().min(b.len()) - 1);
            let spliced = [&a[..at], &b[at..]].concat();
            // Two streams may begin or end with the same bytes. Then this is one of them, whole.
            let whole = spliced == *a || spliced == *b;
            let allowed = if whole { Allowed::Scene } else { Allowed::Error };
            seen.decode(&spliced, &DecodeOptions::default(), allowed)?;
        }
    }
    Ok(seen)
}

/// Bytes of heads and layers changed, and layers exchanged, under checksums that are right.
fn forged(streams: &Streams, each: usize) -> Result<Findings> {
    let (mut seen, mut rng) = (Findings::default(), Rng::seeded(3));
    let mut parsed: Vec<(Index, &[u8])> = Vec::new();
    for (name, bytes) in streams {
        // A stream that is whole is sealed already.
        let mut sealed = bytes.clone();
        seal::repair(&mut sealed);
        ensure!(sealed == *bytes, "{name}: its checksums are not where they should be");
        parsed.push((Index::parse(bytes)?, bytes));
    }
    for (index, bytes) in &parsed {
        for round in 0..each {
            let mut broken = bytes.to_vec();
            let head = index.head_len as usize;
            match round % 3 {
                // Behind signature, version and length.
                0 => broken[13 + rng.below(head - 17)] = rng.bits() as u8,
                1 if head < broken.len() => {
                    let at = head + rng.below(broken.len() - head);
                    broken[at] = rng.bits() as u8;
                }
                _ => {
                    let (other, of) = &parsed[rng.below(parsed.len())];
                    exchange(index, &mut broken, other, of, &mut rng);
                }
            }
            seal::repair(&mut broken);
            seen.decode(&broken, &DecodeOptions::default(), Allowed::Anything)?;
        }
    }
    Ok(seen)
}

/// Writes a layer of one stream over a layer of another, as far as it goes.
fn exchange(own: &Index, into: &mut [u8], other: &Index, from: &[u8], rng: &mut Rng) {
    let any = |index: &Index, rng: &mut Rng| {
        let layers: Vec<_> = index.chunks.iter().flat_map(|c| &c.layers).collect();
        let layer = layers.get(rng.below(layers.len())).map(|l| l.range());
        layer.map_or(0..0, |r| r.start as usize..r.end as usize)
    };
    let (to, from) = (&mut into[any(own, rng)], &from[any(other, rng)]);
    let len = to.len().min(from.len());
    to[..len].copy_from_slice(&from[..len]);
}

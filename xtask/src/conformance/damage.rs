//! Broken streams, made from the golden ones: cut, with a bit flipped, spliced, and changed with
//! correct checksums. The decoder must return an error or a valid scene, and must not panic.

use std::collections::BTreeMap;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::time::{Duration, Instant};

use anyhow::{Result, bail, ensure};
use gsvx::{DecodeOptions, Index};
use testing::Rng;

use super::forge::{self, Layers};
use super::{Tally, Verdict, golden};

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
enum Outcome {
    /// Only an error.
    Error,
    /// An error or a valid scene.
    Scene,
    /// An error or any scene: exact Gaussians may be any floats.
    Anything,
}

impl Findings {
    /// Decodes one broken stream.
    fn decode(&mut self, bytes: &[u8], options: &DecodeOptions, allowed: Outcome) -> Result<()> {
        let started = Instant::now();
        let result = catch_unwind(AssertUnwindSafe(|| gsvx::decode_with(bytes, options)));
        let took = started.elapsed();
        self.streams += 1;
        self.slowest = self.slowest.max(took);
        ensure!(took < SLOWEST, "a stream of {} bytes took {took:.1?}", bytes.len());
        match result {
            Err(_) => bail!("the decoder panicked on {} bytes", bytes.len()),
            Ok(Ok(decoded)) => {
                let must_fail = allowed == Outcome::Error;
                ensure!(!must_fail, "a broken stream of {} bytes was decoded", bytes.len());
                if allowed == Outcome::Scene {
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
            seen.decode(&bytes[..end], &DecodeOptions::default(), Outcome::Error)?;
            seen.decode(&bytes[..end], &salvage(), Outcome::Scene)?;
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
                seen.decode(&broken, &options, Outcome::Scene)?;
            }
            let noticed = seen.errors.values().sum::<usize>() > before;
            ensure!(noticed, "byte {at} of {name} was changed and no level shows it");
            seen.decode(&broken, &salvage(), Outcome::Scene)?;
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
            let allowed = if whole { Outcome::Scene } else { Outcome::Error };
            seen.decode(&spliced, &DecodeOptions::default(), allowed)?;
        }
    }
    Ok(seen)
}

/// Bytes of heads and layers changed, and layers exchanged, under checksums that are right.
fn forged(streams: &Streams, each: usize) -> Result<Findings> {
    let (mut seen, mut rng) = (Findings::default(), Rng::seeded(3));
    let apart: Vec<(Index, Layers)> =
        streams.iter().map(|(_, bytes)| forge::take_apart(bytes)).collect();
    for ((index, own), (_, bytes)) in apart.iter().zip(streams) {
        for round in 0..each {
            let mut layers = own.clone();
            let (_, others) = &apart[rng.below(apart.len())];
            let broken = match (round % 3, any(own, &mut rng), any(others, &mut rng)) {
                (1, Some([chunk, layer]), _) if !layers[chunk][layer].is_empty() => {
                    let layer = &mut layers[chunk][layer];
                    let at = rng.below(layer.len());
                    layer[at] = rng.bits() as u8;
                    forge::assemble(index, &layers)
                }
                (2, Some(to), Some(from)) => {
                    layers[to[0]][to[1]].clone_from(&others[from[0]][from[1]]);
                    forge::assemble(index, &layers)
                }
                _ => {
                    // Behind signature, version and length.
                    let (head, rest) = bytes.split_at(index.head_len as usize);
                    let mut body = head[13..head.len() - 4].to_vec();
                    let at = rng.below(body.len());
                    body[at] = rng.bits() as u8;
                    [&forge::with_checksum(body), rest].concat()
                }
            };
            seen.decode(&broken, &DecodeOptions::default(), Outcome::Anything)?;
        }
    }
    Ok(seen)
}

/// Chunk and number of a layer, if there is one.
fn any(layers: &Layers, rng: &mut Rng) -> Option<[usize; 2]> {
    let chunk = (!layers.is_empty()).then(|| rng.below(layers.len()))?;
    Some([chunk, rng.below(layers[chunk].len())])
}

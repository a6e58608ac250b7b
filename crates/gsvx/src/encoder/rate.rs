//! Rate control: the quality whose stream hits a size or a measured quality.
//!
//! Everything is decided by real coding. The caller supplies a function from quality to a
//! stream (it may voxelize differently at each quality); the search brackets the target and
//! closes in by interpolating in the logarithm of the size, which is nearly linear in quality.

use super::measure::Measure;
use crate::error::Result;

/// Qualities a search looks at; [`crate::Steps::of_quality`] accepts these.
const LOWEST: f32 = 0.0;
const HIGHEST: f32 = 100.0;
/// Encodes after which a search returns the best stream found so far.
const MAX_ENCODES: usize = 14;
/// A stream this close below the byte target ends the search.
const BYTES_TOLERANCE: f64 = 0.005;
/// Where a search begins.
const FIRST: f32 = 50.0;
/// How the logarithm of the size grows per quality point, on the scenes measured: only how far the second encode goes
/// depends on it.
const LOG_BYTES_PER_POINT: f64 = 0.034;
/// Steps out of the known range go this much too far, so that the target ends up between.
const OVERSHOOT: f64 = 1.2;

/// The outcome of a search.
#[derive(Clone, Debug)]
pub struct SearchResult<T> {
    /// The stream.
    pub encoded: T,
    /// Its quality.
    pub quality: f32,
    /// Streams encoded on the way.
    pub encodes: usize,
    /// The measured value, for searches that measure one.
    pub measured: Option<f64>,
    /// Whether the target is reached. If not, there is no better stream.
    pub reached: bool,
}

/// The largest stream not above `target` bytes.
///
/// Ends within 0.5 % below the target where the stream's size is continuous in quality; if even
/// the best quality is smaller, that stream is returned. If quality 0 is still larger, that stream is
/// returned, and [`SearchResult::reached`] is false.
///
/// # Errors
/// Errors of `encode`.
pub fn to_bytes<T: AsRef<[u8]>>(
    target: u64,
    mut encode: impl FnMut(f32) -> Result<T>,
) -> Result<SearchResult<T>> {
    let log = |bytes: f64| libm::log(bytes.max(1.0));
    let least = target as f64 * (1.0 - BYTES_TOLERANCE);
    let search = Search {
        // A little below the target: from above counts as a miss.
        aim: log(target as f64 * (1.0 - 0.5 * BYTES_TOLERANCE)),
        per_point: LOG_BYTES_PER_POINT,
        reaches: |log_bytes| log_bytes <= log(target as f64),
        near: |log_bytes| log_bytes >= log(least),
        best: HIGHEST,
    };
    let found = search.run(|quality| {
        let encoded = encode(quality)?;
        let log_bytes = log(encoded.as_ref().len() as f64);
        Ok((encoded, log_bytes))
    })?;
    Ok(SearchResult { measured: None, ..found })
}

/// The smallest stream found whose value by a measure reaches `target`.
///
/// If even the best quality falls short, that stream is returned, and [`SearchResult::reached`] is false.
///
/// # Errors
/// Errors of `encode` and `value`.
pub(crate) fn to_measure<T>(
    measure: Measure,
    target: f64,
    mut encode: impl FnMut(f32) -> Result<T>,
    mut value: impl FnMut(&T) -> Result<f64>,
) -> Result<SearchResult<T>> {
    let search = Search {
        aim: target + 0.5 * measure.tolerance(),
        per_point: measure.per_point(),
        reaches: |value| value >= target,
        near: |value| value <= target + measure.tolerance(),
        best: LOWEST,
    };
    search.run(|quality| {
        let encoded = encode(quality)?;
        let value = value(&encoded)?;
        Ok((encoded, value))
    })
}

/// A search for a value that grows with quality.
struct Search<R, N> {
    /// The value that is best.
    aim: f64,
    /// About how much a quality point adds.
    per_point: f64,
    /// Whether a value reaches the target.
    reaches: R,
    /// Whether a value that does is near enough.
    near: N,
    /// The quality wanted most among those that reach the target: the lowest or the highest.
    best: f32,
}

impl<R: Fn(f64) -> bool, N: Fn(f64) -> bool> Search<R, N> {
    fn run<T>(&self, mut encode: impl FnMut(f32) -> Result<(T, f64)>) -> Result<SearchResult<T>> {
        let worst = LOWEST + HIGHEST - self.best;
        let mut good: Option<(f32, f64, T)> = None;
        let mut bad: Option<(f32, f64)> = None;
        let mut encodes = 0;
        loop {
            let known = good.as_ref().map(|g| (g.0, g.1));
            let quality = match (known, bad) {
                (None, None) => FIRST,
                // The last attempt at all is what reaches the target if anything does.
                (None, Some(_)) if encodes + 1 == MAX_ENCODES => worst,
                (None, Some((from, value))) | (Some((from, value)), None) => {
                    outwards(from, (self.aim - value) / self.per_point)
                }
                (Some(a), Some(b)) => {
                    let (low, high) = if a.0 < b.0 { (a, b) } else { (b, a) };
                    between(low.0, high.0, (self.aim - low.1) / (high.1 - low.1))
                }
            };
            let (encoded, value) = encode(quality)?;
            encodes += 1;
            let reached = (self.reaches)(value);
            let end = if reached { self.best } else { worst };
            let done = encodes >= MAX_ENCODES || quality == end || reached && (self.near)(value);
            if reached || done && good.is_none() {
                good = Some((quality, value, encoded));
            } else {
                bad = Some((quality, value));
            }
            if done && let Some((quality, value, encoded)) = good.take() {
                let (measured, reached) = (Some(value), (self.reaches)(value));
                return Ok(SearchResult { encoded, quality, encodes, measured, reached });
            }
        }
    }
}

/// A quality beyond `from` by about `points`, in either direction.
fn outwards(from: f32, points: f64) -> f32 {
    (from + (OVERSHOOT * points + f64::from(points.signum() as f32)) as f32).clamp(LOWEST, HIGHEST)
}

/// A quality at the share `t` of the way from `low` to `high`, away from the ends, so that a bend
/// in the curve cannot stall the search.
fn between(low: f32, high: f32, t: f64) -> f32 {
    low + (high - low) * (t as f32).clamp(0.05, 0.95)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A stand-in coder whose size is `base * 2^(q / 20)`.
    fn coder(base: f64) -> impl FnMut(f32) -> Result<Vec<u8>> {
        move |q| {
            let n = base * libm::exp2(f64::from(q) / 20.0);
            Ok(vec![0; n as usize])
        }
    }

    #[test]
    fn byte_targets_are_hit_from_below() {
        for target in [1001, 1500, 5000, 20_000, 31_999] {
            let found = to_bytes(target, coder(1000.0)).unwrap();
            let n = found.encoded.len() as f64 / target as f64;
            assert!((0.99..=1.0).contains(&n), "{target}: {n} after {}", found.encodes);
        }
    }

    #[test]
    fn a_target_above_the_best_stream_gives_the_best_stream() {
        let found = to_bytes(1_000_000, coder(1000.0)).unwrap();
        assert_eq!((found.encoded.len(), found.quality), (32_000, 100.0));
    }

    #[test]
    fn a_target_below_the_smallest_stream_gives_the_smallest_stream() {
        let found = to_bytes(999, coder(1000.0)).unwrap();
        assert_eq!((found.encoded.len(), found.quality, found.reached), (1000, 0.0, false));
    }

    #[test]
    fn measures_are_reached_and_barely() {
        for target in [12.0, 25.0, 33.3, 39.0] {
            let value = |e: &Vec<u8>| Ok(10.0 * libm::log10(e.len() as f64));
            let found = to_measure(Measure::Psnr, target, coder(10.0), value).unwrap();
            let got = found.measured.unwrap();
            let best = 10.0 * libm::log10(320.0);
            if target < best {
                assert!(got >= target && got < target + 0.2, "{target}: {got}");
            } else {
                assert!(got < target && found.quality == 100.0);
            }
        }
    }
}

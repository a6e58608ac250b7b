//! Rate control: the quality whose stream hits a size or a measured quality.
//!
//! Everything is decided by real coding. The caller supplies a function from quality to a
//! stream (it may voxelize differently at each quality); the search brackets the target and
//! closes in by interpolating in the logarithm of the size, which is nearly linear in quality.

use crate::encode::Encoded;
use crate::error::{Error, Result};

/// Qualities a search looks at; [`crate::EncodeOptions::from_quality`] accepts these.
const LOWEST: f32 = 0.0;
const HIGHEST: f32 = 100.0;
/// Encodes after which a search returns the best stream found so far.
const MAX_ENCODES: usize = 14;
/// A stream this close below the byte target ends the search.
const BYTES_TOLERANCE: f64 = 0.005;
/// A measure this close above its target ends the search (dB for PSNR).
const MEASURE_TOLERANCE: f64 = 0.01;

/// The outcome of a search.
#[derive(Clone, Debug)]
pub struct Found {
    /// The stream.
    pub encoded: Encoded,
    /// Its quality.
    pub quality: f32,
    /// Streams encoded on the way.
    pub encodes: usize,
    /// The measured value, for searches that measure one.
    pub measured: Option<f64>,
}

/// The largest stream not above `target` bytes.
///
/// Ends within 0.5 % below the target where the stream's size is continuous in quality; if even
/// the best quality is smaller, that stream is returned.
///
/// # Errors
/// [`Error::TargetTooSmall`] if quality 0 is still larger; errors of `encode`.
pub fn to_bytes(target: u64, mut encode: impl FnMut(f32) -> Result<Encoded>) -> Result<Found> {
    let mut encodes = 1;
    let low = encode(LOWEST)?;
    let smallest = low.bytes.len() as u64;
    if smallest > target {
        return Err(Error::TargetTooSmall { target, smallest });
    }
    let mut below = (LOWEST, low);
    let mut above: Option<(f32, u64)> = None;
    while encodes < MAX_ENCODES {
        let have = below.1.bytes.len() as f64;
        if have >= target as f64 * (1.0 - BYTES_TOLERANCE) {
            break;
        }
        let quality = match above {
            None => HIGHEST,
            Some((high, bytes)) => {
                // Aim a little below the target: from above counts as a miss.
                let aim = target as f64 * (1.0 - 0.5 * BYTES_TOLERANCE);
                let t = libm::log(aim / have) / libm::log(bytes as f64 / have);
                // Away from the ends, so that a bend in the curve cannot stall the search.
                below.0 + (high - below.0) * (t as f32).clamp(0.05, 0.95)
            }
        };
        let next = encode(quality)?;
        encodes += 1;
        let bytes = next.bytes.len() as u64;
        if bytes <= target {
            below = (quality, next);
            if quality >= HIGHEST {
                break;
            }
        } else {
            above = Some((quality, bytes));
        }
    }
    Ok(Found { quality: below.0, encoded: below.1, encodes, measured: None })
}

/// The smallest stream found whose measure (larger is better, say PSNR in dB) reaches `target`.
///
/// If even the best quality falls short, that stream is returned; compare
/// [`Found::measured`].
///
/// # Errors
/// Errors of `encode` and `measure`.
pub fn to_measure(
    target: f64,
    mut encode: impl FnMut(f32) -> Result<Encoded>,
    mut measure: impl FnMut(&Encoded) -> Result<f64>,
) -> Result<Found> {
    let mut at = |quality: f32| -> Result<(f32, Encoded, f64)> {
        let encoded = encode(quality)?;
        let value = measure(&encoded)?;
        Ok((quality, encoded, value))
    };
    let mut good = at(HIGHEST)?;
    let mut encodes = 1;
    let mut bad: Option<(f32, f64)> = None;
    while good.2 > target + MEASURE_TOLERANCE && encodes < MAX_ENCODES {
        let quality = match bad {
            None => LOWEST,
            Some((low, value)) => {
                // Quality curves flatten towards the top: lean to the middle.
                let t = (target + 0.5 * MEASURE_TOLERANCE - value) / (good.2 - value);
                low + (good.0 - low) * (0.5 * (t as f32) + 0.25).clamp(0.05, 0.95)
            }
        };
        let next = at(quality)?;
        encodes += 1;
        if next.2 >= target {
            good = next;
            if quality <= LOWEST {
                break;
            }
        } else {
            bad = Some((quality, next.2));
        }
    }
    Ok(Found { quality: good.0, encoded: good.1, encodes, measured: Some(good.2) })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A stand-in coder whose size is `base * 2^(q / 20)`.
    fn coder(base: f64) -> impl FnMut(f32) -> Result<Encoded> {
        move |q| {
            let n = base * libm::exp2(f64::from(q) / 20.0);
            Ok(Encoded { bytes: vec![0; n as usize], sections: Vec::new() })
        }
    }

    #[test]
    fn byte_targets_are_hit_from_below() {
        for target in [1001, 1500, 5000, 20_000, 31_999] {
            let found = to_bytes(target, coder(1000.0)).unwrap();
            let n = found.encoded.bytes.len() as f64 / target as f64;
            assert!((0.99..=1.0).contains(&n), "{target}: {n} after {}", found.encodes);
        }
    }

    #[test]
    fn a_target_above_the_best_stream_gives_the_best_stream() {
        let found = to_bytes(1_000_000, coder(1000.0)).unwrap();
        assert_eq!((found.encoded.bytes.len(), found.quality), (32_000, 100.0));
    }

    #[test]
    fn a_target_below_the_smallest_stream_is_an_error() {
        let error = to_bytes(999, coder(1000.0)).unwrap_err();
        assert!(matches!(error, Error::TargetTooSmall { target: 999, smallest: 1000 }));
    }

    #[test]
    fn measures_are_reached_and_barely() {
        for target in [12.0, 25.0, 33.3, 39.0] {
            let measure = |e: &Encoded| Ok(10.0 * libm::log10(e.bytes.len() as f64));
            let found = to_measure(target, coder(10.0), measure).unwrap();
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

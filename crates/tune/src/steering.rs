//! Steering: the quality follows the target while the loop runs.

use gsvx::EncodedStream;

use crate::codec_loop::CodecLoop;
use crate::error::Result;
use crate::options::Target;

/// How the logarithm of the size and the PSNR in dB grow per quality point.
const LOG_BYTES_PER_POINT: f64 = 0.03;
const DB_PER_POINT: f64 = 0.12;
/// Share of a miss that is corrected at once.
const GAIN: f64 = 0.5;
/// Most points of a correction.
const MOST: f64 = 1.5;
/// Bytes below the target that a run aims for.
const MARGIN: f64 = 0.004;
/// A PSNR is only steered in the last part of a run: before that it still grows.
const PSNR_FROM: f64 = 0.6;
/// Bytes at the end of the loop over those at its beginning, about.
const LAST_OVER_FIRST: f64 = 0.93;
/// Tries to begin at the right size.
const FIRST_TRIES: usize = 6;
/// Coarser and coarser steps at the end, until the bytes fit.
const LAST_TRIES: usize = 40;

/// Begins at steps that will lead to a target in bytes.
pub(crate) fn begin(state: &mut CodecLoop, target: Target) -> Result<()> {
    let Target::Bytes(bytes) = target else { return Ok(()) };
    for _ in 0..FIRST_TRIES {
        state.settle()?;
        let miss = libm::log(bytes as f64 / (LAST_OVER_FIRST * state.bytes.max(1) as f64));
        if miss.abs() < MARGIN {
            break;
        }
        state.set_quality(state.quality + (miss / LOG_BYTES_PER_POINT) as f32)?;
    }
    Ok(())
}

/// Corrects the quality; `psnr` is that at the views kept aside.
pub(crate) fn steer(state: &mut CodecLoop, target: Target, psnr: f64) -> Result<()> {
    let share = state.done as f64 / state.steps.max(1) as f64;
    let points = match target {
        Target::Quality(_) => return Ok(()),
        Target::Bytes(bytes) => {
            let aim = bytes as f64 * (1.0 - MARGIN);
            libm::log(aim / state.bytes.max(1) as f64) / LOG_BYTES_PER_POINT
        }
        Target::Psnr(_) if share < PSNR_FROM => return Ok(()),
        Target::Psnr(db) => (db - psnr) / DB_PER_POINT,
    };
    let points = (GAIN * points).clamp(-MOST, MOST);
    state.set_quality(state.quality + points as f32)
}

/// The stream; with a target in bytes one that fits it, if there is one.
pub(crate) fn fitting(state: &mut CodecLoop, target: Target) -> Result<EncodedStream> {
    let mut encoded = state.latents.encode(state.leaves.outliers.as_ref())?;
    let Target::Bytes(bytes) = target else { return Ok(encoded) };
    for _ in 0..LAST_TRIES {
        let over = encoded.bytes.len() as f64 / bytes as f64;
        if over <= 1.0 || state.quality <= 0.0 {
            break;
        }
        let points = (libm::log(over) / LOG_BYTES_PER_POINT).max(0.05);
        state.set_quality(state.quality - points as f32)?;
        state.settle()?;
        encoded = state.latents.encode(state.leaves.outliers.as_ref())?;
    }
    Ok(encoded)
}

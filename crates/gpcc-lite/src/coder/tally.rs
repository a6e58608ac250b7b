//! Counts the bits of a stream without writing it.

use super::Coder;
use crate::symbols::{SCALE_BITS, Symbols};

/// Counts what a [`RansEncoder`](super::RansEncoder) would write, without writing it.
#[derive(Clone, Copy, Debug)]
pub struct Tally {
    /// Whole bits.
    bits: u64,
    /// The product of the probabilities of what is not in `bits` yet, above 2^-512.
    probability: f64,
}

impl Default for Tally {
    fn default() -> Self {
        Self { bits: 0, probability: 1.0 }
    }
}

/// 2^-512 and its inverse.
const SMALL: f64 = f64::from_bits((1023 - 512) << 52);
const LARGE: f64 = f64::from_bits((1023 + 512) << 52);

impl Tally {
    /// The number of bits so far, rounded to whole bits.
    #[must_use]
    pub fn bits(&self) -> u64 {
        self.bits + (1023 - (self.probability.to_bits() >> 52))
    }

    #[inline]
    fn interval(&mut self, size: u32) {
        self.probability *= f64::from(size) * (1.0 / f64::from(1u32 << SCALE_BITS));
        if self.probability < SMALL {
            self.probability *= LARGE;
            self.bits += 512;
        }
    }
}

impl Coder for Tally {
    const ENCODING: bool = true;

    #[inline]
    fn decision(&mut self, p1: u32, value: bool) -> bool {
        self.interval(if value { p1 } else { (1 << SCALE_BITS) - p1 });
        value
    }

    #[inline]
    fn symbol(&mut self, model: &mut Symbols, value: usize) -> usize {
        self.interval(model.interval(value).1);
        model.learn(value);
        value
    }

    #[inline]
    fn bits(&mut self, value: u32, n: u32) -> u32 {
        self.bits += u64::from(n);
        value
    }

    #[inline]
    fn bits_and_sign(&mut self, above: u32, value: u32, n: u32, negative: bool) -> (u32, bool) {
        self.bits += u64::from(n) + u64::from(above | value != 0);
        (value, negative)
    }

    fn exhausted(&self) -> bool {
        false
    }
}

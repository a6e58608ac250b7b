//! Adaptive probability of one binary decision.

use crate::range::BinaryCoder;

/// A 22-bit probability with a 10-bit counter: learns as 1/n, then at the rate `1 / limit`.
#[derive(Clone, Copy, Debug)]
pub struct Bit(u32);

impl Default for Bit {
    fn default() -> Self {
        Self(1 << 31)
    }
}

/// Reciprocals `65536 / (n + 1.5)`, the learning rate after `n` observations.
const RATE: [u32; 1024] = {
    let mut t = [0u32; 1024];
    let mut n = 0;
    while n < 1024 {
        t[n] = (65536 * 2) / (2 * n as u32 + 3);
        n += 1;
    }
    t
};

/// `N` counters that know nothing.
pub(crate) fn table<const N: usize>() -> Box<[Bit; N]> {
    match vec![Bit::default(); N].try_into() {
        Ok(t) => t,
        Err(_) => unreachable!("the vector has N elements"),
    }
}

impl Bit {
    /// A counter that believes the 16-bit probability `p1` as if after `count` observations.
    #[must_use]
    pub fn with_prior(p1: u32, count: u32) -> Self {
        Self(((p1.min(65535) << 6) << 10) | count.min(1023))
    }

    /// Probability that the next decision is true, 16 bits, never 0 or 65536.
    #[inline]
    #[must_use]
    pub fn p1(self) -> u32 {
        (self.0 >> 16).clamp(32, 65535 - 31)
    }

    /// Number of observations, saturating at the limit used in [`Bit::update`].
    #[inline]
    #[must_use]
    pub fn count(self) -> u32 {
        self.0 & 1023
    }

    /// [`crate::mix::stretch`] of [`Bit::p1`].
    #[inline]
    #[must_use]
    pub fn stretched(self) -> i32 {
        crate::mix::stretch_of_state(self.0)
    }

    /// Learns `bit`; `limit` (at most 1023) is the memory in observations.
    #[inline]
    pub fn update(&mut self, bit: bool, limit: u32) {
        let n = self.0 & 1023;
        let p = self.0 >> 10;
        let target = if bit { (1 << 22) - 1 } else { 0 };
        let delta = ((i64::from(target) - i64::from(p)) * i64::from(RATE[n as usize])) >> 16;
        self.0 = self.0.wrapping_add((delta as u32) << 10) + u32::from(n < limit);
    }

    /// Codes one decision and learns it.
    #[inline]
    pub fn code<C: BinaryCoder>(&mut self, coder: &mut C, bit: bool, limit: u32) -> bool {
        let bit = coder.code(self.p1(), bit);
        self.update(bit, limit);
        bit
    }
}

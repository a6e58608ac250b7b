//! The adaptive model of a decision, in integers.

use crate::symbols::SCALE_BITS;

/// Probability that a decision is true: 22 bits, and below them the number `n` of observations in
/// 10 bits. The model learns at the rate `1 / (n + 1.5)`, and `n` ends at a limit.
#[derive(Clone, Copy, Debug)]
pub struct Bit(u32);

impl Default for Bit {
    /// Even chances, no observation.
    fn default() -> Self {
        Self(1 << 31)
    }
}

/// `65536 / (n + 1.5)`: the learning rate after `n` observations.
const RATE: [u32; 1024] = {
    let mut t = [0u32; 1024];
    let mut n = 0;
    while n < 1024 {
        t[n] = (65536 * 2) / (2 * n as u32 + 3);
        n += 1;
    }
    t
};

impl Bit {
    /// Probability that the next decision is true, in 1/2^15, never 0 or 1.
    #[inline]
    #[must_use]
    pub(crate) fn p1(self) -> u32 {
        (self.0 >> 17).clamp(16, (1 << SCALE_BITS) - 16)
    }

    /// `ln(p / (1 - p))` of the probability, with 8 fraction bits.
    #[inline]
    #[must_use]
    pub(crate) fn stretched(self) -> i32 {
        crate::logistic::stretch_of_state(self.0)
    }

    /// Learns a decision; `limit` (at most 1023) is the memory in observations.
    #[inline]
    pub(crate) fn learn(&mut self, value: bool, limit: u32) {
        let n = self.0 & 1023;
        let p = self.0 >> 10;
        let target = if value { (1 << 22) - 1 } else { 0 };
        let delta = ((i64::from(target) - i64::from(p)) * i64::from(RATE[n as usize])) >> 16;
        self.0 = self.0.wrapping_add((delta as u32) << 10) + u32::from(n < limit);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_decision_learns_and_never_becomes_certain() {
        let mut b = Bit::default();
        for i in 0..100_000u32 {
            b.learn(true, 255);
            assert!(b.p1() <= (1 << SCALE_BITS) - 16 && b.0 & 1023 <= 255, "{i}");
        }
        assert_eq!(b.p1(), (1 << SCALE_BITS) - 16);
        (0..20_000).for_each(|_| b.learn(false, 255));
        assert_eq!(b.p1(), 16);
        // Half of the time: the first observations count as 1/n.
        let mut b = Bit::default();
        (0..1000).for_each(|i| b.learn(i % 2 == 0, 1023));
        assert!(b.p1().abs_diff(1 << (SCALE_BITS - 1)) < 200);
    }
}

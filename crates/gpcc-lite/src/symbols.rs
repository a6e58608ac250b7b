//! The adaptive model of a symbol out of sixteen, in integers.

use wide::i16x16;

/// Interval sizes sum to `2^SCALE_BITS`.
pub(crate) const SCALE_BITS: u32 = 15;
/// Number of symbols of a [`Symbols`] model.
pub(crate) const SYMBOLS: usize = 16;
/// What each observation adds to a symbol's count.
const INCREMENT: u16 = 32;
/// Counts are halved when their sum is worth this many observations.
const HALVE_AFTER: u32 = 1024;
/// Observations before intervals are first made from the counts, and the most between two updates.
const FIRST_INTERVAL: u8 = 4;
const MAX_INTERVAL: u8 = 64;

/// Model of a symbol out of sixteen. Every observation adds to a count. The intervals that the
/// coder uses are made from the counts after 4 observations, after 8 more, 16 more, 32 more, and
/// then every 64: so learning is cheap.
#[derive(Clone, Copy, Debug)]
#[repr(align(64))]
pub struct Symbols {
    /// Start of each symbol's interval, and the end of the last.
    start: [u16; SYMBOLS + 1],
    counts: [u16; SYMBOLS],
    /// Observations left until the intervals are made again, and how many there were at first.
    wait: u8,
    interval: u8,
}

impl Symbols {
    /// A model that expects geometric symbols of the given mean (8 fraction bits), as if after
    /// `weight` observations (at most 1024).
    #[must_use]
    pub fn geometric(mean: u32, weight: u32) -> Self {
        let mean = u64::from(mean);
        // Of the symbols `s` and above, this share is above `s`, for any `s`.
        let more = (mean * 65536 / (mean + 256)).clamp(300, 65000);
        let mut left = u64::from(weight * u32::from(INCREMENT)) << 16;
        let counts = std::array::from_fn(|_| {
            let beyond = (left * more) >> 16;
            let count = (left - beyond) >> 16;
            left = beyond;
            count as u16 + 1
        });
        let mut this = Self {
            counts,
            start: [1 << SCALE_BITS; SYMBOLS + 1],
            wait: FIRST_INTERVAL,
            interval: FIRST_INTERVAL,
        };
        this.make_intervals(this.sum());
        this
    }

    fn sum(&self) -> u32 {
        self.counts.iter().map(|&c| u32::from(c)).sum()
    }

    /// Makes the intervals from the counts; each has a size of 1 or more.
    fn make_intervals(&mut self, sum: u32) {
        let spare = (1 << SCALE_BITS) - SYMBOLS as u32;
        let scale = (u64::from(spare) << 32) / u64::from(sum);
        let mut before = 0u32;
        for (s, (out, &count)) in self.start.iter_mut().zip(&self.counts).enumerate() {
            *out = s as u16 + ((u64::from(before) * scale) >> 32) as u16;
            before += u32::from(count);
        }
    }

    /// Start and size of a symbol's interval.
    #[inline]
    pub(crate) fn interval(&self, symbol: usize) -> (u32, u32) {
        let symbol = symbol % SYMBOLS;
        let start = u32::from(self.start[symbol]);
        (start, u32::from(self.start[symbol + 1]) - start)
    }

    /// The symbol whose interval holds a code. The code is compared with all starts, because a
    /// search would end at a place that no processor predicts.
    #[inline]
    pub(crate) fn find(&self, code: u32) -> usize {
        let starts = std::array::from_fn(|s| self.start[s] as i16);
        let above = i16x16::new(starts).simd_gt(i16x16::splat(code as i16)).to_bitmask();
        (above | 1 << SYMBOLS).trailing_zeros() as usize - 1
    }

    /// Learns a symbol.
    #[inline]
    pub(crate) fn learn(&mut self, symbol: usize) {
        self.counts[symbol % SYMBOLS] += INCREMENT;
        self.wait -= 1;
        if self.wait == 0 {
            self.renew();
        }
    }

    #[cold]
    fn renew(&mut self) {
        let mut sum = self.sum();
        if sum >= u32::from(INCREMENT) * HALVE_AFTER {
            for c in &mut self.counts {
                *c = (*c >> 1) + (*c & 1);
            }
            sum = self.sum();
        }
        self.interval = (2 * self.interval).min(MAX_INTERVAL);
        self.wait = self.interval;
        self.make_intervals(sum);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn intervals_cover_all_codes_whatever_is_learned() {
        for mean in [0, 100, 700, 5000] {
            let mut m = Symbols::geometric(mean, 6);
            for i in 0..5000u32 {
                let mut code = 0;
                for s in 0..SYMBOLS {
                    let (start, size) = m.interval(s);
                    assert!(start == code && size > 0, "{mean} {i} {s}");
                    assert_eq!((m.find(code), m.find(code + size - 1)), (s, s));
                    code += size;
                }
                assert_eq!(code, 1 << SCALE_BITS);
                m.learn(if i < 3000 { 3 } else { (i * i % 17 % 16) as usize });
            }
        }
    }
}

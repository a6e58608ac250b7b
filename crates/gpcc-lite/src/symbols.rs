//! Adaptive model of a symbol out of sixteen: one step of the coder where a binary model takes one
//! per unit of magnitude.
//!
//! Counts are exact; the cumulative frequencies that the coder uses follow them in growing
//! intervals, so that a symbol costs an addition.

use wide::i16x16;

/// Symbols of a model.
pub(crate) const SYMBOLS: usize = 16;
/// Cumulative frequencies have so many bits.
pub(crate) const BITS: u32 = 15;
/// What an observed symbol adds to its count.
const SEEN: u16 = 32;
/// Observations after which all counts are halved.
const MEMORY: u32 = 1024;
/// Observations from the first to the second time that the frequencies are made, and at most.
const FIRST: u8 = 4;
const LONGEST: u8 = 64;

/// The model.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Symbols {
    /// Sums of the frequencies of the symbols before each; after all of them it would be `2^BITS`.
    before: [i16; SYMBOLS],
    counts: [u16; SYMBOLS],
    /// Observations until the frequencies are made again, and of how many that was.
    wait: u8,
    interval: u8,
}

impl Symbols {
    /// A model that expects geometric symbols of the given mean (8 fraction bits), as if after
    /// `weight` observations.
    pub(crate) fn geometric(mean: u32, weight: u32) -> Self {
        let mean = u64::from(mean);
        // Of those that are left, those beyond this one.
        let more = (mean * 65536 / (mean + 256)).clamp(300, 65000);
        let mut left = u64::from(weight * u32::from(SEEN)) << 16;
        let counts = std::array::from_fn(|_| {
            let beyond = (left * more) >> 16;
            let count = (left - beyond) >> 16;
            left = beyond;
            count as u16 + 1
        });
        let mut this = Self { counts, before: [0; SYMBOLS], wait: FIRST, interval: FIRST };
        this.make(this.sum());
        this
    }

    fn sum(&self) -> u32 {
        self.counts.iter().map(|&c| u32::from(c)).sum()
    }

    /// Makes the frequencies from the counts; each is 1 or more.
    fn make(&mut self, sum: u32) {
        let spare = (1 << BITS) - SYMBOLS as u32;
        let scale = (u64::from(spare) << 32) / u64::from(sum);
        let mut before = 0u32;
        for (s, (out, &count)) in self.before.iter_mut().zip(&self.counts).enumerate() {
            *out = s as i16 + ((u64::from(before) * scale) >> 32) as i16;
            before += u32::from(count);
        }
    }

    /// The frequencies before a symbol, and its own.
    #[inline]
    pub(crate) fn interval(&self, symbol: usize) -> (u32, u32) {
        let start = self.before[symbol % SYMBOLS] as u32;
        // After the last symbol comes 2^BITS, which is 0 here.
        let end = self.before[(symbol + 1) % SYMBOLS] as u32;
        (start, end.wrapping_sub(start) % (1 << BITS))
    }

    /// The symbol whose interval holds a code of [`BITS`] bits. Compares with all of them: where
    /// a search ends cannot be foreseen, and a mispredicted branch takes longer.
    #[inline]
    pub(crate) fn find(&self, code: u32) -> usize {
        let above = i16x16::new(self.before).simd_gt(i16x16::splat(code as i16)).to_bitmask();
        (above | 1 << SYMBOLS).trailing_zeros() as usize - 1
    }

    /// Learns a symbol.
    #[inline]
    pub(crate) fn learn(&mut self, symbol: usize) {
        self.counts[symbol % SYMBOLS] += SEEN;
        self.wait -= 1;
        if self.wait == 0 {
            self.renew();
        }
    }

    #[inline(never)]
    fn renew(&mut self) {
        let mut sum = self.sum();
        if sum >= u32::from(SEEN) * MEMORY {
            for c in &mut self.counts {
                *c = (*c >> 1) + (*c & 1);
            }
            sum = self.sum();
        }
        self.interval = (2 * self.interval).min(LONGEST);
        self.wait = self.interval;
        self.make(sum);
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
                assert_eq!(code, 1 << BITS);
                m.learn(if i < 3000 { 3 } else { (i * i % 17 % 16) as usize });
            }
        }
    }
}

//! Adaptive model of a symbol out of sixteen: one step of the coder where a binary model takes one
//! per unit of magnitude.
//!
//! Counts are exact; the cumulative frequencies that the coder uses follow them in growing
//! intervals, so that a symbol costs an addition, and finding it a look into a table.

/// Symbols of a model.
pub(crate) const SYMBOLS: usize = 16;
/// Cumulative frequencies have so many bits.
pub(crate) const BITS: u32 = 15;
/// What an observed symbol adds to its count.
const SEEN: u32 = 32;
/// Observations after which all counts are halved.
const MEMORY: u32 = 1024;
/// Observations from the first to the second time that the frequencies are made, and at most.
const FIRST: u16 = 4;
const LONGEST: u16 = 64;
/// Bits of a code that the table of symbols looks at.
const LOOK: u32 = 6;

/// The model.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Symbols {
    /// Sums of the frequencies of the symbols before each; at the end `2^BITS`.
    before: [u16; SYMBOLS + 1],
    counts: [u16; SYMBOLS],
    sum: u32,
    /// Observations until the frequencies are made again, and of how many that was.
    wait: u16,
    interval: u16,
    /// The symbol at the beginning of each part of the codes.
    at: [u8; 1 << LOOK],
}

impl Symbols {
    /// A model that expects geometric symbols of the given mean (8 fraction bits), as if after
    /// `weight` observations.
    pub(crate) fn geometric(mean: u32, weight: u32) -> Self {
        let mean = u64::from(mean);
        // Of those that are left, those beyond this one.
        let more = (mean * 65536 / (mean + 256)).clamp(300, 65000);
        let mut left = u64::from(weight * SEEN) << 16;
        let counts = std::array::from_fn(|_| {
            let beyond = (left * more) >> 16;
            let count = (left - beyond) >> 16;
            left = beyond;
            count as u16 + 1
        });
        let mut this = Self {
            before: [0; SYMBOLS + 1],
            counts,
            sum: counts.iter().map(|&c| u32::from(c)).sum(),
            wait: FIRST,
            interval: FIRST,
            at: [0; 1 << LOOK],
        };
        this.make();
        this
    }

    /// Makes the frequencies from the counts; each is 1 or more.
    fn make(&mut self) {
        let spare = (1 << BITS) - SYMBOLS as u32;
        let scale = (u64::from(spare) << 32) / u64::from(self.sum);
        let mut before = 0u32;
        for s in 0..SYMBOLS {
            self.before[s] = s as u16 + ((u64::from(before) * scale) >> 32) as u16;
            before += u32::from(self.counts[s]);
        }
        self.before[SYMBOLS] = 1 << BITS;
        let mut s = 0;
        for (i, at) in self.at.iter_mut().enumerate() {
            while u32::from(self.before[s + 1]) <= (i as u32) << (BITS - LOOK) {
                s += 1;
            }
            *at = s as u8;
        }
    }

    /// The frequencies before a symbol, and its own.
    #[inline]
    pub(crate) fn interval(&self, symbol: usize) -> (u32, u32) {
        let symbol = symbol & (SYMBOLS - 1);
        let start = u32::from(self.before[symbol]);
        (start, u32::from(self.before[symbol + 1]) - start)
    }

    /// The symbol whose interval holds a code of [`BITS`] bits.
    #[inline]
    pub(crate) fn find(&self, code: u32) -> usize {
        let mut s = usize::from(self.at[(code >> (BITS - LOOK)) as usize & ((1 << LOOK) - 1)]);
        while s < SYMBOLS - 1 && u32::from(self.before[s + 1]) <= code {
            s += 1;
        }
        s
    }

    /// Learns a symbol.
    #[inline]
    pub(crate) fn learn(&mut self, symbol: usize) {
        self.counts[symbol & (SYMBOLS - 1)] += SEEN as u16;
        self.sum += SEEN;
        self.wait -= 1;
        if self.wait == 0 {
            self.renew();
        }
    }

    #[inline(never)]
    fn renew(&mut self) {
        if self.sum >= SEEN * MEMORY {
            self.sum = 0;
            for c in &mut self.counts {
                *c = (*c >> 1) + (*c & 1);
                self.sum += u32::from(*c);
            }
        }
        self.interval = (2 * self.interval).min(LONGEST);
        self.wait = self.interval;
        self.make();
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

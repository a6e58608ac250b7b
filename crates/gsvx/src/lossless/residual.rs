//! Adaptive coding of prediction errors.
//!
//! An error's bucket (its octave) is coded by steps away from the expected octave, each step a
//! binary decision mixed from four contexts: the errors of the neighbours in this column, of
//! this Gaussian in earlier columns, both, and the last columns alone. Two bits below the
//! leading one are modelled, the others are noise.

use gpcc_lite::coder::Coder;
use gpcc_lite::mix::{Mixer, code_mixed};
use gpcc_lite::model::Bit;

/// Highest bucket: errors stay below 2^26.
pub(super) const TOP: i32 = 26;
/// Memory of the adaptive bits, in observations.
const MEMORY: u32 = 400;
const NODES: usize = 16;
const CONTEXTS: usize = 24;

/// Size of an error in quarter octaves: 0 for 0, 4 for 1, 8 for 2, 10 for 3, 12 for 4, ...
#[inline]
pub(super) fn level(e: u32) -> i32 {
    if e == 0 {
        return 0;
    }
    let octave = e.ilog2();
    let fraction = if octave >= 2 { e >> (octave - 2) & 3 } else { (e << (2 - octave)) & 3 };
    4 * (octave as i32 + 1) + fraction as i32
}

#[inline]
fn bucket(e: u32) -> i32 {
    32 - e.leading_zeros() as i32
}

/// What is known about the size of an error before it is coded; levels.
#[derive(Clone, Copy, Debug)]
pub(super) struct Expect {
    /// From the neighbours.
    pub(super) near: i32,
    /// From all earlier columns of this Gaussian.
    pub(super) own: i32,
    /// From the last columns of this Gaussian.
    pub(super) last: i32,
    /// Context of the sign, below 16.
    pub(super) sign: usize,
}

/// Adaptive state for columns of one kind.
#[derive(Clone, Debug)]
pub(super) struct Models {
    near: Vec<Bit>,
    own: Vec<Bit>,
    both: Vec<Bit>,
    last: Vec<Bit>,
    mixers: Vec<Mixer<4>>,
    sign: [Bit; 16],
    first: [Bit; 32],
    second: [Bit; 64],
}

impl Default for Models {
    fn default() -> Self {
        Self {
            near: vec![Bit::default(); CONTEXTS * NODES],
            own: vec![Bit::default(); CONTEXTS * NODES],
            both: vec![Bit::default(); CONTEXTS * CONTEXTS * NODES],
            last: vec![Bit::default(); CONTEXTS * NODES],
            mixers: vec![Mixer::new(72000); NODES],
            sign: [Bit::default(); 16],
            first: [Bit::default(); 32],
            second: [Bit::default(); 64],
        }
    }
}

impl Models {
    /// Codes an error and `extra` raw bits `low` behind it.
    #[inline]
    pub(super) fn code<C: Coder>(&mut self, coder: &mut C, x: Expect, e: i32) -> i32 {
        let estimate = (x.near + x.own + 1) >> 1;
        let centre = (estimate >> 2).clamp(0, TOP);
        let relative = |level: i32| {
            (level - 4 * centre + CONTEXTS as i32 / 2).clamp(0, CONTEXTS as i32 - 1) as usize
        };
        let (near, own, last) = (relative(x.near), relative(x.own), relative(x.last));
        let at = [near * NODES, own * NODES, (near * CONTEXTS + own) * NODES, last * NODES];
        let size = e.unsigned_abs();
        let b = bucket(size);
        let coded = if self.step(coder, at, 0, b > centre) {
            let mut k = centre + 1;
            while k < TOP && self.step(coder, at, k - centre, b > k) {
                k += 1;
            }
            k
        } else {
            let mut k = centre;
            while k > 0 && !self.step(coder, at, k - 1 - centre, b > k - 1) {
                k -= 1;
            }
            k
        };
        if coded == 0 {
            return 0;
        }
        let negative = self.sign[x.sign].code(coder, e < 0, 1000);
        let below = coded as u32 - 1;
        let mut value = 1u32;
        let mut left = below;
        if left > 0 {
            let at = (coded - centre + 16).clamp(0, 31) as usize;
            left -= 1;
            let first = self.first[at].code(coder, size >> left & 1 == 1, 1000);
            value = value << 1 | u32::from(first);
            if left > 0 {
                left -= 1;
                let at = 2 * at + usize::from(first);
                let second = self.second[at].code(coder, size >> left & 1 == 1, 1000);
                value = value << 1 | u32::from(second);
            }
            if left > 0 {
                let rest = coder.bits(size & ((1 << left) - 1), left);
                value = value << left | rest;
            }
        }
        if negative { -(value as i32) } else { value as i32 }
    }

    #[inline]
    fn step<C: Coder>(&mut self, coder: &mut C, at: [usize; 4], offset: i32, bit: bool) -> bool {
        let node = (offset + 8).clamp(0, 15) as usize;
        let bits = [
            &mut self.near[at[0] + node],
            &mut self.own[at[1] + node],
            &mut self.both[at[2] + node],
            &mut self.last[at[3] + node],
        ];
        code_mixed(coder, &mut self.mixers[node], bits, bit, MEMORY)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use gpcc_lite::coder::{RansDecoder, RansEncoder};
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn errors_come_back(errors in prop::collection::vec((-(1 << 26) + 1..1 << 26, 0..120i32, 0..120i32, 0..120i32), 0..200)) {
            let expect = |near, own, last| Expect { near, own, last, sign: 3 };
            let mut encoder = RansEncoder::default();
            let mut models = Models::default();
            for &(e, a, b, c) in &errors {
                models.code(&mut encoder, expect(a, b, c), e);
            }
            let bytes = encoder.finish();
            let mut decoder = RansDecoder::new(&bytes).unwrap();
            let mut models = Models::default();
            for &(e, a, b, c) in &errors {
                prop_assert_eq!(models.code(&mut decoder, expect(a, b, c), 0), e);
            }
        }
    }
}

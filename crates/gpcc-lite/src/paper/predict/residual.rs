//! Adaptive coder of prediction residuals of any width.

use crate::coder::Coder;
use crate::mix::{Mixer, code_mixed};
use crate::model::Bit;

/// Contexts by expected magnitude, in half-octaves.
const BUCKETS: usize = 40;
/// Memory of the models, in observations.
const LIMIT: u32 = 255;

/// Two models of the class (bit length) of a residual, mixed. The three bits below the leading one
/// have models; the rest are plain bits.
pub(super) struct Residual {
    class: [Vec<[Bit; 64]>; 2],
    mixers: Vec<Mixer<2>>,
    mantissa: Vec<[Bit; 8]>,
    sign: Bit,
}

impl Residual {
    pub(super) fn new() -> Self {
        let table = || vec![[Bit::default(); 64]; BUCKETS];
        Self {
            class: [table(), table()],
            mixers: vec![Mixer::new(72_000); 64],
            mantissa: vec![[Bit::default(); 8]; 34],
            sign: Bit::default(),
        }
    }

    /// Codes `v`, at most 33 bits long, given two expectations of its magnitude.
    pub(super) fn code<C: Coder>(&mut self, coder: &mut C, v: i64, expected: [u64; 2]) -> i64 {
        let expected = expected.map(bucket);
        let magnitude = v.unsigned_abs();
        let class = 64 - magnitude.leading_zeros();
        let mut node = 1usize;
        for level in (0..6).rev() {
            let [a, b] = &mut self.class;
            let (a, b) = (&mut a[expected[0]][node], &mut b[expected[1]][node]);
            let value = class >> level & 1 == 1;
            let bit = code_mixed(coder, &mut self.mixers[node], [a, b], value, LIMIT);
            node = node * 2 + usize::from(bit);
        }
        let class = (node as u32 - 64).min(33);
        if class == 0 {
            return 0;
        }
        let rest = class - 1;
        let modelled = rest.min(3);
        let mut prefix = 1usize;
        for i in 0..modelled {
            let bit = magnitude >> (rest - 1 - i) & 1 == 1;
            let bit = self.mantissa[class as usize][prefix].code(coder, bit, LIMIT);
            prefix = prefix * 2 + usize::from(bit);
        }
        let raw = rest - modelled;
        let low = coder.bits((magnitude & ((1 << raw) - 1)) as u32, raw);
        let magnitude = (((prefix as u64) << raw) | u64::from(low)) as i64;
        if self.sign.code(coder, v < 0, 1023) { -magnitude } else { magnitude }
    }
}

fn bucket(m: u64) -> usize {
    if m == 0 {
        return 0;
    }
    let log = m.ilog2();
    let half = if log == 0 { 0 } else { (m >> (log - 1)) & 1 };
    ((2 * log) as usize + half as usize + 1).min(BUCKETS - 1)
}

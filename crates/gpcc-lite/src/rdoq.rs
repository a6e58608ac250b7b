//! Rate-distortion optimised quantisation: a dead zone that follows the context.
//!
//! Where small magnitudes are expected, a non-zero coefficient costs many bits. With an expected
//! magnitude `m` and geometric magnitudes, one more unit costs `log2(1 + 1/m)` bits, and leaving
//! zero one more for the sign. A value of `x` steps becomes `q` rather than `q - 1` if that lowers
//! `error + lambda bits`, hence if `x - (q - 1) > 1/2 + lambda bits / 2`.

/// `256 log2(1 + 1/m)` per half-octave of `m` (8 fraction bits), as [`bucket`] numbers them.
const BITS: [i32; 48] = [
    2305, 2049, 2049, 1713, 1590, 1461, 1339, 1212, 1093, 969, 856, 739, 634, 530, 439, 353, 281,
    217, 167, 124, 93, 67, 49, 35, 25, 18, 13, 9, 7, 5, 3, 2, 2, 1, 1, 1, 0, 0, 0, 0, 0, 0, 0, 0,
    0, 0, 0, 0,
];

/// `-256 log2` of probabilities by their top 12 bits, from squarings.
const COST: [u16; 4096] = {
    let mut t = [0u16; 4096];
    let mut i = 0;
    while i < 4096 {
        // In the middle of the class; 13 bits.
        let v = 2 * i as u64 + 1;
        let whole = v.ilog2();
        let mut x = (v << 32) >> whole;
        let mut log = whole;
        let mut bit = 0;
        while bit < 8 {
            x = ((x as u128 * x as u128) >> 32) as u64;
            log *= 2;
            if x >= 2 << 32 {
                log += 1;
                x >>= 1;
            }
            bit += 1;
        }
        t[i] = (13 * 256 - log) as u16;
        i += 1;
    }
    t
};

/// What a decision of 16-bit probability `p` takes, in 1/256 bit.
#[inline]
pub(crate) fn bits(p: u32) -> u32 {
    u32::from(COST[(p >> 4) as usize & 4095])
}

/// Number of half-octave buckets.
pub(crate) const BUCKETS: usize = BITS.len();

/// Half-octave of a magnitude with 8 fraction bits.
#[inline]
pub(crate) fn bucket(m: u32) -> usize {
    if m == 0 {
        return 0;
    }
    let log = m.ilog2();
    let half = if log == 0 { 0 } else { (m >> (log - 1)) & 1 };
    ((2 * log + half) as usize + 1).min(BUCKETS - 1)
}

/// Decision thresholds per bucket.
#[derive(Clone, Debug)]
pub(crate) struct Thresholds {
    zero: [f64; BUCKETS],
    rest: [f64; BUCKETS],
}

impl Thresholds {
    /// `lambda` in 1/256 of `step^2` per bit.
    pub(crate) fn new(lambda: u8) -> Self {
        let half = f64::from(lambda) / (2.0 * 256.0 * 256.0);
        let mut t = Self { zero: [0.5; BUCKETS], rest: [0.5; BUCKETS] };
        for (b, &bits) in BITS.iter().enumerate() {
            t.zero[b] = (0.5 + half * f64::from(bits + 256)).min(1.45);
            t.rest[b] = (0.5 + half * f64::from(bits)).min(0.95);
        }
        t
    }

    /// The quantised magnitude of `x >= 0` steps where `expected` is expected.
    #[inline]
    pub(crate) fn quantise(&self, x: f64, expected: u32) -> u32 {
        let b = bucket(expected);
        if x < self.zero[b] {
            return 0;
        }
        // Saturates: a level is an i32.
        let q = (x as u32).min(i32::MAX as u32 - 1);
        let up = x - f64::from(q) >= self.rest[b];
        (q + u32::from(up)).max(1)
    }
}

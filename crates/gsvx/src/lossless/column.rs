//! How a column of floats becomes integers and back, bit for bit.
//!
//! A grid column cuts the real line into cells of width `2^(step - 150)`: the index of the cell
//! is predicted and entropy-coded, the position inside the cell is noise and stored as it is.
//! Index and position together name every bit pattern of the cell, so -0, denormals and short
//! mantissas need no special case. Patterns outside the grid (values beyond its range, NaN,
//! infinity) are escapes and stored as 32 bits.

use crate::bytes::SliceReader;
use crate::error::{Error, Result};
use gs_model::math::{ascending, of_ascending};

/// Cell indices lie in `[-CELLS, CELLS)`.
pub(super) const CELLS: i32 = 1 << 24;
/// Most entries of a palette.
pub(super) const MAX_PALETTE: usize = 1 << 16;

/// The map between bit patterns and integers of one column.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Map {
    /// Cells of equal width.
    Grid {
        /// Biased exponent of a float whose ulp is the cell width; 24 to 254.
        step: u8,
        /// Low mantissa bits that are zero in every value that is not an escape.
        zeros: u8,
        /// Every value is a multiple of the cell width.
        exact: bool,
    },
    /// Few distinct values: the index into their sorted list.
    Palette(Vec<u32>),
}

/// A value as the coder sees it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Cell {
    /// Index, and the low `bits` bits inside the cell.
    At {
        /// Cell index.
        q: i32,
        /// Bits inside the cell.
        low: u32,
        /// How many.
        bits: u32,
    },
    /// In a cell that touches zero: exponent field and mantissa follow.
    Tiny {
        /// Cell index, 0 or -1.
        q: i32,
        /// Exponent field.
        exponent: u32,
        /// Mantissa field.
        mantissa: u32,
    },
    /// Not representable; `q` stands in for it in predictions.
    Escape {
        /// Nearest cell index.
        q: i32,
    },
}

impl Cell {
    /// The cell index that stands for the value in predictions.
    pub(super) fn q(self) -> i32 {
        match self {
            Self::At { q, .. } | Self::Tiny { q, .. } | Self::Escape { q } => q,
        }
    }
}

/// Index of a magnitude on one side of zero.
fn signed(negative: bool, m: i32) -> i32 {
    if negative { -1 - m } else { m }
}

/// Magnitude cell of an index.
pub(super) fn magnitude(q: i32) -> i32 {
    if q < 0 { -1 - q } else { q }
}

/// Exponent field and the 24-bit significand of a finite value.
pub(super) fn parts(bits: u32) -> (u32, u32) {
    let e = (bits >> 23) & 255;
    if e == 0 { (1, bits & 0x7f_ffff) } else { (e, (bits & 0x7f_ffff) | 0x80_0000) }
}

impl Map {
    /// The cell index that stands for a value in predictions.
    pub(super) fn stand_in(&self, bits: u32) -> i32 {
        self.split(bits).q()
    }

    /// The cell of a bit pattern.
    pub(super) fn split(&self, bits: u32) -> Cell {
        let (step, zeros, exact) = match self {
            Self::Palette(keys) => {
                let key = ascending(bits);
                let at = keys.partition_point(|&k| k < key);
                return if keys.get(at) == Some(&key) {
                    Cell::At { q: at as i32, low: 0, bits: 0 }
                } else {
                    Cell::Escape { q: at as i32 }
                };
            }
            Self::Grid { step, zeros, exact } => (u32::from(*step), u32::from(*zeros), *exact),
        };
        let negative = bits >> 31 == 1;
        let exponent = bits >> 23 & 255;
        if exponent + zeros > step {
            // The stand-in of NaN is 0, that of other patterns the end of the range.
            let nan = exponent == 255 && bits & 0x7f_ffff != 0;
            return Cell::Escape { q: if nan { 0 } else { signed(negative, CELLS - 1) } };
        }
        let (e, m) = parts(bits);
        let shift = step - e;
        let cell = if shift >= 24 { 0 } else { m >> shift };
        let q = signed(negative, cell as i32);
        if exact {
            let fits = if shift >= 24 { m == 0 } else { cell << shift == m };
            return if fits { Cell::At { q, low: 0, bits: 0 } } else { Cell::Escape { q } };
        }
        if cell == 0 {
            return Cell::Tiny { q, exponent, mantissa: bits & 0x7f_ffff };
        }
        let low = m & ((1 << shift) - 1);
        if low & ((1 << zeros) - 1) != 0 {
            return Cell::Escape { q };
        }
        Cell::At { q, low: low >> zeros, bits: shift - zeros }
    }

    /// Bits inside cell `q`; `None` if exponent and mantissa follow.
    #[inline]
    pub(super) fn low_bits(&self, q: i32) -> Option<u32> {
        match self {
            Self::Palette(_) | Self::Grid { exact: true, .. } => Some(0),
            Self::Grid { zeros, .. } => match magnitude(q) as u32 {
                0 => None,
                m => Some((23 - m.ilog2().min(23)).saturating_sub(u32::from(*zeros))),
            },
        }
    }

    /// Greatest exponent field in a cell that touches zero.
    pub(super) fn tiny_exponent(&self) -> u32 {
        match self {
            Self::Grid { step, .. } => u32::from(*step) - 24,
            Self::Palette(_) => 0,
        }
    }

    /// The bit pattern of a cell and the bits inside it; the inverse of [`Map::split`].
    ///
    /// `q` beyond the range, which only a damaged stream holds, is brought back into it.
    pub(super) fn join(&self, q: i32, low: u32) -> u32 {
        let (step, zeros) = match self {
            Self::Palette(keys) => {
                let at = (q.max(0) as usize).min(keys.len().saturating_sub(1));
                return keys.get(at).map_or(0, |&k| of_ascending(k));
            }
            Self::Grid { step, zeros, .. } => (u32::from(*step), u32::from(*zeros)),
        };
        let sign = u32::from(q < 0) << 31;
        let m = magnitude(q).min(CELLS - 1) as u32;
        if m == 0 {
            return sign;
        }
        let shift = 23 - m.ilog2();
        let significand = (m << shift) | (low << zeros);
        let e = step - shift;
        // step >= 24 keeps the exponent field positive.
        sign | (e << 23) | (significand & 0x7f_ffff)
    }

    pub(super) fn read(r: &mut SliceReader<'_>) -> Result<Self> {
        let corrupt = |what, value: u64| Error::Corrupt { what, value };
        match r.u8()? {
            kind @ 0..=1 => {
                let (step, zeros) = (r.u8()?, r.u8()?);
                if !(24..=254).contains(&step) {
                    return Err(corrupt("lossless step", step.into()));
                }
                if zeros > 22 || (kind == 1 && zeros != 0) {
                    return Err(corrupt("lossless zero bits", zeros.into()));
                }
                Ok(Self::Grid { step, zeros, exact: kind == 1 })
            }
            2 => {
                let n = r.varint()?;
                if n > (MAX_PALETTE.min(r.remaining())) as u64 {
                    return Err(corrupt("lossless palette length", n));
                }
                let mut keys = Vec::with_capacity(n as usize);
                let mut last = 0u64;
                for _ in 0..n {
                    last = last.saturating_add(r.varint()?);
                    keys.push(u32::try_from(last).map_err(|_| corrupt("palette entry", last))?);
                }
                Ok(Self::Palette(keys))
            }
            kind => Err(corrupt("lossless column kind", kind.into())),
        }
    }
}

#[cfg(all(test, feature = "encode"))]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn check(map: &Map, v: u32) {
        match map.split(v) {
            Cell::At { q, low, bits } => {
                assert_eq!(map.low_bits(q), Some(bits));
                assert!(u64::from(low) < 1 << bits);
                assert_eq!(map.join(q, low), v);
                assert!((-CELLS..CELLS).contains(&q));
            }
            Cell::Tiny { q, exponent, mantissa } => {
                assert_eq!(map.low_bits(q), None);
                assert!(exponent <= map.tiny_exponent());
                assert_eq!(map.join(q, 0) | exponent << 23 | mantissa, v);
            }
            Cell::Escape { q } => assert!((-CELLS..CELLS).contains(&q)),
        }
    }

    proptest! {
        #[test]
        fn every_pattern_comes_back(v in any::<u32>(), step in 24u8..=254, zeros in 0u8..=22, exact: bool) {
            check(&Map::Grid { step, zeros: if exact { 0 } else { zeros }, exact }, v);
        }

        #[test]
        fn chosen_maps_hold_their_column(values in prop::collection::vec(-1e3f32..1e3, 1..200)) {
            let bits: Vec<u32> = values.iter().map(|v| v.to_bits()).collect();
            let map = Map::choose(&bits);
            prop_assert!(!map.has_escapes(&bits));
            for &v in &bits {
                check(&map, v);
            }
        }
    }

    #[test]
    fn lattices_halves_and_palettes_are_seen() {
        let lattice: Vec<u32> = (-4000..4000).map(|i| (i as f32 / 4096.0).to_bits()).collect();
        assert!(matches!(Map::choose(&lattice), Map::Grid { exact: true, .. }));
        let short: Vec<u32> =
            (0..8000u32).map(|i| 0x3f00_0000 + ((i * 7919 % 8191) << 13)).collect();
        assert!(matches!(Map::choose(&short), Map::Grid { .. } | Map::Palette(_)));
        let few: Vec<u32> = (0..8000).map(|i| (1.0 / (1 + i % 256) as f32).to_bits()).collect();
        assert!(matches!(Map::choose(&few), Map::Palette(keys) if keys.len() == 256));
    }

    #[test]
    fn order_of_patterns_is_the_order_of_values() {
        let values = [-f32::INFINITY, -1.0, -1e-40, -0.0, 0.0, 1e-40, 1.0, f32::INFINITY];
        for w in values.windows(2) {
            assert!(ascending(w[0].to_bits()) < ascending(w[1].to_bits()));
        }
        for v in values {
            assert_eq!(of_ascending(ascending(v.to_bits())), v.to_bits());
        }
    }
}

//! What follows a cell index: the position inside the cell.

use super::column::{Cell, Map};
use gpcc_lite::coder::Coder;
use gpcc_lite::model::Bit;

/// Memory of flags, in observations.
pub(super) const MEMORY: u32 = 255;

/// State of what follows a cell index.
#[derive(Clone, Debug, Default)]
pub(super) struct Tail {
    pub(super) escape: Bit,
    tiny: [Bit; 25],
}

impl Tail {
    /// Codes the position inside cell `q`; returns the bit pattern.
    #[inline]
    pub(super) fn code<C: Coder>(&mut self, coder: &mut C, map: &Map, q: i32, cell: Cell) -> u32 {
        match map.low_bits(q) {
            Some(0) => map.join(q, 0),
            Some(n) => {
                let low = match cell {
                    Cell::At { low, .. } => low,
                    _ => 0,
                };
                map.join(q, coder.bits(low, n))
            }
            None => {
                let (exponent, mantissa) = match cell {
                    Cell::Tiny { exponent, mantissa, .. } => (exponent, mantissa),
                    _ => (0, 0),
                };
                let top = map.tiny_exponent();
                let down = top.saturating_sub(exponent);
                let mut k = 0;
                while k < 24 && k < top && self.tiny[k as usize].code(coder, down > k, MEMORY) {
                    k += 1;
                }
                let exponent = if k == 24 { coder.bits(exponent, 8).min(top) } else { top - k };
                map.join(q, 0) | exponent << 23 | coder.bits(mantissa, 23)
            }
        }
    }
}

//! The linear predictor of a column: integers in the stream, integers in the decoder.

use super::column::CELLS;
use super::neighbours::NEIGHBOURS;
use crate::bytes::SliceReader;
#[cfg(feature = "encode")]
use crate::bytes::Writer;
use crate::error::{Error, Result};

/// Fraction bits of neighbour weights.
pub(super) const NEIGHBOUR_BITS: u32 = 16;
/// Greatest fraction bits of own weights.
pub(super) const MAX_SHIFT: u8 = 36;

/// Predicts a cell index from earlier columns of the same Gaussian, then the rest from what the
/// same step left over at its neighbours.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct ColumnPredictor {
    /// Fraction bits of `own` and `bias`.
    pub(super) shift: u8,
    /// Added to the weighted sum.
    pub(super) bias: i64,
    /// Earlier columns and their weights.
    pub(super) own: Vec<(u8, i32)>,
    /// Weights of the neighbours' remainders.
    pub(super) near: [i32; NEIGHBOURS],
}

impl ColumnPredictor {
    /// The part that depends on the cell indices of the Gaussian's own earlier columns.
    #[inline]
    pub(super) fn own(&self, q: &[i32]) -> i32 {
        let mut sum = self.bias;
        for &(c, w) in &self.own {
            sum = sum.wrapping_add(i64::from(w) * i64::from(q[usize::from(c)]));
        }
        let limit = i64::from(CELLS);
        (sum >> self.shift).clamp(-limit, limit - 1) as i32
    }

    #[cfg(feature = "encode")]
    pub(super) fn write(&self, w: &mut Writer) {
        w.u8(self.shift);
        w.varint(zigzag(self.bias));
        w.u8(self.own.len() as u8);
        for &(c, weight) in &self.own {
            w.u8(c);
            w.varint(zigzag(weight.into()));
        }
        for weight in self.near {
            w.varint(zigzag(weight.into()));
        }
    }

    /// Reads the predictor of column `column`.
    pub(super) fn read(r: &mut SliceReader<'_>, column: usize) -> Result<Self> {
        let corrupt = |what, value: u64| Error::Corrupt { what, value };
        let shift = r.u8()?;
        if shift > MAX_SHIFT {
            return Err(corrupt("predictor shift", shift.into()));
        }
        let bias = unzigzag(r.varint()?);
        let weight = |r: &mut SliceReader<'_>| {
            let v = unzigzag(r.varint()?);
            i32::try_from(v).map_err(|_| corrupt("predictor weight", v as u64))
        };
        let mut own = Vec::new();
        for _ in 0..r.u8()? {
            let c = r.u8()?;
            if usize::from(c) >= column {
                return Err(corrupt("predictor column", c.into()));
            }
            own.push((c, weight(r)?));
        }
        let mut near = [0; NEIGHBOURS];
        for v in &mut near {
            *v = weight(r)?;
        }
        Ok(Self { shift, bias, own, near })
    }
}

#[cfg(feature = "encode")]
fn zigzag(v: i64) -> u64 {
    ((v << 1) ^ (v >> 63)) as u64
}

fn unzigzag(v: u64) -> i64 {
    (v >> 1) as i64 ^ -((v & 1) as i64)
}

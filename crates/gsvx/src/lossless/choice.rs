//! The encoder's choice of the map of a column.

use super::column::{Cell, MAX_PALETTE, Map, parts};
use crate::bytes::Writer;
use gs_model::math::ascending;

/// One value in this many may be an escape.
const ESCAPES: usize = 2048;

impl Map {
    /// Chooses the map of a column.
    pub(super) fn choose(values: &[u32]) -> Self {
        let grid = Self::grid(values);
        if let Self::Grid { exact: true, .. } = grid {
            return grid;
        }
        Self::palette(values).unwrap_or(grid)
    }

    /// The grid of one column, or of several that are to share it.
    pub(super) fn grid(values: &[u32]) -> Self {
        let allowed = values.len() / ESCAPES;
        let mut exponents = [0usize; 256];
        for &v in values {
            exponents[(v >> 23 & 255) as usize] += 1;
        }
        exponents[255] = 0;
        let top = last_within(&exponents, allowed).max(24);
        // Zero bits at the end of the mantissa, and the lattice all values lie on.
        let (mut zeros, mut lattice) = ([0usize; 256], [0usize; 256]);
        for &v in values {
            let (e, m) = parts(v);
            if e > top as u32 || m == 0 {
                continue;
            }
            zeros[255 - m.trailing_zeros() as usize] += 1;
            lattice[255 - (e + m.trailing_zeros()).min(255) as usize] += 1;
        }
        let any = zeros.iter().any(|&n| n > 0);
        let tz = if any { (255 - last_within(&zeros, allowed)).min(22) } else { 0 };
        let lattice = if any { 255 - last_within(&lattice, allowed) } else { top };
        if lattice >= top && lattice <= 254 {
            return Self::Grid { step: lattice as u8, zeros: 0, exact: true };
        }
        let tz = tz.min(254 - top);
        Self::Grid { step: (top + tz) as u8, zeros: tz as u8, exact: false }
    }

    fn palette(values: &[u32]) -> Option<Self> {
        let most = MAX_PALETTE.min(values.len() / 8);
        let stride = (values.len() / 4096).max(1);
        let mut probe: Vec<u32> = values.iter().step_by(stride).copied().collect();
        let probed = probe.len();
        probe.sort_unstable();
        probe.dedup();
        if probe.len() * 20 > probed * 19 {
            return None;
        }
        let mut keys: Vec<u32> = values.iter().map(|&v| ascending(v)).collect();
        keys.sort_unstable();
        keys.dedup();
        (keys.len() <= most).then_some(Self::Palette(keys))
    }

    /// True if some of `values` are escapes.
    pub(super) fn has_escapes(&self, values: &[u32]) -> bool {
        values.iter().any(|&v| matches!(self.split(v), Cell::Escape { .. }))
    }

    /// Writes what [`Map::read`] reads.
    pub(super) fn write(&self, w: &mut Writer) {
        match self {
            Self::Grid { step, zeros, exact } => {
                w.u8(u8::from(*exact));
                w.u8(*step);
                w.u8(*zeros);
            }
            Self::Palette(keys) => {
                w.u8(2);
                w.varint(keys.len() as u64);
                let mut last = 0;
                for &k in keys {
                    w.varint(u64::from(k - last));
                    last = k;
                }
            }
        }
    }
}

/// The last index such that at most `allowed` counts lie beyond it.
fn last_within(histogram: &[usize; 256], allowed: usize) -> usize {
    let mut beyond = 0;
    for i in (0..256).rev() {
        beyond += histogram[i];
        if beyond > allowed {
            return i;
        }
    }
    0
}

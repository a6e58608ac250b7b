//! Palettes: channels that use few of the values in their range.
//!
//! A channel that was quantised to 8 bits and stored in 16 has gaps between its values. A predictor
//! of values does not know them. Indices into the sorted list of values have no gaps.

use crate::bytes::{ByteReader, put_varint};
use crate::error::Result;

/// Most values in a palette.
const MAX: usize = 4096;

/// The sorted distinct values, if there are at most 4096 and they leave gaps.
pub(super) fn find(values: &[i32]) -> Option<Vec<i32>> {
    let mut all = values.to_vec();
    all.sort_unstable();
    all.dedup();
    let span = i64::from(*all.last()?) - i64::from(*all.first()?) + 1;
    (all.len() <= MAX && span > all.len() as i64).then_some(all)
}

/// Indices of `values` in `palette`, which holds them all.
pub(super) fn indices(values: &[i32], palette: &[i32]) -> Vec<i32> {
    values.iter().map(|v| palette.partition_point(|p| p < v) as i32).collect()
}

/// The value of an index; the last one for an index past the end.
pub(super) fn value(palette: &[i32], index: i32) -> i32 {
    let i = usize::try_from(index).unwrap_or(0).min(palette.len().saturating_sub(1));
    palette.get(i).copied().unwrap_or(0)
}

pub(super) fn write(out: &mut Vec<u8>, palette: &[i32]) {
    put_varint(out, palette.len() as u64);
    if let Some(first) = palette.first() {
        out.extend(first.to_le_bytes());
    }
    for pair in palette.windows(2) {
        put_varint(out, u64::from(pair[1].abs_diff(pair[0])));
    }
}

pub(super) fn read(r: &mut ByteReader<'_>) -> Result<Vec<i32>> {
    let count = r.varint("palette size")?;
    if count == 0 || count > MAX as u64 {
        return Err(r.corrupt("palette size"));
    }
    let b = r.bytes(4, "palette")?;
    let mut last = i32::from_le_bytes([b[0], b[1], b[2], b[3]]);
    let mut palette = vec![last];
    for _ in 1..count {
        let gap = r.varint("palette")?;
        let next = i64::from(last).saturating_add(gap.min(1 << 33) as i64);
        last = i32::try_from(next).map_err(|_| r.corrupt("palette"))?;
        palette.push(last);
    }
    Ok(palette)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_palette_has_at_most_4096_values_and_gaps() {
        let every = |step: i32, count: i32| find(&(0..count).map(|i| i * step).collect::<Vec<_>>());
        assert_eq!(every(3, 4096).unwrap().len(), 4096);
        assert_eq!(every(3, 4097), None);
        assert_eq!(every(1, 100), None);
        assert_eq!(find(&[]), None);
    }
}

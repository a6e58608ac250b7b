//! The numbers of one attribute.

use super::buffers::{Buffers, SHORT};
use super::json::{self, Root};
use crate::bytes::{float, half_word};

/// An attribute whose rows are all in the data.
pub(super) struct Numbers<'a> {
    /// From the first row on.
    bytes: &'a [u8],
    stride: usize,
    pub(super) count: usize,
    component: u32,
    normalized: bool,
}

impl<'a> Numbers<'a> {
    /// The accessor, if it has numbers of the given type (`SCALAR`, `VEC3`, `VEC4`); an error is what is wrong with
    /// it.
    pub(super) fn of(
        root: &Root,
        buffers: &'a Buffers<'_>,
        accessor: usize,
        kind: &str,
    ) -> Result<Self, String> {
        let accessor =
            root.accessors.get(accessor).ok_or("it names an accessor that is not there")?;
        if accessor.kind != kind {
            return Err("it has an accessor of the wrong type".into());
        }
        if accessor.sparse.is_some() {
            return Err("it has a sparse accessor, which is not read".into());
        }
        let view = accessor.buffer_view.and_then(|at| root.buffer_views.get(at));
        let view = view.ok_or("it has an accessor without data")?;
        let bytes = buffers.view(view)?;
        let component = accessor.component_type;
        let size = match component {
            json::I8 | json::U8 => 1,
            json::I16 | json::U16 => 2,
            json::F32 => 4,
            _ => return Err("it has components of a type that is not read".into()),
        };
        let row =
            size * [("SCALAR", 1), ("VEC3", 3)].iter().find(|t| t.0 == kind).map_or(4, |t| t.1);
        let stride = view.byte_stride.unwrap_or(row).max(row);
        let bytes = bytes.get(accessor.byte_offset..).ok_or(SHORT)?;
        // The last row needs no gap after it.
        let before_last = accessor.count.saturating_sub(1).checked_mul(stride).ok_or(SHORT)?;
        if accessor.count > 0 && before_last.checked_add(row).is_none_or(|len| len > bytes.len()) {
            return Err(SHORT.into());
        }
        let (count, normalized) = (accessor.count, accessor.normalized);
        Ok(Self { bytes, stride, count, component, normalized })
    }

    /// Number `k` of a row.
    pub(super) fn number(&self, row: usize, k: usize) -> f32 {
        let row = &self.bytes[row * self.stride..];
        let (value, most) = match self.component {
            json::I8 => (f32::from(row[k] as i8), 127.0),
            json::U8 => (f32::from(row[k]), 255.0),
            json::I16 => (f32::from(half_word(row, 2 * k) as i16), 32767.0),
            json::U16 => (f32::from(half_word(row, 2 * k)), 65535.0),
            _ => return float(row, 4 * k),
        };
        if self.normalized { (value / most).max(-1.0) } else { value }
    }

    /// Half of the distance between neighbouring numbers near 1.
    pub(super) fn half_step(&self) -> f64 {
        match self.component {
            json::F32 => 1.0 / f64::from(1u32 << 25),
            json::I8 | json::U8 => 0.5 / 255.0,
            _ => 0.5 / 65535.0,
        }
    }
}

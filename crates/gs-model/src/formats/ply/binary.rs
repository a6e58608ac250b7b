//! The rows of a binary PLY file.

use std::path::Path;

use super::columns::Columns;
use super::header::{PlyElement, Scalar};
use crate::bytes;
use crate::error::{Error, Result};
use crate::rows;
use crate::scene::{Scene, SceneMut};

/// The body of a binary file.
pub(super) struct BinaryBody<'a> {
    pub(super) file: &'a Path,
    /// The whole file, so that offsets in messages are file offsets.
    pub(super) bytes: &'a [u8],
    pub(super) big_endian: bool,
}

impl BinaryBody<'_> {
    /// The offset after all rows of `element`, which start at `at`.
    ///
    /// Rows with lists are walked; the walk ends with the file, since a list has a length of at
    /// least one byte.
    pub(super) fn skip(&self, element: &PlyElement, at: usize) -> Result<usize> {
        self.check_fits(element, at)?;
        if !element.has_list() {
            // Fits, as just checked: `least_row_bytes` is exact without lists.
            return Ok(at + element.count as usize * element.least_row_bytes());
        }
        let mut end = at;
        for row in 0..element.count {
            end = self.walk(element, row, end)?;
        }
        Ok(end)
    }

    /// Reads the Gaussians of `vertex`, whose rows start at `at`. Returns the offset after them.
    pub(super) fn vertices(
        &self,
        vertex: &PlyElement,
        columns: &mut Columns,
        at: usize,
    ) -> Result<(Scene, usize)> {
        self.check_fits(vertex, at)?;
        let n = vertex.count as usize;
        let layout = RowLayout::of(vertex, columns, self.big_endian);
        let stride = layout.stride;
        let body = &self.bytes[at..at + n * stride];
        layout.choose_origin(vertex, columns, body);
        let columns = &*columns;
        let scene = rows::scene(self.file, n, columns.sh_degree, |first, rows| {
            let part = &body[first * stride..(first + rows.len()) * stride];
            layout.fill(rows, part, columns);
            Ok(())
        })?;
        Ok((scene, at + n * stride))
    }

    /// The offset after a row that starts at `at`.
    fn walk(&self, element: &PlyElement, row: u64, at: usize) -> Result<usize> {
        let len = self.bytes.len();
        let mut end = at;
        for property in &element.properties {
            let size = property.list.unwrap_or(property.scalar).size();
            if len - end < size {
                return Err(self.truncated(element, row));
            }
            if let Some(length_type) = property.list {
                let length = number(self.bytes, end, length_type, self.big_endian);
                if length < 0.0 {
                    let place = format!("byte {end}, element {:?}", element.name);
                    return Err(Error::malformed(self.file, &place, "a list of negative length"));
                }
                // At most 2^32 - 1, which can still overflow where usize has 32 bits.
                let items = (length as usize).saturating_mul(property.scalar.size());
                if items > len - end - size {
                    return Err(self.truncated(element, row));
                }
                end += items;
            }
            end += size;
        }
        Ok(end)
    }

    fn check_fits(&self, element: &PlyElement, at: usize) -> Result<()> {
        let len = self.bytes.len();
        element.check_fits(self.file, len, len - at, element.least_row_bytes())
    }

    fn truncated(&self, element: &PlyElement, row: u64) -> Error {
        element.truncated(self.file, self.bytes.len(), row)
    }
}

/// The layout of rows without lists.
#[derive(Debug)]
pub(super) struct RowLayout {
    /// Bytes per row.
    pub(super) stride: usize,
    /// Offset and type of each property, in file order.
    properties: Vec<(usize, Scalar)>,
    /// Offset of each number in scene order.
    numbers: Vec<usize>,
    /// True if the numbers are those of the file: `f32`, and none of them a stand-in.
    plain: bool,
    big_endian: bool,
}

impl RowLayout {
    pub(super) fn of(vertex: &PlyElement, columns: &Columns, big_endian: bool) -> Self {
        let properties = offsets_and_types(vertex);
        let numbers = || columns.properties.iter().map(|&p| properties[p]);
        Self {
            stride: vertex.least_row_bytes(),
            plain: numbers().all(|s| s.1 == Scalar::F32) && !columns.variants.any(),
            numbers: numbers().map(|s| s.0).collect(),
            properties,
            big_endian,
        }
    }

    /// Chooses the origin by the first of these rows.
    pub(super) fn choose_origin(&self, vertex: &PlyElement, columns: &mut Columns, rows: &[u8]) {
        // The stride is not 0, because a Gaussian has numbers.
        columns.choose_origin(vertex, rows.len() / self.stride, |row, p| {
            let (offset, scalar) = self.properties[p];
            number(&rows[row * self.stride..], offset, scalar, self.big_endian)
        });
    }

    /// Fills `rows` from the bytes that hold them, and notes in `columns` what a scene does not keep.
    pub(super) fn fill(&self, rows: SceneMut<'_>, part: &[u8], columns: &Columns) {
        let (stride, at) = (self.stride, &self.numbers);
        let of_property = |row: &[u8], p: usize| {
            let (offset, scalar) = self.properties[p];
            number(row, offset, scalar, self.big_endian)
        };
        columns.look(rows.len(), |row, p| of_property(&part[row * stride..], p));
        match (self.plain, self.big_endian) {
            (true, false) => {
                fill(rows, part, stride, |row, c| bytes::float(row, at[c]));
            }
            (true, true) => {
                fill(rows, part, stride, |row, c| f32::from_be_bytes(bytes::array(row, at[c])));
            }
            (false, _) => {
                fill(rows, part, stride, |row, c| columns.number(c, |p| of_property(row, p)));
            }
        }
    }
}

/// Offset in a row without lists, and type, of each property.
pub(super) fn offsets_and_types(element: &PlyElement) -> Vec<(usize, Scalar)> {
    let ends = element.properties.iter().scan(0, |end, p| {
        let start = *end;
        *end += p.scalar.size();
        Some((start, p.scalar))
    });
    ends.collect()
}

#[inline]
fn fill(mut rows: SceneMut<'_>, part: &[u8], stride: usize, get: impl Fn(&[u8], usize) -> f32) {
    for (i, row) in part.chunks_exact(stride).enumerate() {
        rows.set(i, |c| get(row, c));
    }
}

/// The number of type `scalar` at offset `at`. It is exact: `f64` holds every value of every PLY
/// type.
#[inline]
pub(super) fn number(bytes: &[u8], at: usize, scalar: Scalar, big_endian: bool) -> f64 {
    macro_rules! read {
        ($t:ty) => {
            if big_endian {
                f64::from(<$t>::from_be_bytes(bytes::array(bytes, at)))
            } else {
                f64::from(<$t>::from_le_bytes(bytes::array(bytes, at)))
            }
        };
    }
    match scalar {
        Scalar::I8 => read!(i8),
        Scalar::U8 => read!(u8),
        Scalar::I16 => read!(i16),
        Scalar::U16 => read!(u16),
        Scalar::I32 => read!(i32),
        Scalar::U32 => read!(u32),
        Scalar::F32 => read!(f32),
        Scalar::F64 => read!(f64),
    }
}

//! The rows of one element, whose columns are all of one type.

use std::collections::BTreeMap;
use std::path::Path;

use super::malformed;
use crate::bytes;
use crate::error::Result;
use crate::formats::ply::binary::{BinaryBody, offsets_and_types};
use crate::formats::ply::header::{PlyElement, PlyHeader, Scalar};

/// The rows of an element without lists.
pub(super) struct ElementTable<'a> {
    element: &'a PlyElement,
    pub(super) rows: usize,
    bytes: &'a [u8],
    stride: usize,
}

/// Some columns of a table: their offsets in a row.
pub(super) struct TableColumns<'a> {
    bytes: &'a [u8],
    stride: usize,
    pub(super) offsets: Vec<usize>,
}

impl<'a> ElementTable<'a> {
    /// The element of that name, if the file has it. All its rows are in the file.
    pub(super) fn find(
        file: &Path,
        bytes: &'a [u8],
        header: &'a PlyHeader,
        name: &str,
    ) -> Result<Option<Self>> {
        let body = BinaryBody { file, bytes, big_endian: false };
        let mut at = header.len;
        for element in &header.elements {
            let end = body.skip(element, at)?;
            if element.name == name {
                if element.has_list() {
                    return Err(malformed(file, &format!("element {name:?}"), "it has a list"));
                }
                // Both fit: `skip` has found the rows in the file. A row without a byte has no end.
                let stride = element.least_row_bytes();
                let rows = if stride == 0 { 0 } else { element.count as usize };
                return Ok(Some(Self { element, rows, bytes: &bytes[at..end], stride }));
            }
            at = end;
        }
        Ok(None)
    }

    pub(super) fn properties(&self) -> usize {
        self.element.properties.len()
    }

    pub(super) fn has(&self, name: &str) -> bool {
        self.element.properties.iter().any(|p| p.name == name)
    }

    /// The columns of these names, all of type `scalar`.
    pub(super) fn columns(
        &self,
        file: &Path,
        names: &[impl AsRef<str>],
        scalar: Scalar,
    ) -> Result<TableColumns<'a>> {
        let names_found = self.element.properties.iter().map(|p| p.name.as_str());
        let places: BTreeMap<_, _> = names_found.zip(offsets_and_types(self.element)).collect();
        let offset = |name: &str| match places.get(name) {
            Some(&(at, found)) if found == scalar => Ok(at),
            _ => {
                let place = format!("element {:?}", self.element.name);
                let reason =
                    format!("property {name} is missing or has another type than {scalar:?}");
                Err(malformed(file, &place, reason))
            }
        };
        let offsets = names.iter().map(|name| offset(name.as_ref())).collect::<Result<_>>()?;
        Ok(TableColumns { bytes: self.bytes, stride: self.stride, offsets })
    }
}

impl TableColumns<'_> {
    pub(super) fn word(&self, row: usize, column: usize) -> u32 {
        bytes::word(self.bytes, row * self.stride + self.offsets[column])
    }

    pub(super) fn float(&self, row: usize, column: usize) -> f32 {
        f32::from_bits(self.word(row, column))
    }

    pub(super) fn byte(&self, row: usize, column: usize) -> u8 {
        self.bytes[row * self.stride + self.offsets[column]]
    }
}

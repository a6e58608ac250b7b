//! The rows of one element, whose columns are all of one type.

use std::path::Path;

use super::malformed;
use crate::bytes;
use crate::error::Result;
use crate::ply::binary::Body;
use crate::ply::header::{Element, Header, Scalar};

/// The rows of an element without lists.
pub(super) struct Table<'a> {
    element: &'a Element,
    pub(super) rows: usize,
    bytes: &'a [u8],
    stride: usize,
}

/// Some columns of a table: their offsets in a row.
pub(super) struct Columns<'a> {
    bytes: &'a [u8],
    stride: usize,
    pub(super) offsets: Vec<usize>,
}

impl<'a> Table<'a> {
    /// The element of that name, if the file has it. All its rows are in the file.
    pub(super) fn find(
        file: &Path,
        bytes: &'a [u8],
        header: &'a Header,
        name: &str,
    ) -> Result<Option<Self>> {
        let body = Body { file, bytes, big_endian: false };
        let mut at = header.len;
        for element in &header.elements {
            let end = body.skip(element, at)?;
            if element.name == name {
                if element.has_list() {
                    return Err(malformed(file, &format!("element {name:?}"), "it has a list"));
                }
                // Both fit: `skip` has found the rows in the file. A row without a byte has no end.
                let stride = element.properties.iter().map(|p| p.scalar.size()).sum::<usize>();
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

    pub(super) fn words(&self, file: &Path, names: &[&str]) -> Result<Columns<'a>> {
        self.columns(file, names.iter().copied(), Scalar::U32)
    }

    pub(super) fn floats(&self, file: &Path, names: &[&str]) -> Result<Columns<'a>> {
        self.columns(file, names.iter().copied(), Scalar::F32)
    }

    /// The columns `f_rest_0`, `f_rest_1` and so on.
    pub(super) fn sh_bytes(&self, file: &Path) -> Result<Columns<'a>> {
        let names: Vec<String> = (0..self.properties()).map(|i| format!("f_rest_{i}")).collect();
        self.columns(file, names.iter().map(String::as_str), Scalar::U8)
    }

    fn columns<'n>(
        &self,
        file: &Path,
        names: impl Iterator<Item = &'n str>,
        scalar: Scalar,
    ) -> Result<Columns<'a>> {
        let mut places = std::collections::BTreeMap::new();
        let mut at = 0;
        for property in &self.element.properties {
            places.insert(property.name.as_str(), (at, property.scalar));
            at += property.scalar.size();
        }
        let offset = |name: &str| match places.get(name) {
            Some(&(at, found)) if found == scalar => Ok(at),
            _ => {
                let place = format!("element {:?}", self.element.name);
                let reason =
                    format!("property {name} is missing or has another type than {scalar:?}");
                Err(malformed(file, &place, reason))
            }
        };
        let offsets = names.map(offset).collect::<Result<_>>()?;
        Ok(Columns { bytes: self.bytes, stride: self.stride, offsets })
    }
}

impl Columns<'_> {
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

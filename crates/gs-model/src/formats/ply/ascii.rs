//! The rows of an ASCII PLY file: one row per line, blank lines ignored.

use std::path::Path;

use super::columns::Columns;
use super::header::{PlyElement, PlyHeader, Scalar};
use super::origin;
use crate::error::{Error, Result, excerpt};
use crate::rows;
use crate::scene::Scene;

/// The lines of an ASCII file that are still to be read.
pub(super) struct Lines<'a> {
    file: &'a Path,
    bytes: &'a [u8],
    at: usize,
    line: usize,
    line_end: u8,
}

impl<'a> Lines<'a> {
    pub(super) fn new(file: &'a Path, bytes: &'a [u8], header: &PlyHeader) -> Self {
        Self { file, bytes, at: header.len, line: header.lines, line_end: header.line_end }
    }

    /// Skips the rows of an element.
    pub(super) fn skip(&mut self, element: &PlyElement) -> Result<()> {
        self.check_fits(element)?;
        // A row without properties is an empty line, and those are ignored.
        let rows = if element.properties.is_empty() { 0 } else { element.count };
        let mut numbers = Vec::new();
        for row in 0..rows {
            let (line, text) = self.next_row().ok_or_else(|| self.truncated(element, row))?;
            // Parsed, so that a file cut inside its last row is noticed.
            parse_row(self.file, line, text, element, &mut numbers)?;
        }
        Ok(())
    }

    /// Reads the Gaussians of `vertex`.
    pub(super) fn vertices(&mut self, vertex: &PlyElement, columns: &mut Columns) -> Result<Scene> {
        self.check_fits(vertex)?;
        let n = vertex.count as usize;
        let mut lines = Vec::with_capacity(n);
        for row in 0..vertex.count {
            lines.push(self.next_row().ok_or_else(|| self.truncated(vertex, row))?);
        }
        let file = self.file;
        let mut sample = vec![Vec::new(); n.min(origin::SAMPLE)];
        for (numbers, &(line, text)) in sample.iter_mut().zip(&lines) {
            parse_row(file, line, text, vertex, numbers)?;
        }
        columns.choose_origin(vertex, sample.len(), |row, p| sample[row][p]);
        let columns = &*columns;
        rows::scene(file, n, columns.sh_degree, |first, mut rows| {
            let mut numbers = Vec::with_capacity(vertex.properties.len());
            for i in 0..rows.len() {
                let (line, text) = lines[first + i];
                parse_row(file, line, text, vertex, &mut numbers)?;
                rows.set(i, |c| columns.number(c, |p| numbers[p]));
                columns.look(1, |_, p| numbers[p]);
            }
            Ok(())
        })
    }

    /// Bytes after the last row read, surrounding white space left out.
    pub(super) fn trailing(&self) -> usize {
        self.bytes[self.at..].trim_ascii().len()
    }

    /// The next line that is not blank, and its number.
    fn next_row(&mut self) -> Option<(usize, &'a [u8])> {
        while self.at < self.bytes.len() {
            let rest = &self.bytes[self.at..];
            let length = rest.iter().position(|&b| b == self.line_end).unwrap_or(rest.len());
            self.at += (length + 1).min(rest.len());
            self.line += 1;
            let text = rest[..length].trim_ascii();
            if !text.is_empty() {
                return Some((self.line, text));
            }
        }
        None
    }

    /// Refuses an element whose rows, at one digit per number, do not fit in the rest of the file.
    fn check_fits(&self, element: &PlyElement) -> Result<()> {
        let len = self.bytes.len();
        // A digit and a separator per number. One more byte: the last line need not end.
        element.check_fits(self.file, len, len - self.at + 1, 2 * element.properties.len())
    }

    fn truncated(&self, element: &PlyElement, row: u64) -> Error {
        element.truncated(self.file, self.bytes.len(), row)
    }
}

/// Parses one row into one number per property; a list becomes 0.
fn parse_row(
    file: &Path,
    line: usize,
    text: &[u8],
    element: &PlyElement,
    out: &mut Vec<f64>,
) -> Result<()> {
    out.clear();
    let words = || text.split(u8::is_ascii_whitespace).filter(|w| !w.is_empty());
    let malformed = |reason: String| Error::malformed(file, &format!("line {line}"), reason);
    let short = || {
        let (found, expected) = (words().count(), element.properties.len());
        malformed(format!("{found} numbers, expected {expected}"))
    };
    let mut rest = words();
    for property in &element.properties {
        let word = rest.next().ok_or_else(short)?;
        let bad = || {
            let name = &property.name;
            malformed(format!("property {name:?}: {:?} is not a number", excerpt(word)))
        };
        if property.list.is_some() {
            let length: usize =
                std::str::from_utf8(word).ok().and_then(|w| w.parse().ok()).ok_or_else(bad)?;
            if length > 0 {
                rest.nth(length - 1).ok_or_else(short)?;
            }
            out.push(0.0);
        } else {
            out.push(number(word, property.scalar).ok_or_else(bad)?);
        }
    }
    if rest.next().is_some() { Err(short()) } else { Ok(()) }
}

/// A number, of a float as the type rounds it. Fractions in integer columns are accepted: some
/// writers put them there, and their meaning is clear.
fn number(word: &[u8], scalar: Scalar) -> Option<f64> {
    let word = std::str::from_utf8(word).ok()?;
    match scalar {
        Scalar::F32 => word.parse::<f32>().ok().map(f64::from),
        _ => word.parse().ok(),
    }
}

//! The container: header, table of contents, checksummed sections.
//!
//! Normative description: `docs/bitstream.md`.

mod bytes;
mod header;
mod section;

pub use bytes::{Reader, Writer};
pub use header::{ColourSpace, CoordinateSystem, Header, MAJOR, MINOR, SIGNATURE};
pub use section::{SectionKind, TocEntry};

use crate::error::{Error, Result};

/// A parsed stream: header, table of contents and the bytes of each section present.
#[derive(Clone, Debug)]
pub struct Container<'a> {
    /// The header.
    pub header: Header,
    /// The table of contents, in stream order.
    pub toc: Vec<TocEntry>,
    bytes: &'a [u8],
    body: usize,
}

impl<'a> Container<'a> {
    /// Parses signature, header and table of contents; checks the header's checksum.
    ///
    /// Section payloads are checked when they are asked for, so a prefix of a stream that
    /// ends inside a section still yields the sections before it.
    ///
    /// # Errors
    /// [`Error::NotGsvx`], [`Error::Version`], [`Error::Truncated`], [`Error::HeaderChecksum`]
    /// or [`Error::Corrupt`].
    pub fn parse(bytes: &'a [u8]) -> Result<Self> {
        let (header, toc, body) = header::read(bytes)?;
        Ok(Self { header, toc, bytes, body })
    }

    /// Offset of the first section's payload.
    #[must_use]
    pub fn body_offset(&self) -> usize {
        self.body
    }

    /// Length the whole stream should have.
    #[must_use]
    pub fn expected_len(&self) -> u64 {
        self.toc.iter().fold(self.body as u64, |sum, e| sum.saturating_add(e.len))
    }

    /// The payload of a section; `None` if the stream does not list it.
    ///
    /// # Errors
    /// [`Error::Truncated`] if the stream ends inside it, [`Error::Checksum`] if it is damaged.
    pub fn section(&self, kind: SectionKind) -> Result<Option<&'a [u8]>> {
        let mut offset = self.body as u64;
        for entry in &self.toc {
            if entry.kind == kind {
                let end = offset.saturating_add(entry.len);
                if end > self.bytes.len() as u64 {
                    return Err(Error::Truncated {
                        what: kind.name(),
                        offset: offset as usize,
                        need: entry.len as usize,
                        have: self.bytes.len().saturating_sub(offset as usize),
                    });
                }
                let payload = &self.bytes[offset as usize..end as usize];
                let found = crc32c::crc32c(payload);
                if found != entry.crc {
                    return Err(Error::Checksum {
                        kind,
                        offset: offset as usize,
                        expected: entry.crc,
                        found,
                    });
                }
                return Ok(Some(payload));
            }
            offset = offset.saturating_add(entry.len);
        }
        Ok(None)
    }
}

/// Assembles a stream from its header and sections.
#[must_use]
pub fn assemble(header: &Header, sections: &[(SectionKind, Vec<u8>)]) -> Vec<u8> {
    let toc: Vec<TocEntry> = sections
        .iter()
        .map(|(kind, payload)| TocEntry {
            kind: *kind,
            len: payload.len() as u64,
            crc: crc32c::crc32c(payload),
        })
        .collect();
    let mut out = header::write(header, &toc);
    for (_, payload) in sections {
        out.extend_from_slice(payload);
    }
    out
}

//! The text header of a PLY file.

use std::collections::BTreeSet;
use std::path::Path;

use super::origin;
use crate::error::{Error, Result, excerpt, list};

/// A header longer than this is refused.
///
/// A 3DGS header takes about 1.5 kB. Without the bound, a file without `end_header` would be searched
/// whole, and a header of many properties would take long.
pub const MAX_HEADER_BYTES: usize = 1 << 20;

/// How the rows of a PLY file are stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Encoding {
    /// Decimal numbers, one row per line.
    Ascii,
    /// Packed, least significant byte first.
    BinaryLittleEndian,
    /// Packed, most significant byte first.
    BinaryBigEndian,
}

impl Encoding {
    /// The form of a file, in words.
    pub(super) fn form(self) -> &'static str {
        match self {
            Self::Ascii => "PLY, ASCII",
            Self::BinaryLittleEndian => "PLY, binary little-endian",
            Self::BinaryBigEndian => "PLY, binary big-endian",
        }
    }
}

/// A PLY scalar type.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Scalar {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl Scalar {
    fn parse(word: &[u8]) -> Option<Self> {
        Some(match word {
            b"char" | b"int8" => Self::I8,
            b"uchar" | b"uint8" => Self::U8,
            b"short" | b"int16" => Self::I16,
            b"ushort" | b"uint16" => Self::U16,
            b"int" | b"int32" => Self::I32,
            b"uint" | b"uint32" => Self::U32,
            b"float" | b"float32" => Self::F32,
            b"double" | b"float64" => Self::F64,
            _ => return None,
        })
    }

    const fn is_integer(self) -> bool {
        !matches!(self, Self::F32 | Self::F64)
    }

    pub(super) const fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }
}

/// One property of an element.
#[derive(Clone, Debug)]
pub(super) struct Property {
    pub(super) name: String,
    pub(super) scalar: Scalar,
    /// The type of the length, if the property is a list.
    pub(super) list: Option<Scalar>,
}

/// One element: `count` rows of the same properties.
#[derive(Clone, Debug)]
pub(super) struct PlyElement {
    pub(super) name: String,
    pub(super) count: u64,
    pub(super) properties: Vec<Property>,
}

impl PlyElement {
    /// The least number of bytes that a binary row can take.
    pub(super) fn least_row_bytes(&self) -> usize {
        self.properties.iter().map(|p| p.list.unwrap_or(p.scalar).size()).sum()
    }

    /// Refuses rows that, at `least` bytes each, do not fit in the `room` left in a file of `len` bytes.
    ///
    /// This is what bounds every allocation by the size of the input.
    pub(super) fn check_fits(
        &self,
        file: &Path,
        len: usize,
        room: usize,
        least: usize,
    ) -> Result<()> {
        let fitting = room.checked_div(least).map_or(u64::MAX, |n| n as u64);
        if self.count > fitting { Err(self.truncated(file, len, fitting)) } else { Ok(()) }
    }

    /// The error of a file of `len` bytes without all rows; `row` is the first that is missing.
    pub(super) fn truncated(&self, file: &Path, len: usize, row: u64) -> Error {
        let Self { name, count, .. } = self;
        let missing = format!(
            "the header promises {count} rows of element {:?}, row {row} is not whole",
            excerpt(name.as_bytes())
        );
        Error::truncated(file, len, missing)
    }

    /// Whether its Gaussians move in time: see [`super::TimedModel`].
    pub(super) fn moves(&self) -> bool {
        self.properties
            .iter()
            .any(|p| ["trbf_center", "trbf_scale", "log_duration"].contains(&&*p.name))
    }

    pub(super) fn has_list(&self) -> bool {
        self.properties.iter().any(|p| p.list.is_some())
    }
}

/// A parsed header.
#[derive(Clone, Debug)]
pub(super) struct PlyHeader {
    pub(super) encoding: Encoding,
    pub(super) elements: Vec<PlyElement>,
    pub(super) comments: Vec<String>,
    /// Offset of the first byte after the header.
    pub(super) len: usize,
    /// Number of lines of the header.
    pub(super) lines: usize,
    /// What ends a line.
    pub(super) line_end: u8,
}

impl PlyHeader {
    /// What of the file no one reads, a sentence each: elements but for those `read`, comments, and bytes after
    /// the last row.
    pub(super) fn notes(&self, read: &[&str], trailing_bytes: usize) -> Vec<String> {
        let others =
            self.elements.iter().filter(|e| e.count > 0 && !read.contains(&e.name.as_str()));
        let others = list(others.map(|e| format!("{} ({} rows)", e.name, e.count)));
        let used = |comment: &str| {
            names_maker(comment)
                || antialiased(comment).is_some()
                || origin::of_comment(comment).is_some()
        };
        let comments = self.comments.iter().filter(|comment| !used(comment));
        let comments = list(comments.cloned());
        let fixed = |e: &&PlyElement| e.name == "vertex" && self.encoding != Encoding::Ascii;
        let row = self.elements.last().filter(fixed).map_or(0, PlyElement::least_row_bytes);
        let trailing = (trailing_bytes > 0).then(|| match trailing_bytes.checked_rem(row) {
            Some(0) => {
                format!("{} rows more than the header promises are not read", trailing_bytes / row)
            }
            _ => format!("{trailing_bytes} bytes after the last row are not read"),
        });
        [
            others.map(|names| {
                format!("other elements than those of the model are not kept: {names}")
            }),
            comments.map(|said| format!("what the file's comments say is not used: {said}")),
            trailing,
        ]
        .into_iter()
        .flatten()
        .collect()
    }

    /// Whether the comments say that the model is antialiased. The last one that says so or the opposite counts.
    pub(super) fn antialiased(&self) -> Option<bool> {
        self.comments.iter().rev().find_map(|comment| antialiased(comment))
    }
}

/// Whether a comment says that the model is antialiased: `SplatRenderMode: mip` (Brush, gsplat, nerfstudio) or
/// `antialiased 1` (Postshot), in any case.
fn antialiased(comment: &str) -> Option<bool> {
    let comment = comment.to_ascii_lowercase();
    let value = |name: &str| Some(comment.strip_prefix(name)?.trim_start_matches([':', ' ', '\t']));
    match value("splatrendermode").or_else(|| value("antialiased"))? {
        "mip" | "1" | "true" => Some(true),
        "default" | "0" | "false" => Some(false),
        _ => None,
    }
}

/// True for a comment that says only who made the file, or nothing.
fn names_maker(comment: &str) -> bool {
    const MAKERS: [&str; 7] =
        ["generated", "created", "made", "exported", "written", "saved", "file generated"];
    let comment = comment.to_ascii_lowercase();
    comment.is_empty() || MAKERS.iter().any(|by| comment.starts_with(by))
}

/// Parses the header at the start of `bytes`.
pub(super) fn parse(file: &Path, bytes: &[u8]) -> Result<PlyHeader> {
    // Lines end as the first one does: \n, \r\n, or the \r of old Mac files.
    let line_end = match bytes {
        [b'p', b'l', b'y', b'\n', ..] | [b'p', b'l', b'y', b'\r', b'\n', ..] => b'\n',
        [b'p', b'l', b'y', b'\r', ..] => b'\r',
        _ => return Err(Error::other_format(file, "a PLY file", bytes)),
    };
    let mut parser = Parser {
        file,
        line: 1,
        encoding: None,
        elements: Vec::new(),
        comments: Vec::new(),
        elements_seen: BTreeSet::new(),
        properties_seen: BTreeSet::new(),
    };
    let searched = &bytes[..bytes.len().min(MAX_HEADER_BYTES)];
    let mut at = 0;
    while let Some(length) = searched[at..].iter().position(|&b| b == line_end) {
        let text = searched[at..at + length].trim_ascii();
        at += length + 1;
        if text == b"end_header" {
            let Some(encoding) = parser.encoding else {
                return Err(parser.error("no format line before it", text));
            };
            return Ok(PlyHeader {
                encoding,
                elements: parser.elements,
                comments: parser.comments,
                len: at,
                lines: parser.line,
                line_end,
            });
        }
        if parser.line > 1 {
            parser.take(text)?;
        }
        parser.line += 1;
    }
    Err(if bytes.len() > searched.len() {
        let reason = format!("no end_header in the first {MAX_HEADER_BYTES} bytes");
        Error::malformed(file, "header", reason)
    } else {
        Error::truncated(file, bytes.len(), "the header has no end_header")
    })
}

struct Parser<'a> {
    file: &'a Path,
    line: usize,
    encoding: Option<Encoding>,
    elements: Vec<PlyElement>,
    comments: Vec<String>,
    elements_seen: BTreeSet<String>,
    properties_seen: BTreeSet<String>,
}

impl Parser<'_> {
    fn error(&self, reason: &str, text: &[u8]) -> Error {
        let reason = format!("{reason}: {:?}", excerpt(text));
        Error::malformed(self.file, &format!("header line {}", self.line), reason)
    }

    /// One header line between the magic and `end_header`.
    fn take(&mut self, text: &[u8]) -> Result<()> {
        let mut words = text.split(u8::is_ascii_whitespace).filter(|w| !w.is_empty());
        match words.next() {
            None => {}
            Some(b"comment" | b"obj_info") => {
                let rest = text.iter().position(u8::is_ascii_whitespace).unwrap_or(text.len());
                self.comments.push(String::from_utf8_lossy(text[rest..].trim_ascii()).into_owned());
            }
            Some(b"format") => self.format(text, words.next(), words.next())?,
            Some(b"element") => self.element(text, words.next(), words.next())?,
            Some(b"property") => self.property(text, &words.collect::<Vec<_>>())?,
            Some(_) => return Err(self.error("unknown keyword", text)),
        }
        Ok(())
    }

    fn format(&mut self, text: &[u8], name: Option<&[u8]>, version: Option<&[u8]>) -> Result<()> {
        if self.encoding.is_some() {
            return Err(self.error("second format line", text));
        }
        if version != Some(b"1.0") {
            return Err(self.error("format version is not 1.0", text));
        }
        self.encoding = Some(match name {
            Some(b"ascii") => Encoding::Ascii,
            Some(b"binary_little_endian") => Encoding::BinaryLittleEndian,
            Some(b"binary_big_endian") => Encoding::BinaryBigEndian,
            _ => return Err(self.error("unknown format", text)),
        });
        Ok(())
    }

    fn element(&mut self, text: &[u8], name: Option<&[u8]>, count: Option<&[u8]>) -> Result<()> {
        let (Some(name), Some(count)) = (name, count) else {
            return Err(self.error("expected: element NAME COUNT", text));
        };
        let name = self.name(text, name)?;
        let Some(count) = std::str::from_utf8(count).ok().and_then(|c| c.parse::<u64>().ok())
        else {
            return Err(self.error("bad element count", text));
        };
        if !self.elements_seen.insert(name.clone()) {
            return Err(self.error("element is declared twice; one PLY holds one model", text));
        }
        self.properties_seen.clear();
        self.elements.push(PlyElement { name, count, properties: Vec::new() });
        Ok(())
    }

    fn property(&mut self, text: &[u8], words: &[&[u8]]) -> Result<()> {
        let (list, scalar, name) = match words {
            [b"list", length, scalar, name] => {
                let Some(length) = Scalar::parse(length).filter(|&s| s.is_integer()) else {
                    return Err(self.error("type of list length is not an integer type", text));
                };
                (Some(length), scalar, name)
            }
            [scalar, name] => (None, scalar, name),
            _ => return Err(self.error("expected: property [list LENGTH_TYPE] TYPE NAME", text)),
        };
        let Some(scalar) = Scalar::parse(scalar) else {
            return Err(self.error("unknown property type", text));
        };
        let name = self.name(text, name)?;
        if self.elements.is_empty() {
            return Err(self.error("property before the first element", text));
        }
        if !self.properties_seen.insert(name.clone()) {
            return Err(self.error("property is declared twice", text));
        }
        if let Some(element) = self.elements.last_mut() {
            element.properties.push(Property { name, scalar, list });
        }
        Ok(())
    }

    fn name(&self, text: &[u8], name: &[u8]) -> Result<String> {
        match std::str::from_utf8(name) {
            Ok(name) => Ok(name.to_owned()),
            Err(_) => Err(self.error("name is not UTF-8", text)),
        }
    }
}

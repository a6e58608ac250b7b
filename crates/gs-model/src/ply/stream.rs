//! Plain binary files in parts, without the whole file in memory.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use super::binary::Source;
use super::columns::Columns;
use super::header::{self, Format};
use super::{ReadReport, finish};
use crate::error::{Error, Result};
use crate::options::ReadOptions;
use crate::rows;
use crate::scene::Scene;

/// Files below this are read whole: one allocation more than they take costs nothing.
const SMALL: u64 = 4 << 20;
/// Bytes read ahead to find the header, and in each part after it: few enough to stay in a cache
/// until they are converted, and no block whose release would teach glibc's allocator to keep
/// blocks of megabytes to itself.
const PART: usize = 1 << 20;

/// Reads a file whose rows are Gaussians of fixed length, in parts: one is converted while the next
/// is read. `None` if the file is not such a one, or if anything about it is wrong: then the reader
/// of whole files decides, and words the error.
pub(super) fn read(path: &Path, options: &ReadOptions) -> Result<Option<(Scene, ReadReport)>> {
    let io = |e| Error::io(path, "read", e);
    let mut file = File::open(path).map_err(io)?;
    let about = file.metadata().map_err(io)?;
    if !about.is_file() || about.len() < SMALL {
        return Ok(None);
    }
    let Ok(len) = usize::try_from(about.len()) else { return Ok(None) };
    let mut head = vec![0; PART.min(len)];
    file.read_exact(&mut head).map_err(io)?;
    let Ok(header) = header::parse(path, &head) else { return Ok(None) };
    let Some((vertex, after)) = header.elements.split_first() else { return Ok(None) };
    let plain = header.format != Format::Ascii && vertex.name == "vertex" && !vertex.has_list();
    if !plain || !after.is_empty() {
        return Ok(None);
    }
    let columns = Columns::of(path, vertex)?;
    let source = Source::of(vertex, &columns, header.format == Format::BinaryBigEndian);
    let rows = usize::try_from(vertex.count).ok();
    let body = rows.and_then(|rows| rows.checked_mul(source.stride));
    let (Some(rows), Some(body)) = (rows, body) else { return Ok(None) };
    if body > len - header.len || source.stride > PART {
        return Ok(None);
    }

    let mut scene = rows::blank(rows, columns.sh_degree);
    head.drain(..header.len);
    head.truncate(body);
    let (mut part, mut next) = (head, Vec::new());
    let (mut first, mut unread) = (0, body - part.len());
    while first < rows {
        let whole = part.len() / source.stride;
        let used = whole * source.stride;
        let kept = part.len() - used;
        let more = (PART - kept).min(unread);
        // All of it is written over.
        next.resize(kept + more, 0);
        next[..kept].copy_from_slice(&part[used..]);
        let (fetched, filled) = rayon::join(
            || file.read_exact(&mut next[kept..]),
            || {
                rows::fill_range(&mut scene, first..first + whole, |rows| {
                    let at = (rows.first - first) * source.stride;
                    let bytes = &part[at..at + rows.len() * source.stride];
                    source.fill(rows, bytes);
                    Ok(())
                })
            },
        );
        fetched.map_err(io)?;
        filled?;
        first += whole;
        unread -= more;
        std::mem::swap(&mut part, &mut next);
    }
    let lengths = [len, len - header.len - body];
    finish(path, scene, options, &header, columns, Vec::new(), lengths).map(Some)
}

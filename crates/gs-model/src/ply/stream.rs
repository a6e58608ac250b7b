//! Binary files that hold nothing but Gaussians, read in parts, so that memory never holds the
//! whole file.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use super::binary::RowLayout;
use super::columns::Columns;
use super::header::{self, Format};
use super::report::{Extent, ReadReport, finish};
use crate::error::{Error, Result};
use crate::options::ReadOptions;
use crate::rows;
use crate::scene::Scene;

/// Files below this size, in bytes, are read whole: their memory does not matter.
const SMALL_FILE: u64 = 4 << 20;
/// Bytes of a part; the first part contains the header. A part stays in the processor's cache until
/// it is converted. Larger parts would also raise the size from which glibc's allocator returns
/// freed memory to the system.
const PART_BYTES: usize = 1 << 20;

/// Reads a file whose rows are Gaussians of fixed length, in parts: one part is converted while the
/// next is read. `None` if the file has another layout or is wrong in any way: then the reader of
/// whole files decides, and words the error.
pub(super) fn read(path: &Path, options: &ReadOptions) -> Result<Option<(Scene, ReadReport)>> {
    let io = |e| Error::io(path, "read", e);
    let mut file = File::open(path).map_err(io)?;
    let metadata = file.metadata().map_err(io)?;
    if !metadata.is_file() || metadata.len() < SMALL_FILE {
        return Ok(None);
    }
    let Ok(len) = usize::try_from(metadata.len()) else { return Ok(None) };
    let mut head = vec![0; PART_BYTES.min(len)];
    file.read_exact(&mut head).map_err(io)?;
    let Ok(header) = header::parse(path, &head) else { return Ok(None) };
    let Some((vertex, after)) = header.elements.split_first() else { return Ok(None) };
    let plain = header.format != Format::Ascii && vertex.name == "vertex" && !vertex.has_list();
    if !plain || !after.is_empty() {
        return Ok(None);
    }
    let columns = Columns::of(path, vertex)?;
    let layout = RowLayout::of(vertex, &columns, header.format == Format::BinaryBigEndian);
    let rows = usize::try_from(vertex.count).ok();
    let body = rows.and_then(|rows| rows.checked_mul(layout.stride));
    let (Some(rows), Some(body)) = (rows, body) else { return Ok(None) };
    if body > len - header.len || layout.stride > PART_BYTES {
        return Ok(None);
    }

    let mut scene = Scene::zeros(rows, columns.sh_degree);
    head.drain(..header.len);
    head.truncate(body);
    let (mut part, mut next) = (head, Vec::new());
    let (mut first, mut unread) = (0, body - part.len());
    while first < rows {
        let whole = part.len() / layout.stride;
        let used = whole * layout.stride;
        let kept = part.len() - used;
        let more = (PART_BYTES - kept).min(unread);
        // Every byte of it is overwritten below.
        next.resize(kept + more, 0);
        next[..kept].copy_from_slice(&part[used..]);
        let (fetched, filled) = rayon::join(
            || file.read_exact(&mut next[kept..]),
            || {
                rows::fill_range(&mut scene, first..first + whole, |rows| {
                    let at = (rows.first - first) * layout.stride;
                    let bytes = &part[at..at + rows.len() * layout.stride];
                    layout.fill(rows, bytes, &columns);
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
    let trailing_bytes = len - header.len - body;
    let skipped_elements = Vec::new();
    let extent = Extent { vertex, skipped_elements, file_bytes: len, trailing_bytes };
    finish(path, scene, options, &header, columns, extent).map(Some)
}

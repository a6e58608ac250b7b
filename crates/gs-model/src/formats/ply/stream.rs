//! Binary files that hold nothing but Gaussians, read in parts, so that memory never holds the
//! whole file.

use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

use super::binary::RowLayout;
use super::columns::Columns;
use super::header::{self, Encoding, PlyHeader};
use super::{antialiased, report_of};
use crate::error::{Error, Result};
use crate::report::{CleaningReport, ReadOptions, Report};
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
pub(super) fn read(path: &Path) -> Result<Option<(Scene, Report)>> {
    let small = std::fs::metadata(path).is_ok_and(|m| m.is_file() && m.len() < SMALL_FILE);
    if small {
        return Ok(None);
    }
    let Some(mut body) = Body::open(path)? else { return Ok(None) };
    let mut scene = body.zeros(body.rows)?;
    while body.first < body.rows {
        body.fill_part(&mut scene, 0)?;
    }
    let report = report_of(&body.header, &body.columns, body.trailing_bytes);
    Ok(Some((scene, report)))
}

/// A PLY file that is read some Gaussians at a time, for scenes larger than memory.
#[derive(Debug)]
pub struct Parts {
    body: Body,
    options: ReadOptions,
    cleaned: CleaningReport,
}

impl Parts {
    /// Opens a binary file that holds Gaussians of fixed length and nothing else. `None` if it is anything else,
    /// which [`super::read`] reads or refuses.
    ///
    /// # Errors
    /// [`Error::Io`]; those of the columns.
    pub fn open(path: impl AsRef<Path>, options: &ReadOptions) -> Result<Option<Self>> {
        let body = Body::open(path.as_ref())?;
        Ok(body.map(|body| Self { body, options: *options, cleaned: CleaningReport::default() }))
    }

    /// Gaussians in the file.
    #[must_use]
    pub fn gaussians_in_file(&self) -> usize {
        self.body.rows
    }

    /// Their SH degree.
    #[must_use]
    pub fn sh_degree(&self) -> u8 {
        self.body.columns.sh_degree
    }

    /// The next Gaussians, about as many as a megabyte holds; `None` at the end. Invalid ones are left out if the
    /// options say so.
    ///
    /// # Errors
    /// [`Error::Io`]; [`Error::InvalidGaussian`], which counts those from this part on.
    pub fn next_part(&mut self) -> Result<Option<Scene>> {
        let body = &mut self.body;
        let Some(mut scene) = body.next_part()? else { return Ok(None) };
        match self.options.clean(&body.path, &mut scene, &mut self.cleaned) {
            Ok(()) => Ok(Some(scene)),
            Err(Error::InvalidGaussian { file, index, field, value, mut count }) => {
                while let Some(mut rest) = body.next_part()? {
                    rest.clamp_limits();
                    count += rest.invalid().map_or(0, |invalid| invalid.count);
                }
                Err(Error::InvalidGaussian { file, index, field, value, count })
            }
            Err(error) => Err(error),
        }
    }

    /// What the file held, as far as it has been read: all of it after the last part.
    #[must_use]
    pub fn report(&self) -> Report {
        let body = &self.body;
        let mut report = report_of(&body.header, &body.columns, body.trailing_bytes);
        self.cleaned.report(&mut report);
        report
    }
}

/// The rows of a file, as far as they have been read.
#[derive(Debug)]
struct Body {
    path: PathBuf,
    file: File,
    header: PlyHeader,
    columns: Columns,
    layout: RowLayout,
    /// Length of what follows the rows.
    trailing_bytes: usize,
    rows: usize,
    /// The first row in `part`.
    first: usize,
    part: Vec<u8>,
    next: Vec<u8>,
    /// Bytes of the body that are still in the file.
    unread: usize,
}

impl Body {
    fn open(path: &Path) -> Result<Option<Self>> {
        let io = |e| Error::io(path, "read", e);
        let mut file = File::open(path).map_err(io)?;
        let metadata = file.metadata().map_err(io)?;
        let Ok(len) = usize::try_from(metadata.len()) else { return Ok(None) };
        if !metadata.is_file() {
            return Ok(None);
        }
        let mut part = vec![0; PART_BYTES.min(len)];
        file.read_exact(&mut part).map_err(io)?;
        let Ok(header) = header::parse(path, &part) else { return Ok(None) };
        let [vertex] = &header.elements[..] else { return Ok(None) };
        if header.encoding == Encoding::Ascii || vertex.name != "vertex" || vertex.moves() {
            return Ok(None);
        }
        let mut columns = Columns::of(path, vertex)?;
        let layout = RowLayout::of(vertex, &columns, header.encoding == Encoding::BinaryBigEndian);
        let rows = usize::try_from(vertex.count).ok();
        let body = rows.and_then(|rows| rows.checked_mul(layout.stride));
        let (Some(rows), Some(body)) = (rows, body) else { return Ok(None) };
        if body > len - header.len || layout.stride > PART_BYTES {
            return Ok(None);
        }
        part.drain(..header.len);
        part.truncate(body);
        let whole = part.len() - part.len() % layout.stride;
        layout.choose_origin(vertex, &mut columns, &part[..whole]);
        let (unread, trailing_bytes) = (body - part.len(), len - header.len - body);
        let (path, first, next) = (path.to_path_buf(), 0, Vec::new());
        Ok(Some(Self {
            path,
            file,
            header,
            columns,
            layout,
            trailing_bytes,
            rows,
            first,
            part,
            next,
            unread,
        }))
    }

    /// A scene of `n` Gaussians of zeros, to be filled in.
    fn zeros(&self, n: usize) -> Result<Scene> {
        let antialiased = antialiased(&self.header, &self.columns);
        let origin = self.columns.scene_origin(&self.header);
        let zeros = Scene::try_zeros(n, self.columns.sh_degree);
        let zeros = zeros.map_err(|e| Error::io(&self.path, "read", e.into()))?;
        Ok(Scene { antialiased, origin, ..zeros })
    }

    /// The Gaussians that have been read; `None` at the end.
    fn next_part(&mut self) -> Result<Option<Scene>> {
        if self.first == self.rows {
            return Ok(None);
        }
        let rows = self.part.len() / self.layout.stride;
        let mut scene = self.zeros(rows)?;
        self.fill_part(&mut scene, self.first)?;
        Ok(Some(scene))
    }

    /// Converts what has been read while it reads more. `scene` holds rows from `origin` on.
    fn fill_part(&mut self, scene: &mut Scene, origin: usize) -> Result<()> {
        let Self { path, file, columns, layout, first, part, next, unread, .. } = self;
        let whole = part.len() / layout.stride;
        let used = whole * layout.stride;
        let kept = part.len() - used;
        let more = (PART_BYTES - kept).min(*unread);
        // Every byte of it is overwritten below.
        next.resize(kept + more, 0);
        next[..kept].copy_from_slice(&part[used..]);
        let start = *first - origin;
        let (fetched, filled) = rayon::join(
            || file.read_exact(&mut next[kept..]),
            || {
                rows::fill_range(scene, start..start + whole, |first, rows| {
                    let at = (first - start) * layout.stride;
                    let bytes = &part[at..at + rows.len() * layout.stride];
                    layout.fill(rows, bytes, columns);
                    Ok(())
                })
            },
        );
        fetched.map_err(|e| Error::io(path, "read", e))?;
        filled?;
        *first += whole;
        *unread -= more;
        std::mem::swap(part, next);
        Ok(())
    }
}

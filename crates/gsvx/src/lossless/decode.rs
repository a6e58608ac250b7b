//! The decoder of the bit-exact mode.

use super::column::{CELLS, Map};
use super::layout::{self, MEANS};
use super::means::Means;
use super::predictor::ColumnPredictor;
use super::{
    Column, MAX_PART, MORTON_ORDER, OWN_ORDER, PartBits, RAW, index_bits, neighbours, part_bounds,
    rows,
};
use crate::bytes::SliceReader;
use crate::chunk::resize;
use crate::error::{Error, Result, coding};
use gpcc_lite::coder::{Coder, RansDecoder};
use gs_model::Scene;

/// Gaussians that one byte of a part can stand for. A decision costs at least 0.0007 bit, and a Gaussian
/// of degree 0 takes 17 of them: 670 Gaussians a byte.
const ROWS_PER_BYTE: u64 = 1024;

fn corrupt(what: &'static str, value: impl Into<u64>) -> Error {
    Error::Corrupt { what, value: value.into() }
}

/// Decodes a payload into a scene of `count` Gaussians.
///
/// # Errors
/// [`Error::Truncated`], [`Error::Corrupt`] or [`Error::Limit`]. Memory and time are bounded by
/// the payload's length; damage that no check sees gives wrong values, which is what the
/// layer's checksum is for.
pub(crate) fn decode_payload(payload: &[u8], count: u64, sh_degree: u8) -> Result<Scene> {
    check_limit(count, payload.len(), 0)?;
    let n = count as usize;
    if let Some((&RAW, rows)) = payload.split_first() {
        return decode_raw(rows, n, sh_degree);
    }
    let mut r = SliceReader::new(payload, "exact Gaussians");
    let head = Head::read(&mut r, n, sh_degree)?;
    let blocks: Vec<&[u8]> = (0..head.parts).map(|_| r.block()).collect::<Result<_>>()?;
    if r.remaining() != 0 {
        return Err(corrupt("bytes after the last part", r.remaining() as u64));
    }
    let bounds = part_bounds(n, blocks.len());
    let jobs = blocks.into_iter().enumerate().collect();
    let parts = crate::parallel::map(jobs, |(k, block): (usize, &[u8])| {
        head.decode_part(block, bounds[k + 1] - bounds[k], n)
    });
    let parts: Vec<_> = parts.into_iter().collect::<Result<_>>()?;
    let mut scene = Scene { sh_degree, ..Scene::default() };
    resize(&mut scene, n)?;
    let mut seen = vec![false; if head.keep_order { n } else { 0 }];
    for (k, (coded, order)) in parts.into_iter().enumerate() {
        for &i in &order {
            match seen.get_mut(i as usize) {
                Some(seen) if !*seen => *seen = true,
                _ => return Err(corrupt("index of a Gaussian", i)),
            }
        }
        for (row, values) in coded.bits.chunks_exact(head.columns.len()).enumerate() {
            let i = order.get(row).map_or(bounds[k] + row, |&i| i as usize);
            layout::scatter(&mut scene, i, values);
        }
    }
    Ok(scene)
}

/// Floats as they are, row by row.
fn decode_raw(bytes: &[u8], n: usize, sh_degree: u8) -> Result<Scene> {
    let columns = layout::columns(sh_degree);
    if bytes.len() as u64 != 4 * columns as u64 * n as u64 {
        return Err(corrupt("bytes of raw Gaussians", bytes.len() as u64));
    }
    let mut scene = Scene { sh_degree, ..Scene::default() };
    resize(&mut scene, n)?;
    for (i, row) in bytes.chunks_exact(4 * columns).enumerate() {
        let row: Vec<u32> = row.as_chunks::<4>().0.iter().map(|v| u32::from_le_bytes(*v)).collect();
        layout::scatter(&mut scene, i, &row);
    }
    Ok(scene)
}

fn check_limit(points: u64, bytes: usize, more: u64) -> Result<()> {
    let limit = ROWS_PER_BYTE * bytes as u64 + more;
    if points > limit { Err(Error::Limit { points, limit }) } else { Ok(()) }
}

/// What comes before the parts.
struct Head {
    keep_order: bool,
    parts: usize,
    /// Bits of a mean's coordinate below the Morton code's 21.
    below: u32,
    /// Least cell index of the means per axis.
    least: [i32; 3],
    columns: Vec<Column>,
}

impl Head {
    fn read(r: &mut SliceReader<'_>, n: usize, sh_degree: u8) -> Result<Self> {
        let keep_order = match r.u8()? {
            MORTON_ORDER => false,
            OWN_ORDER => true,
            other => return Err(corrupt("form of exact Gaussians", other)),
        };
        let parts = r.varint()?;
        if parts != n.div_ceil(MAX_PART) as u64 {
            return Err(corrupt("number of parts", parts));
        }
        let below = r.u8()?;
        if below > 4 {
            return Err(corrupt("bits below the Morton code", below));
        }
        let mut least = [0i32; 3];
        for v in &mut least {
            let raw = r.varint()?;
            if raw >= 2 * CELLS as u64 {
                return Err(corrupt("least mean", raw));
            }
            *v = raw as i32 - CELLS;
        }
        let mut columns = vec![read_column(r, 0)?; MEANS];
        for c in MEANS..layout::columns(sh_degree) {
            columns.push(read_column(r, c)?);
        }
        let (parts, below) = (parts as usize, below.into());
        Ok(Self { keep_order, parts, below, least, columns })
    }

    /// The Gaussians of one part, of `n` in all, and their indices if they are coded.
    fn decode_part(&self, block: &[u8], count: usize, n: usize) -> Result<(PartBits, Vec<u32>)> {
        check_limit(count as u64, block.len(), 64)?;
        let what = "a part of exact Gaussians";
        let short = || Error::Truncated { what, offset: block.len() as u64, need: 1, have: 0 };
        let mut coder = RansDecoder::new(block).map_err(coding(what))?;
        let width = self.columns.len();
        let mut coded = PartBits { bits: vec![0; count * width], ..Default::default() };
        let means = Means { column: &self.columns[0], least: self.least, below: self.below };
        if !means.code(&mut coder, &mut coded, count, width, &[]) {
            return Err(short());
        }
        let near = neighbours::find(&coded.means);
        if !rows::code(&mut coder, &self.columns, &near, &[], &mut coded) {
            return Err(short());
        }
        let mut order = Vec::new();
        if self.keep_order {
            let width = index_bits(n);
            order.extend((0..count).map(|_| coder.bits(0, width)));
        }
        coder.finish().map_err(coding(what))?;
        Ok((coded, order))
    }
}

fn read_column(r: &mut SliceReader<'_>, c: usize) -> Result<Column> {
    let map = Map::read(r)?;
    let flags = r.u8()?;
    if flags > 3 {
        return Err(corrupt("flags of a column", flags));
    }
    let common = if flags & 2 != 0 { Some(r.u32()?) } else { None };
    let (mut centre, mut predictor) = (0, ColumnPredictor::default());
    if c >= MEANS {
        centre = r.u8()?;
        if centre > 120 {
            return Err(corrupt("error level of a column", centre));
        }
        predictor = ColumnPredictor::read(r, c)?;
    }
    Ok(Column { map, predictor, centre, common, escapes: flags & 1 != 0 })
}

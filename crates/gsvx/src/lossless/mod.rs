//! Bit-exact coding of every float of a scene.
//!
//! Normative description: `docs/format-lossless.md`. Gaussians come back in Morton order of
//! their means unless the original order is asked for; every value comes back bit for bit,
//! NaN payloads included. Columns are cut into cells whose index is predicted (from the
//! Gaussian's earlier columns by a linear form fitted by the encoder, from what that form leaves
//! at neighbours, and from a covariance of the columns that follows the place in the scene) and
//! coded with mixed adaptive contexts; the bits inside a cell are noise and stored as they are.

mod chunk;
mod column;
mod fit;
pub(crate) mod layout;
mod local;
mod neighbours;
mod predictor;
mod residual;

use crate::bytes::Reader;
#[cfg(feature = "encode")]
use crate::bytes::Writer;
use crate::error::{Error, Result, coding};
use chunk::{Coded, Column, Means};
use column::{Cell, Map};
use gpcc_lite::coder::{Coder, Decoder, Encoder};
use gs_model::Scene;
use layout::MEANS;
#[cfg(feature = "encode")]
use rayon::prelude::*;

/// Gaussians per chunk, at most; chunks are coded independently of each other.
const CHUNK: usize = 1 << 16;
/// A value this frequent (one in so many) gets a flag of its own.
const COMMON: usize = 256;
/// Gaussians that one byte of a chunk can stand for: a decision costs at least 0.0007 bit, and
/// a Gaussian of degree 0 takes more than twenty-five.
const ROWS_PER_BYTE: u64 = 512;

/// First row of each chunk, and the end.
fn chunk_bounds(n: usize, chunks: usize) -> Vec<usize> {
    (0..=chunks).map(|k| (n as u64 * k as u64 / chunks.max(1) as u64) as usize).collect()
}

/// The payload of a scene's Gaussians, bit for bit. They come back in Morton order of their means, or in
/// their own at `ceil(log2 N)` bits each. Values need not be valid: NaN, infinities and zero
/// quaternions are kept.
#[cfg(feature = "encode")]
pub(crate) fn encode_payload(scene: &Scene, keep_order: bool) -> Vec<u8> {
    let n = scene.len();
    let columns = layout::columns(scene.sh_degree);
    let identity: Vec<u32> = (0..n as u32).collect();
    let means: Vec<Vec<u32>> = (0..MEANS).map(|c| layout::gather(scene, c, &identity)).collect();
    let all = means.concat();
    let grid = Map::grid(&all);
    let escapes = grid.has_escapes(&all);
    drop(all);
    let mean_column =
        Column { map: grid, predictor: Default::default(), centre: 0, common: None, escapes };
    let cells: Vec<[i32; 3]> = (0..n)
        .map(|i| {
            std::array::from_fn(|a| match mean_column.map.split(means[a][i]) {
                Cell::At { q, .. } | Cell::Tiny { q, .. } | Cell::Escape { q } => q,
            })
        })
        .collect();
    drop(means);
    let least: [i32; 3] =
        std::array::from_fn(|a| cells.iter().map(|q| q[a]).min().unwrap_or_default());
    let span = (0..3)
        .flat_map(|a| cells.iter().map(move |q| (q[a] - least[a]) as u32))
        .max()
        .unwrap_or_default();
    let below = (32 - span.leading_zeros()).saturating_sub(21);
    let code = Means { column: &mean_column, least, below };
    let mut order: Vec<(u64, u32)> =
        cells.iter().enumerate().map(|(i, &q)| (code.key(q), i as u32)).collect();
    drop(cells);
    order.par_sort_unstable();
    let order: Vec<u32> = order.into_iter().map(|(_, i)| i).collect();

    let count = n.div_ceil(CHUNK);
    let bounds = chunk_bounds(n, count);
    let mut specs: Vec<Column> = (0..columns)
        .into_par_iter()
        .map(|c| {
            if c < MEANS {
                return mean_column.clone();
            }
            let values = layout::gather(scene, c, &order);
            let map = Map::choose(&values);
            let escapes = map.has_escapes(&values);
            let common = common_value(&values);
            Column { map, predictor: Default::default(), centre: 0, common, escapes }
        })
        .collect();
    // Rows are gathered twice rather than held: they are as large as the scene.
    let stride = fit::stride(n);
    let mut near = Vec::with_capacity(count);
    let mut sample = fit::Sample::new(columns);
    let parts: Vec<_> = (0..count)
        .into_par_iter()
        .map(|k| {
            let order = &order[bounds[k]..bounds[k + 1]];
            let stand_in = |c: usize, v: u32| specs[c].map.stand_in(v);
            let mean = |a: usize| {
                layout::gather(scene, a, order).iter().map(|&v| stand_in(a, v)).collect()
            };
            let near = neighbours::find(&(0..MEANS).map(mean).collect::<Vec<_>>());
            let mut sample = fit::Sample::new(columns);
            for i in (stride / 2..order.len()).step_by(stride) {
                let rows: Vec<u32> =
                    std::iter::once(i as u32).chain(near[i]).map(|j| order[j as usize]).collect();
                let bits = layout::gather_rows(scene, &rows);
                let cells = bits.iter().enumerate().map(|(at, &v)| stand_in(at % columns, v));
                sample.push(&bits[..columns], cells);
            }
            (near, sample)
        })
        .collect();
    for (neighbours, part) in parts {
        near.push(neighbours);
        sample.append(part);
    }
    let fitted: Vec<_> = (MEANS..columns)
        .into_par_iter()
        .map(|c| {
            let Column { common, escapes, ref map, .. } = specs[c];
            let skip = |v: u32| {
                common == Some(v) || (escapes && matches!(map.split(v), Cell::Escape { .. }))
            };
            fit::fit(&sample, c, skip)
        })
        .collect();
    drop(sample);
    for (spec, (predictor, centre)) in specs[MEANS..].iter_mut().zip(fitted) {
        spec.predictor = predictor;
        spec.centre = centre;
    }

    let mut w = Writer::default();
    w.u8(u8::from(keep_order));
    w.varint(count as u64);
    w.u8(below as u8);
    for v in least {
        w.varint((v + column::CELLS) as u64);
    }
    for (c, spec) in specs.iter().enumerate().filter(|&(c, _)| c == 0 || c >= MEANS) {
        write_column(&mut w, c, spec);
    }
    let code = Means { column: &specs[0], least, below };
    let coded: Vec<Vec<u8>> = (0..count)
        .into_par_iter()
        .map(|k| {
            let order = &order[bounds[k]..bounds[k + 1]];
            let bits = layout::gather_rows(scene, order);
            let mut coder = Encoder::default();
            let mut coded = Coded { bits: vec![0; bits.len()], ..Default::default() };
            code.code(&mut coder, &mut coded, order.len(), columns, &bits);
            chunk::rows(&mut coder, &specs, &near[k], &bits, &mut coded);
            if keep_order {
                let width = index_bits(n);
                for &i in order {
                    coder.bits(i, width);
                }
            }
            coder.finish()
        })
        .collect();
    const LENGTH_OF_A_BLOCK: usize = 10;
    w.bytes.reserve_exact(coded.iter().map(|b| b.len() + LENGTH_OF_A_BLOCK).sum());
    for block in coded {
        w.block(&block);
    }
    w.bytes
}

/// Bits of an index below `n`.
fn index_bits(n: usize) -> u32 {
    64 - (n.max(1) as u64 - 1).leading_zeros()
}

/// The value of a column that deserves a flag.
fn common_value(values: &[u32]) -> Option<u32> {
    // Any value this frequent shows up in a sample of a few thousand.
    let stride = (values.len() / 8192).max(1);
    let mut sample: Vec<u32> = values.iter().step_by(stride).copied().collect();
    sample.sort_unstable();
    let run = sample.chunk_by(|a, b| a == b).max_by_key(|run| run.len())?;
    (run.len() >= 4 && run.len() * COMMON >= sample.len()).then(|| run[0])
}

fn write_column(w: &mut Writer, c: usize, spec: &Column) {
    spec.map.write(w);
    w.u8(u8::from(spec.escapes) | u8::from(spec.common.is_some()) << 1);
    if let Some(v) = spec.common {
        w.u32(v);
    }
    if c >= MEANS {
        w.u8(spec.centre);
        spec.predictor.write(w);
    }
}

fn read_column(r: &mut Reader<'_>, c: usize) -> Result<Column> {
    let map = Map::read(r)?;
    let flags = r.u8()?;
    if flags > 3 {
        return Err(Error::Corrupt { what: "lossless column flags", value: flags.into() });
    }
    let common = if flags & 2 != 0 { Some(r.u32()?) } else { None };
    let (mut centre, mut predictor) = (0, Default::default());
    if c >= MEANS {
        centre = r.u8()?;
        if centre > 120 {
            return Err(Error::Corrupt { what: "lossless error level", value: centre.into() });
        }
        predictor = predictor::Predictor::read(r, c)?;
    }
    Ok(Column { map, predictor, centre, common, escapes: flags & 1 != 0 })
}

/// Decodes the payload of a lossless section into a scene of `count` Gaussians.
///
/// # Errors
/// [`Error::Truncated`], [`Error::Corrupt`] or [`Error::Limit`]. Memory and time are bounded by
/// the payload's length; damage that no check sees gives wrong values, which is what the
/// section's checksum is for.
pub(crate) fn decode_payload(payload: &[u8], count: u64, sh_degree: u8) -> Result<Scene> {
    let corrupt = |what, value: u64| Error::Corrupt { what, value };
    if sh_degree > 3 {
        return Err(corrupt("SH degree", sh_degree.into()));
    }
    let limit = ROWS_PER_BYTE * payload.len() as u64;
    if count > limit.min(u32::MAX.into()) {
        return Err(Error::Limit { points: count, limit });
    }
    let n = count as usize;
    let mut r = Reader::new(payload, "lossless");
    let flags = r.u8()?;
    if flags > 1 {
        return Err(corrupt("lossless flags", flags.into()));
    }
    let keep_order = flags == 1;
    let chunks = r.varint()?;
    if chunks != (n.div_ceil(CHUNK)) as u64 {
        return Err(corrupt("chunk count", chunks));
    }
    let below = r.u8()?;
    if below > 4 {
        return Err(corrupt("bits below the Morton code", below.into()));
    }
    let mut least = [0i32; 3];
    for v in &mut least {
        let raw = r.varint()?;
        if raw >= 2 * column::CELLS as u64 {
            return Err(corrupt("least mean", raw));
        }
        *v = raw as i32 - column::CELLS;
    }
    let columns = layout::columns(sh_degree);
    let mut specs = vec![read_column(&mut r, 0)?; MEANS];
    for c in MEANS..columns {
        specs.push(read_column(&mut r, c)?);
    }
    let blocks: Vec<&[u8]> = (0..chunks).map(|_| r.block()).collect::<Result<_>>()?;
    if r.remaining() != 0 {
        return Err(corrupt("bytes after the last chunk", r.remaining() as u64));
    }
    let bounds = chunk_bounds(n, blocks.len());
    let code = Means { column: &specs[0], least, below: below.into() };
    let parts: Vec<Result<(Coded, Vec<u32>)>> = crate::parallel::map(
        blocks.into_iter().enumerate().collect(),
        |(k, block): (usize, &[u8])| {
            let rows = bounds[k + 1] - bounds[k];
            let limit = ROWS_PER_BYTE * block.len() as u64 + 64;
            if rows as u64 > limit {
                return Err(Error::Limit { points: rows as u64, limit });
            }
            let short = || Error::Truncated {
                what: "lossless chunk",
                offset: block.len(),
                need: 1,
                have: 0,
            };
            let mut coder = Decoder::new(block).map_err(coding("lossless chunk"))?;
            let mut coded = Coded { bits: vec![0; rows * columns], ..Default::default() };
            if !code.code(&mut coder, &mut coded, rows, columns, &[]) {
                return Err(short());
            }
            let near = neighbours::find(&coded.means);
            if !chunk::rows(&mut coder, &specs, &near, &[], &mut coded) {
                return Err(short());
            }
            let mut order = Vec::new();
            if keep_order {
                let width = index_bits(n);
                order.extend((0..rows).map(|_| coder.bits(0, width)));
                if coder.exhausted() {
                    return Err(short());
                }
            }
            Ok((coded, order))
        },
    );
    let mut scene = layout::blank(n, sh_degree);
    let mut seen = vec![false; if keep_order { n } else { 0 }];
    for (k, part) in parts.into_iter().enumerate() {
        let (coded, order) = part?;
        for &i in &order {
            match seen.get_mut(i as usize) {
                Some(seen) if !*seen => *seen = true,
                _ => return Err(corrupt("index of a Gaussian", i.into())),
            }
        }
        for (row, values) in coded.bits.chunks_exact(columns).enumerate() {
            let i = order.get(row).map_or(bounds[k] + row, |&i| i as usize);
            layout::scatter(&mut scene, i, values);
        }
    }
    Ok(scene)
}

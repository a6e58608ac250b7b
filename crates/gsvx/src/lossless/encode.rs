//! The encoder of the bit-exact mode.

use super::column::{Cell, Map};
use super::fit::{self, Sample};
use super::layout::{self, MEANS};
use super::means::Means;
use super::neighbours::{self, NearRows};
use super::{
    Column, MAX_PART, MORTON_ORDER, OWN_ORDER, PartBits, RAW, column, index_bits, part_bounds, rows,
};
use crate::bytes::Writer;
use gpcc_lite::coder::{Coder, RansEncoder};
use gs_model::Scene;
use rayon::prelude::*;

/// A value this frequent (one in so many) gets a flag of its own.
const COMMON: usize = 256;

/// The payload of a scene's Gaussians, bit for bit, and the order in which they come back: their own, at
/// `ceil(log2 N)` bits each if they are coded, or the Morton order of their means. Few Gaussians are stored as
/// they are. Values need not be valid: NaN, infinities and zero quaternions are kept.
pub(crate) fn encode_payload(scene: &Scene, keep_order: bool) -> (Vec<u8>, Vec<u32>) {
    let (coded, order) = encode_columns(scene, keep_order);
    let own: Vec<u32> = (0..scene.len() as u32).collect();
    if coded.len() <= 4 * own.len() * layout::columns(scene.sh_degree) {
        return (coded, if keep_order { own } else { order });
    }
    let mut raw = vec![RAW];
    raw.extend(layout::gather_rows(scene, &own).iter().flat_map(|v| v.to_le_bytes()));
    (raw, own)
}

/// The coded payload, and the Gaussians in Morton order.
fn encode_columns(scene: &Scene, keep_order: bool) -> (Vec<u8>, Vec<u32>) {
    let n = scene.len();
    let MortonOrder { column, least, below, order } = morton_order(scene);
    let count = n.div_ceil(MAX_PART);
    let bounds = part_bounds(n, count);
    let parts: Vec<&[u32]> = bounds.windows(2).map(|w| &order[w[0]..w[1]]).collect();
    let mut columns = choose_columns(scene, &order, &column);
    let (near, sample) = neighbours_and_sample(scene, &parts, &columns);
    fit_columns(&mut columns, &sample);
    drop(sample);

    let mut w = Writer::default();
    w.u8(if keep_order { OWN_ORDER } else { MORTON_ORDER });
    w.varint(count as u64);
    w.u8(below as u8);
    for v in least {
        w.varint((v + column::CELLS) as u64);
    }
    for (c, column) in columns.iter().enumerate().filter(|&(c, _)| c == 0 || c >= MEANS) {
        write_column(&mut w, c, column);
    }
    let means = Means { column: &columns[0], least, below };
    let index_bits = keep_order.then(|| index_bits(n));
    let jobs = parts.par_iter().zip(&near);
    let coded: Vec<Vec<u8>> = jobs
        .map(|(part, near)| {
            let mut coder = encode_part(scene, part, &means, &columns, near);
            if let Some(width) = index_bits {
                for &i in *part {
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
    (w.bytes, order)
}

/// The order in which Gaussians are coded.
struct MortonOrder {
    /// The grid of the means.
    column: Column,
    /// Least cell index per axis.
    least: [i32; 3],
    /// Bits of a coordinate below the Morton code's 21.
    below: u32,
    /// The Gaussians in the order of the Morton codes of their means.
    order: Vec<u32>,
}

fn morton_order(scene: &Scene) -> MortonOrder {
    let n = scene.len();
    let identity: Vec<u32> = (0..n as u32).collect();
    let means: Vec<Vec<u32>> = (0..MEANS).map(|c| layout::gather(scene, c, &identity)).collect();
    let all = means.concat();
    let grid = Map::grid(&all);
    let escapes = grid.has_escapes(&all);
    drop(all);
    let column =
        Column { map: grid, predictor: Default::default(), centre: 0, common: None, escapes };
    let cell = |a: usize, i: usize| column.map.stand_in(means[a][i]);
    let cells: Vec<[i32; 3]> = (0..n).map(|i| std::array::from_fn(|a| cell(a, i))).collect();
    drop(means);
    let least: [i32; 3] =
        std::array::from_fn(|a| cells.iter().map(|q| q[a]).min().unwrap_or_default());
    let span = (0..3)
        .flat_map(|a| cells.iter().map(move |q| (q[a] - least[a]) as u32))
        .max()
        .unwrap_or_default();
    let below = (32 - span.leading_zeros()).saturating_sub(21);
    let code = Means { column: &column, least, below };
    let mut order: Vec<(u64, u32)> =
        cells.iter().enumerate().map(|(i, &q)| (code.key(q), i as u32)).collect();
    drop(cells);
    order.par_sort_unstable();
    let order: Vec<u32> = order.into_iter().map(|(_, i)| i).collect();
    MortonOrder { column, least, below, order }
}

/// How each column is coded, but for its predictor. The means share a grid.
fn choose_columns(scene: &Scene, order: &[u32], means: &Column) -> Vec<Column> {
    let columns = (0..layout::columns(scene.sh_degree)).into_par_iter();
    let choose = |c| {
        if c < MEANS {
            return means.clone();
        }
        let values = layout::gather(scene, c, order);
        let map = Map::choose(&values);
        let escapes = map.has_escapes(&values);
        let common = common_value(&values);
        Column { map, predictor: Default::default(), centre: 0, common, escapes }
    };
    columns.map(choose).collect()
}

/// The neighbours of all Gaussians, part by part, and those Gaussians that predictors are fitted to.
/// Rows are gathered here and again when they are coded: all of them are as large as the scene.
fn neighbours_and_sample(
    scene: &Scene,
    parts: &[&[u32]],
    columns: &[Column],
) -> (Vec<NearRows>, Sample) {
    let stride = fit::stride(scene.len());
    let width = columns.len();
    let of_part = |order: &&[u32]| {
        let stand_in = |c: usize, v: u32| columns[c].map.stand_in(v);
        let mean =
            |a: usize| layout::gather(scene, a, order).iter().map(|&v| stand_in(a, v)).collect();
        let near = neighbours::find(&(0..MEANS).map(mean).collect::<Vec<_>>());
        let mut sample = Sample::new(width);
        for i in (stride / 2..order.len()).step_by(stride) {
            let rows: Vec<u32> =
                std::iter::once(i as u32).chain(near[i]).map(|j| order[j as usize]).collect();
            let bits = layout::gather_rows(scene, &rows);
            let cells = bits.iter().enumerate().map(|(at, &v)| stand_in(at % width, v));
            sample.push(&bits[..width], cells);
        }
        (near, sample)
    };
    let of_parts: Vec<_> = parts.par_iter().map(of_part).collect();
    let mut near = Vec::with_capacity(parts.len());
    let mut sample = Sample::new(width);
    for (neighbours, part) in of_parts {
        near.push(neighbours);
        sample.append(part);
    }
    (near, sample)
}

/// Fits the predictors of all columns but the means.
fn fit_columns(columns: &mut [Column], sample: &Sample) {
    let fitted: Vec<_> = (MEANS..columns.len())
        .into_par_iter()
        .map(|c| {
            let Column { common, escapes, ref map, .. } = columns[c];
            let skip = |v: u32| {
                common == Some(v) || (escapes && matches!(map.split(v), Cell::Escape { .. }))
            };
            fit::fit(sample, c, skip)
        })
        .collect();
    for (column, (predictor, centre)) in columns[MEANS..].iter_mut().zip(fitted) {
        column.predictor = predictor;
        column.centre = centre;
    }
}

/// Codes one part.
fn encode_part(
    scene: &Scene,
    order: &[u32],
    means: &Means<'_>,
    columns: &[Column],
    near: &NearRows,
) -> RansEncoder {
    let bits = layout::gather_rows(scene, order);
    let mut coder = RansEncoder::default();
    let mut coded = PartBits { bits: vec![0; bits.len()], ..Default::default() };
    means.code(&mut coder, &mut coded, order.len(), columns.len(), &bits);
    rows::code(&mut coder, columns, near, &bits, &mut coded);
    coder
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

fn write_column(w: &mut Writer, c: usize, column: &Column) {
    column.map.write(w);
    w.u8(u8::from(column.escapes) | u8::from(column.common.is_some()) << 1);
    if let Some(v) = column.common {
        w.u32(v);
    }
    if c >= MEANS {
        w.u8(column.centre);
        column.predictor.write(w);
    }
}

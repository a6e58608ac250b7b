//! What moves in a chunk: values over time, on the octree of the leaves that move.
//!
//! A value of leaf `i` in frame `t` is that of the static stream and a sum of *curves*, functions of time that the
//! leaves of the chunk share, each times a coefficient of the leaf. The coefficients of a curve are an attribute like
//! any other.

use crate::bytes::SliceReader;
use crate::chunk::{Attribute, ChunkValues, Group, MOVING, coefficients, steps_of};
use crate::error::{Error, Result, coding};
use crate::head::Steps;
use crate::importance;
use gpcc_lite::coder::{Coder, RansDecoder};
use gpcc_lite::model::Bit;
use gpcc_lite::raht::{RahtPlan, Rows};
use gpcc_lite::{Octree, attribute};
use gs_model::{Scene, SceneMut};

/// A curve of this many units is 1.
pub(crate) const UNIT: f32 = 2048.0;
/// In the flags of a chunk: some Gaussians are not there in every frame.
pub(crate) const BIRTHS: u8 = 1 << 7;
/// Memory of the models of flags, in observations.
const LIMIT: u32 = 255;
/// Greatest factor of a prediction.
pub(crate) const GREATEST: f32 = 1e6;

/// What moves in a chunk.
#[derive(Debug, Default)]
pub(crate) struct Motion {
    /// The chunk's first Gaussian in the scene.
    first: usize,
    frames: usize,
    moving: Vec<MovingAttribute>,
    /// Whether each Gaussian is there, frame by frame; empty if all always are.
    alive: Vec<bool>,
}

/// An attribute that moves.
#[derive(Debug)]
struct MovingAttribute {
    group: &'static Group,
    /// The leaves that move.
    leaves: Vec<u32>,
    /// Their values in the static stream.
    base: Rows,
    curves: Vec<Curve>,
    /// By curve.
    coefficients: Vec<Rows>,
}

/// A function of time, and what predicts its coefficients.
#[derive(Debug, Default, PartialEq)]
pub(crate) struct Curve {
    /// By frame, in 1 / [`UNIT`].
    pub(crate) values: Vec<i16>,
    /// A square matrix that takes values of the static stream to coefficients; empty for zeros.
    pub(crate) factors: Vec<f32>,
}

impl Curve {
    /// Its value in a frame.
    pub(crate) fn at(&self, frame: usize) -> f32 {
        f32::from(self.values[frame]) / UNIT
    }

    /// Adds `sign` times the prediction to the coefficients of a leaf.
    pub(crate) fn predict(&self, base: &[f32], sign: f32, row: &mut [f32]) {
        for (v, factors) in row.iter_mut().zip(self.factors.chunks_exact(base.len())) {
            let sum = factors.iter().zip(base).fold(0.0, |sum, (f, x)| sum + f * x);
            *v += sign * sum;
        }
    }
}

/// Values of some leaves in the static stream.
pub(crate) fn base_of(values: &ChunkValues, number: usize, leaves: &[u32]) -> Rows {
    let mut base = Rows::new(leaves.len(), MOVING[number].channels);
    for (to, &i) in leaves.iter().enumerate() {
        let row = base.row_mut(to);
        match MOVING[number].attribute {
            Attribute::Position => row.copy_from_slice(&values.octree().centre(i as usize)),
            // The groups of a chunk follow the position.
            _ => row.copy_from_slice(values.row(number - 1, i as usize)),
        }
    }
    base
}

/// The transform of some leaves of a chunk.
pub(crate) fn plan_of(values: &ChunkValues, leaves: &[u32]) -> Result<RahtPlan> {
    let octree = values.octree();
    let some = leaves.iter().map(|&i| octree.leaves()[i as usize]).collect();
    let some = Octree::new(octree.cube(), octree.depth(), some).map_err(coding("motion"))?;
    let weight = |&i: &u32| importance::weight(values.classes()[i as usize]);
    let weights: Vec<u32> = leaves.iter().map(weight).collect();
    RahtPlan::new(some).weighted(&weights).map_err(coding("motion"))
}

/// Codes one flag per leaf, by the two before it.
pub(crate) fn code_flags<C: Coder>(coder: &mut C, flags: &mut [bool]) {
    let (mut models, mut state) = ([Bit::default(); 4], 0);
    for flag in flags {
        *flag = models[state].code(coder, *flag, LIMIT);
        state = (2 * state + usize::from(*flag)) & 3;
    }
}

/// Codes whether each leaf is there in each frame: a flag for leaves that always are, else one per frame, by that of
/// the frame before.
pub(crate) fn code_alive<C: Coder>(coder: &mut C, frames: usize, alive: &mut [bool]) {
    let mut models = [Bit::default(); 4];
    for leaf in alive.chunks_exact_mut(frames) {
        if models[0].code(coder, leaf.iter().all(|&v| v), LIMIT) {
            leaf.fill(true);
            continue;
        }
        let mut state = 1;
        for flag in leaf {
            *flag = models[state].code(coder, *flag, LIMIT);
            state = 2 + usize::from(*flag);
        }
    }
}

/// The leaves whose flag is set.
pub(crate) fn flagged(flags: &[bool]) -> Vec<u32> {
    (0..).zip(flags).filter(|(_, flag)| **flag).map(|(i, _)| i).collect()
}

/// The step and the curves of an attribute that moves.
fn read_curves(group: &Group, frames: usize, r: &mut SliceReader<'_>) -> Result<(f32, Vec<Curve>)> {
    let step = r.f32()?;
    if !Steps::is_valid(step) {
        return Err(Error::Corrupt { what: "step of a motion", value: step.to_bits().into() });
    }
    let number = usize::from(r.u8()?) + 1;
    if number > frames {
        return Err(Error::Corrupt { what: "number of curves", value: number as u64 });
    }
    let mut curve = || {
        let values = r.take(2 * frames)?.as_chunks::<2>().0;
        let values = values.iter().map(|&v| i16::from_le_bytes(v)).collect();
        let wanted = if r.u8()? == 0 { 0 } else { group.channels * group.channels };
        let factors = (0..wanted).map(|_| r.finite_f32("factor of a motion"));
        let factors = factors.collect::<Result<Vec<f32>>>()?;
        match factors.iter().find(|f| f.abs() > GREATEST) {
            Some(f) => {
                Err(Error::Corrupt { what: "factor of a motion", value: f.to_bits().into() })
            }
            None => Ok(Curve { values, factors }),
        }
    };
    let curves = (0..number).map(|_| curve()).collect::<Result<_>>()?;
    Ok((step, curves))
}

impl Motion {
    /// Decodes what moves in a chunk of a group of so many frames; `values` are those of its static stream, `first` the
    /// number of its first Gaussian. What the motion takes in memory is subtracted from `room`, bytes.
    ///
    /// # Errors
    /// [`Error::Truncated`], [`Error::Corrupt`], [`Error::Coding`] and [`Error::Memory`].
    pub(crate) fn decode(
        bytes: &[u8],
        values: &ChunkValues,
        first: usize,
        frames: usize,
        room: &mut u64,
    ) -> Result<Self> {
        let leaves = values.octree().len();
        let mut motion = Self { first, frames, ..Self::default() };
        if bytes.is_empty() {
            return Ok(motion);
        }
        let mut r = SliceReader::new(bytes, "motion");
        let flags = r.u8()?;
        let known = values.groups() + 1;
        if (flags & !BIRTHS) >> known != 0 {
            return Err(Error::Corrupt { what: "attributes that move", value: flags.into() });
        }
        let moving = (0..known).filter(|a| flags >> a & 1 == 1);
        let heads = moving.map(|a| Ok((a, read_curves(&MOVING[a], frames, &mut r)?)));
        let heads = heads.collect::<Result<Vec<_>>>()?;
        let mut coder = RansDecoder::new(r.take(r.remaining())?).map_err(coding("motion"))?;
        let mut take = |count: usize, bytes: usize| {
            *room = room.checked_sub(count as u64 * bytes as u64)?;
            Some(())
        };
        let too_large = || Error::memory(leaves);
        if flags & BIRTHS != 0 {
            take(leaves, frames).ok_or_else(too_large)?;
            motion.alive = vec![false; leaves * frames];
            code_alive(&mut coder, frames, &mut motion.alive);
        }
        for (number, (step, curves)) in heads {
            let group = &MOVING[number];
            let mut flags = vec![false; leaves];
            code_flags(&mut coder, &mut flags);
            let leaves = flagged(&flags);
            take(leaves.len(), 4 * (curves.len() + 1) * (group.channels + 3))
                .ok_or_else(too_large)?;
            let (plan, base) = (plan_of(values, &leaves)?, base_of(values, number, &leaves));
            let steps = steps_of(step, group.channels);
            let mut coefficients = Vec::with_capacity(curves.len());
            for curve in &curves {
                let mut rows = Rows::new(leaves.len(), group.channels);
                attribute::decode(&mut coder, &plan, &steps, &mut rows)
                    .map_err(coding("motion"))?;
                (0..leaves.len()).for_each(|i| curve.predict(base.row(i), 1.0, rows.row_mut(i)));
                coefficients.push(rows);
            }
            motion.moving.push(MovingAttribute { group, leaves, base, curves, coefficients });
        }
        coder.finish().map_err(coding("motion"))?;
        Ok(motion)
    }

    /// Moves the Gaussians of the chunk in a scene without motion to where they are in a frame.
    pub(crate) fn apply(&self, frame: usize, scene: &mut Scene) {
        for MovingAttribute { group, leaves, base, curves, coefficients } in &self.moving {
            let mut rows = base.clone();
            for (curve, coefficients) in curves.iter().zip(coefficients) {
                rows.add(curve.at(frame), coefficients);
            }
            let mut moved = Scene::zeros(leaves.len(), scene.sh_degree);
            group.restore(&rows, 0, &mut SceneMut::of(&mut moved));
            for (from, &leaf) in leaves.iter().enumerate() {
                put(group.attribute, &moved, from, scene, self.first + leaf as usize);
            }
        }
    }

    /// Leaves only the leaves that are not alike in all frames, the first of them at `first`. Returns where they were.
    pub(crate) fn alone(&mut self, first: usize) -> Vec<usize> {
        let alive = self.alive.chunks_exact(self.frames);
        let mut leaves: Vec<u32> = flagged(&alive.map(|a| a.contains(&false)).collect::<Vec<_>>());
        leaves.extend(self.moving.iter().flat_map(|moving| &moving.leaves));
        leaves.sort_unstable();
        leaves.dedup();
        for leaf in self.moving.iter_mut().flat_map(|moving| &mut moving.leaves) {
            *leaf = leaves.partition_point(|other| other < leaf) as u32;
        }
        if !self.alive.is_empty() {
            let alive = |&i: &u32| &self.alive[i as usize * self.frames..][..self.frames];
            self.alive = leaves.iter().flat_map(alive).copied().collect();
        }
        let before = std::mem::replace(&mut self.first, first);
        leaves.iter().map(|&i| before + i as usize).collect()
    }

    /// Highest SH degree that moves.
    pub(crate) fn sh_degree(&self) -> u8 {
        let degree = |moving: &MovingAttribute| match moving.group.attribute {
            Attribute::Colour { degree } => degree,
            _ => 0,
        };
        self.moving.iter().map(degree).max().unwrap_or(0)
    }

    /// Sets which Gaussians of the scene are there in a frame, as far as they are the chunk's.
    pub(crate) fn mark(&self, frame: usize, alive: &mut [bool]) {
        let own = alive[self.first..].iter_mut().zip(self.alive.chunks_exact(self.frames));
        own.for_each(|(alive, leaf)| *alive = leaf[frame]);
    }
}

/// Copies an attribute of a Gaussian.
pub(crate) fn put(attribute: Attribute, from: &Scene, i: usize, to: &mut Scene, j: usize) {
    match attribute {
        Attribute::Position => to.means[j] = from.means[i],
        Attribute::Opacity => to.opacity_logits[j] = from.opacity_logits[i],
        Attribute::Colour { degree } => {
            let (own, len) = (coefficients(degree), to.sh_len());
            let at = |n: usize| n * len + own.start..n * len + own.end;
            to.sh[at(j)].copy_from_slice(&from.sh[at(i)]);
        }
        Attribute::Covariance => {
            to.rotations[j] = from.rotations[i];
            to.log_scales[j] = from.log_scales[i];
        }
    }
}

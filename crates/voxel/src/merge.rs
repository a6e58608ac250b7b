//! [`merge`]: one Gaussian per leaf.

mod moments;
mod paper;
mod sh;

pub use sh::{merge_sh, merge_up_to};

use gs_model::Scene;
use multiversion::multiversion;
use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::importance::Importance;
use crate::voxelize::Voxelization;

/// How the members of a leaf become one Gaussian.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub enum Merge {
    /// Paper section 3.3: plain averages of the SH coefficients and of the opacities (after
    /// the sigmoid); scale and rotation of the member of the largest volume.
    Paper,
    /// Averages weighted by opacity times area; covariance matched in second moments,
    /// including the scatter of the means; opacity that conserves transmittance.
    #[default]
    Moments,
}

/// Everything of a merged Gaussian but its mean and its SH coefficients.
struct Shape {
    rotation: [f32; 4],
    log_scale: [f32; 3],
    opacity_logit: f32,
}

/// Merges the members of every leaf into one Gaussian at the leaf's centre, in leaf order.
///
/// A leaf of one member keeps every attribute of it bit for bit, except the mean, which
/// becomes `cube.leaf_centre(leaf, j_high)` under either rule. The result does not depend on
/// the number of threads. Non-finite attributes spread into their leaf only.
///
/// # Errors
/// [`Error::Member`] if `voxelization` is not of this scene.
pub fn merge(scene: &Scene, voxelization: &Voxelization, rule: Merge) -> Result<Scene> {
    merge_weighted(scene, voxelization, rule, &Importance::OpacityArea)
}

/// As [`merge`], with [`Merge::Moments`] weighting members by `importance` (the rasterizer's
/// saliency knows what is hidden) instead of opacity times area. [`Merge::Paper`] ignores it.
///
/// # Errors
/// As [`merge`]; [`Error::Length`] if `importance` does not fit the scene.
pub fn merge_weighted(
    scene: &Scene,
    voxelization: &Voxelization,
    rule: Merge,
    importance: &Importance,
) -> Result<Scene> {
    let mut out = Scene::default();
    merge_into(scene, voxelization, rule, importance, &mut out)?;
    Ok(out)
}

/// As [`merge_weighted`], into a scene whose memory is used again: with millions of Gaussians
/// the first touch of new memory is a large part of the time. For searches that merge one scene
/// many times. After an error `out` is unchanged.
///
/// # Errors
/// As [`merge_weighted`].
pub fn merge_into(
    scene: &Scene,
    voxelization: &Voxelization,
    rule: Merge,
    importance: &Importance,
    out: &mut Scene,
) -> Result<()> {
    merge_to_degree(scene, voxelization, rule, importance, scene.sh_degree, out)
}

/// As [`merge_into`], of SH coefficients up to `degree`, which the scene has.
fn merge_to_degree(
    scene: &Scene,
    voxelization: &Voxelization,
    rule: Merge,
    importance: &Importance,
    degree: u8,
    out: &mut Scene,
) -> Result<()> {
    check_members(scene, voxelization, importance)?;
    let len = voxelization.len();
    let sh_len = gs_model::sh_len(degree);
    out.sh_degree = degree;
    room_for(&mut out.means, len);
    room_for(&mut out.rotations, len);
    room_for(&mut out.log_scales, len);
    room_for(&mut out.opacity_logits, len);
    room_for(&mut out.sh, len * sh_len);
    out.means.par_chunks_mut(BATCH).enumerate().for_each(|(batch, means)| {
        for (i, mean) in means.iter_mut().enumerate() {
            *mean = voxelization.centre(batch * BATCH + i);
        }
    });
    out.rotations
        .par_chunks_mut(BATCH)
        .zip(out.log_scales.par_chunks_mut(BATCH))
        .zip(out.opacity_logits.par_chunks_mut(BATCH))
        .zip(out.sh.par_chunks_mut(BATCH * sh_len))
        .enumerate()
        .for_each_init(
            Scratch::default,
            |scratch, (batch, (((rotations, scales), logits), sh))| {
                let first = batch * BATCH;
                let out = Batch { rotations, log_scales: scales, opacity_logits: logits, sh };
                fill(out, scene, voxelization, first, rule, importance, scratch);
            },
        );
    Ok(())
}

/// Refuses importances and members that are not of this scene.
fn check_members(
    scene: &Scene,
    voxelization: &Voxelization,
    importance: &Importance,
) -> Result<()> {
    importance.validate(scene)?;
    let outside = voxelization.members.par_iter().find_first(|&&m| m as usize >= scene.len());
    match outside {
        Some(&member) => Err(Error::Member { member, len: scene.len() }),
        None => Ok(()),
    }
}

/// Makes `list` that long; what is in it does not matter.
fn room_for<T: Clone + Default>(list: &mut Vec<T>, len: usize) {
    if list.capacity() < len {
        // Zeroed pages of the system, first touched by the threads that fill them.
        *list = vec![T::default(); len];
    } else {
        list.resize(len, T::default());
    }
}

/// Leaves that are merged together. Fixed, and few enough that what is read of the octree
/// stays in the first-level cache from attribute to attribute.
const BATCH: usize = 1024;

/// The attributes of some leaves.
struct Batch<'a> {
    rotations: &'a mut [[f32; 4]],
    log_scales: &'a mut [[f32; 3]],
    opacity_logits: &'a mut [f32],
    sh: &'a mut [[f32; 3]],
}

/// What a thread keeps from batch to batch, to allocate it once.
#[derive(Default)]
struct Scratch {
    /// Leaves of more than one member, counted from the first of the batch.
    shared: Vec<usize>,
    /// Members of these, one leaf after the other.
    members: Vec<u32>,
    /// ... their weights,
    weights: Vec<f64>,
    /// ... and, for [`Merge::Moments`], their shapes.
    looks: Vec<moments::Look>,
}

impl Scratch {
    /// Finds the leaves that have more than one member, and what their members count. Of members
    /// whose shapes nobody needs, only weights are computed.
    #[inline(always)]
    fn find(
        &mut self,
        scene: &Scene,
        batch: &Members<'_>,
        rule: Merge,
        importance: &Importance,
        shapes: bool,
    ) {
        let Self { shared, members, weights, looks } = self;
        shared.clear();
        shared.extend((0..batch.len()).filter(|&i| batch.of(i).len() > 1));
        members.clear();
        shared.iter().for_each(|&i| members.extend_from_slice(batch.of(i)));
        weights.clear();
        if rule == Merge::Paper {
            weights.resize(members.len(), 1.0);
            return;
        }
        if shapes || matches!(importance, Importance::OpacityArea) {
            moments::look(scene, members, looks);
        }
        match importance {
            Importance::OpacityArea => {
                weights.extend(looks.iter().map(|look| look.opacity * look.area));
            }
            Importance::Given(given) => {
                weights.extend(members.iter().map(|&m| f64::from(given[m as usize])));
            }
        }
        let mut rest = weights.as_mut_slice();
        for &i in &*shared {
            let (own, others) = rest.split_at_mut(batch.of(i).len());
            moments::normalise(own);
            rest = others;
        }
    }
}

/// The members of the leaves of a batch.
struct Members<'a> {
    offsets: &'a [u32],
    members: &'a [u32],
}

impl<'a> Members<'a> {
    /// Those of the `len` leaves from `first` on.
    fn new(voxelization: &'a Voxelization, first: usize, len: usize) -> Self {
        let offsets = &voxelization.member_offsets[first..=first + len];
        Self { offsets, members: &voxelization.members }
    }

    fn len(&self) -> usize {
        self.offsets.len() - 1
    }

    #[inline(always)]
    fn of(&self, i: usize) -> &'a [u32] {
        &self.members[self.offsets[i] as usize..self.offsets[i + 1] as usize]
    }

    /// The first member of leaf `i`.
    #[inline(always)]
    fn first(&self, i: usize) -> usize {
        self.members[self.offsets[i] as usize] as usize
    }
}

/// Merges the leaves from `first` on.
///
/// Attribute by attribute, in loops that do little: members lie all over the scene, and
/// only then do the cache misses of many leaves overlap.
#[multiversion(targets("x86_64+avx2"))]
fn fill(
    out: Batch<'_>,
    scene: &Scene,
    voxelization: &Voxelization,
    first: usize,
    rule: Merge,
    importance: &Importance,
    scratch: &mut Scratch,
) {
    let len = out.rotations.len();
    let batch = Members::new(voxelization, first, len);
    let sh_len = out.sh.len() / len;
    // Every leaf as if its first member were the only one.
    sh::copy(scene, &batch, 0..sh_len, out.sh);
    for (i, rotation) in out.rotations.iter_mut().enumerate() {
        *rotation = scene.rotations[batch.first(i)];
    }
    for (i, log_scale) in out.log_scales.iter_mut().enumerate() {
        *log_scale = scene.log_scales[batch.first(i)];
    }
    for (i, logit) in out.opacity_logits.iter_mut().enumerate() {
        *logit = scene.opacity_logits[batch.first(i)];
    }
    // Then those that have more.
    scratch.find(scene, &batch, rule, importance, true);
    sh::average_shared(scene, &batch, scratch, 0..sh_len, out.sh);
    let Scratch { shared, members, weights, looks } = scratch;
    let mut put = |i: usize, shape: Shape| {
        out.rotations[i] = shape.rotation;
        out.log_scales[i] = shape.log_scale;
        out.opacity_logits[i] = shape.opacity_logit;
    };
    let mut start = 0;
    // Some leaves at a time, because of the latencies of roots and quotients.
    let mut shapes = moments::Shapes::default();
    let mut finished = shared.iter();
    for &i in &*shared {
        let range = start..start + batch.of(i).len();
        start = range.end;
        match rule {
            Merge::Paper => put(i, paper::shape(scene, &members[range])),
            Merge::Moments => {
                if shapes.push(&looks[range.clone()], &weights[range]) {
                    shapes.finish(&mut finished, &mut put);
                }
            }
        }
    }
    shapes.finish(&mut finished, &mut put);
}

impl Shape {
    fn of(scene: &Scene, i: usize) -> Self {
        Self {
            rotation: scene.rotations[i],
            log_scale: scene.log_scales[i],
            opacity_logit: scene.opacity_logits[i],
        }
    }
}

/// Keeps a computed logit inside the range of the members' logits, where every average of
/// opacities lies; also catches the overflow of the logit at opacities that round to 1.
fn clamp_logit(scene: &Scene, members: &[u32], logit: f64) -> f32 {
    let logits = members.iter().map(|&i| scene.opacity_logits[i as usize]);
    let (low, high) =
        logits.fold((f32::INFINITY, f32::NEG_INFINITY), |(l, h), x| (l.min(x), h.max(x)));
    (logit as f32).max(low).min(high)
}

//! [`merge`] and [`Merging`]: one Gaussian per leaf (the paper's section 3.3).
//!
//! *Invariant:* a leaf of one member keeps every attribute bit for bit, except the mean, which is
//! the leaf's centre. Leaves are merged in batches of fixed size, so no result depends on the
//! number of threads.

mod moments;
mod paper;
mod sh;

use gs_model::{Scene, SceneMut};
use multiversion::multiversion;
use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::importance::Importance;
use crate::voxelization::Voxelization;

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

/// Where the merged Gaussian of a leaf is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Place {
    /// At the leaf's centre, which is what a stream codes.
    #[default]
    LeafCentre,
    /// At the weighted mean of the members' means. A leaf of one member keeps its mean.
    MemberMean,
}

/// The attributes of a merged Gaussian, except its mean and its SH coefficients.
struct Shape {
    rotation: [f32; 4],
    log_scale: [f32; 3],
    opacity_logit: f32,
}

/// Merges the members of every leaf into one Gaussian at the leaf's centre, in leaf order. With
/// [`Merge::Moments`], members weigh opacity times area; [`Merging`] has other weights.
///
/// # Errors
/// [`Error::Member`] if `voxelization` is not of this scene.
pub fn merge(scene: &Scene, voxelization: &Voxelization, rule: Merge) -> Result<Scene> {
    Ok(Merging::new(scene, voxelization, rule, &Importance::OpacityArea)?.scene())
}

/// A scene whose leaves can be merged, all at once or attribute by attribute.
///
/// A leaf of one member keeps every attribute of it bit for bit, except the mean, which
/// becomes the centre of its leaf under either rule. The result does not depend on
/// the number of threads. Non-finite attributes spread into their leaf only.
#[derive(Clone, Copy)]
pub struct Merging<'a> {
    scene: &'a Scene,
    voxelization: &'a Voxelization,
    rule: Merge,
    importance: &'a Importance,
    place: Place,
}

impl<'a> Merging<'a> {
    /// [`Merge::Moments`] weights members by `importance`; [`Merge::Paper`] ignores it.
    ///
    /// It does not look at Gaussians that are in no leaf: a scene may be merged in many parts.
    ///
    /// # Errors
    /// [`Error::Member`] if `voxelization` is not of this scene; [`Error::Length`] and
    /// [`Error::Parameter`] if `importance` does not fit it.
    pub fn new(
        scene: &'a Scene,
        voxelization: &'a Voxelization,
        rule: Merge,
        importance: &'a Importance,
    ) -> Result<Self> {
        let members = &voxelization.members;
        let outside = members.par_iter().find_first(|&&m| m as usize >= scene.len());
        if let Some(&member) = outside {
            return Err(Error::Member { member, len: scene.len() });
        }
        importance.check_members(scene, members)?;
        Ok(Self { scene, voxelization, rule, importance, place: Place::LeafCentre })
    }

    /// The same with the merged Gaussians at another place.
    #[must_use]
    pub fn at(self, place: Place) -> Self {
        Self { place, ..self }
    }

    /// The merged Gaussians.
    #[must_use]
    pub fn scene(&self) -> Scene {
        self.up_to(self.scene.sh_degree)
    }

    /// As [`Self::scene`], of SH coefficients up to `degree` only: the same bits as if the scene had
    /// no others.
    #[must_use]
    pub fn up_to(&self, degree: u8) -> Scene {
        let sh_degree = degree.min(self.scene.sh_degree);
        let &Scene { antialiased, origin, .. } = self.scene;
        let zeros = Scene::zeros(self.voxelization.len(), sh_degree);
        let mut out = Scene { antialiased, origin, ..zeros };
        let parts = out.par_parts_mut(0..self.voxelization.len(), BATCH);
        parts.for_each_init(Scratch::default, |scratch, (first, out)| {
            fill(out, self, first, scratch)
        });
        out
    }
}

/// Leaves that one thread merges together. Fixed, and few enough that their part of the
/// voxelization stays in the first-level cache from attribute to attribute.
const BATCH: usize = 1024;

/// Memory that a thread allocates once and uses for every batch.
#[derive(Default)]
struct Scratch {
    /// Leaves of more than one member, counted from the first of the batch.
    shared: Vec<usize>,
    /// Members of the shared leaves, one leaf after the other.
    members: Vec<u32>,
    /// Weight of each of `members`.
    weights: Vec<f64>,
    /// For [`Merge::Moments`]: properties of each of `members`.
    properties: Vec<moments::MemberProperties>,
}

impl Scratch {
    /// Finds the leaves that have more than one member, and weighs their members. Properties are
    /// only computed if the weights or (`shapes`) the caller need them.
    #[inline(always)]
    fn find(&mut self, merging: &Merging<'_>, batch: &BatchMembers<'_>, shapes: bool) {
        let Merging { scene, rule, importance, .. } = *merging;
        let Self { shared, members, weights, properties } = self;
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
            moments::read_properties(scene, members, properties);
        }
        match importance {
            Importance::OpacityArea => {
                weights.extend(properties.iter().map(|p| p.opacity * p.area));
            }
            Importance::Given(given) => {
                weights.extend(members.iter().map(|&m| f64::from(given[m as usize])));
            }
        }
        let mut rest = weights.as_mut_slice();
        for &i in &*shared {
            let (leaf, others) = rest.split_at_mut(batch.of(i).len());
            moments::normalise(leaf);
            rest = others;
        }
    }
}

/// The members of the leaves of a batch.
struct BatchMembers<'a> {
    offsets: &'a [u32],
    members: &'a [u32],
}

impl<'a> BatchMembers<'a> {
    /// Of the `len` leaves from `first` on.
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

/// Merges the leaves from `first` on, as many as `out` has.
///
/// The attributes are copied one by one, in loops that do little else: members lie all over the
/// scene, and only then do the cache misses of many leaves overlap.
#[multiversion(targets("x86_64+avx2"))]
fn fill(out: SceneMut<'_>, merging: &Merging<'_>, first: usize, scratch: &mut Scratch) {
    let Merging { scene, voxelization, rule, place, .. } = *merging;
    let batch = BatchMembers::new(voxelization, first, out.len());
    let sh_len = out.sh_len();
    for (i, mean) in out.means.iter_mut().enumerate() {
        *mean = match place {
            Place::LeafCentre => voxelization.octree().centre(first + i),
            Place::MemberMean => scene.means[batch.first(i)],
        };
    }
    // First every leaf as if its first member were the only one.
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
    // Then the leaves that have more members.
    scratch.find(merging, &batch, true);
    sh::average_shared(scene, &batch, scratch, 0..sh_len, out.sh);
    let Scratch { shared, members, weights, properties } = scratch;
    let mut put = |i: usize, shape: Shape| {
        out.rotations[i] = shape.rotation;
        out.log_scales[i] = shape.log_scale;
        out.opacity_logits[i] = shape.opacity_logit;
    };
    let mut start = 0;
    let mut pending = moments::PendingLeaves::default();
    let mut finished = shared.iter();
    for &i in &*shared {
        let range = start..start + batch.of(i).len();
        start = range.end;
        if place == Place::MemberMean {
            out.means[i] = moments::mean(scene, &members[range.clone()], &weights[range.clone()]);
        }
        match rule {
            Merge::Paper => put(i, paper::shape(scene, &members[range])),
            Merge::Moments => {
                if pending.push(&properties[range.clone()], &weights[range]) {
                    pending.finish(&mut finished, &mut put);
                }
            }
        }
    }
    pending.finish(&mut finished, &mut put);
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

/// Clamps a computed logit to the range of the members' logits, in which every average of
/// opacities lies. This also bounds the logit of an opacity that rounds to 1.
fn clamp_logit(scene: &Scene, members: &[u32], logit: f64) -> f32 {
    let logits = members.iter().map(|&i| scene.opacity_logits[i as usize]);
    let (low, high) =
        logits.fold((f32::INFINITY, f32::NEG_INFINITY), |(l, h), x| (l.min(x), h.max(x)));
    (logit as f32).max(low).min(high)
}

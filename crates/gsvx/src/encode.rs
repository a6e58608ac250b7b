//! The encoder.

use crate::attributes::group::{Coding, Transform, UNITS, coding};
use crate::attributes::prediction::Predictor;
use crate::attributes::{colour, opacity};
use crate::covariance;
use crate::error::{Error, Result};
use crate::gaussians::{Gaussians, Own, Values, cut};
use crate::importance;
use crate::options::{CovarianceMode, EncodeOptions, Entropy, PaperQp};
use crate::outliers;
use crate::stream::{self, Header, SectionKind};
use crate::{ordered, slices};
use gpcc_lite::Leaf;
use gpcc_lite::attribute::Rows;
use gs_model::Scene;
use rayon::prelude::*;
use std::borrow::Cow;
use std::mem::take;
use std::ops::Range;
use std::sync::{Arc, Mutex, PoisonError};
use voxel::{Cube, Voxelization};

/// A finished stream and what it is made of.
#[derive(Clone, Debug, Default)]
pub struct Encoded {
    /// The stream.
    pub bytes: Vec<u8>,
    /// Bytes of each section, in stream order; header and table of contents make up the rest.
    pub sections: Vec<(SectionKind, usize)>,
}

/// Encodes a voxelized scene.
///
/// `scene` holds one Gaussian per leaf of `voxels`, in leaf order, each at its leaf's centre
/// (what [`voxel::merge`] returns, or a fine-tuned version of it).
///
/// # Errors
/// [`Error::CountMismatch`], [`Error::OffCentre`] or [`Error::NonFinite`] if the scene does not
/// fit, [`Error::InvalidOutlier`] if an outlier does not; [`Error::Coding`] if the leaves are not
/// a valid pruned octree.
pub fn encode(scene: &Scene, voxels: &Voxelization, options: &EncodeOptions) -> Result<Encoded> {
    if scene.len() != voxels.len() {
        return Err(Error::CountMismatch { scene: scene.len(), leaves: voxels.len() });
    }
    let importance = match &options.importance {
        _ if options.uniform_precision => None,
        Some(given) => Some(Cow::Borrowed(given.as_slice())),
        None => Some(Cow::Owned(importance::without_cameras(scene))),
    };
    let whole = 0..scene.len();
    let degrees = Degrees::of(scene, options)?;
    encode_parts(degrees, voxels, importance, options, |range| {
        if range == whole {
            return Ok(Gaussians::from(Cow::Borrowed(scene)));
        }
        Ok(Gaussians::from(Cow::Owned(part_of(scene, range))))
    })
}

/// What is known of SH degrees before anything is coded, and who has a say in it.
#[derive(Clone, Copy)]
pub(crate) struct Degrees<'a> {
    outliers: Option<&'a Scene>,
    /// The stream's is not lower: the exact coefficients of the outliers are of that degree.
    least: u8,
    /// The highest that is coded.
    pub(crate) most: u8,
}

impl<'a> Degrees<'a> {
    /// `like` has the SH degree of the leaves' Gaussians, and coefficients that are not zero where
    /// theirs are not.
    ///
    /// # Errors
    /// [`Error::InvalidOutlier`] and others for outliers that do not fit.
    pub(crate) fn of(like: &Scene, options: &'a EncodeOptions) -> Result<Self> {
        let outliers = outliers::of(options.outliers.as_ref(), like)?;
        let least = outliers::degree(outliers, options.max_sh_degree);
        let most = used_degree(like, options.max_sh_degree).max(least);
        Ok(Self { outliers, least, most })
    }
}

/// The Gaussians of a range.
fn part_of(scene: &Scene, range: Range<usize>) -> Scene {
    let k = scene.sh_len();
    Scene {
        means: scene.means[range.clone()].to_vec(),
        rotations: scene.rotations[range.clone()].to_vec(),
        log_scales: scene.log_scales[range.clone()].to_vec(),
        opacity_logits: scene.opacity_logits[range.clone()].to_vec(),
        sh_degree: scene.sh_degree,
        sh: scene.sh[range.start * k..range.end * k].to_vec(),
    }
}

/// Encodes leaves whose Gaussians `part` gives, a slice at a time.
pub(crate) fn encode_parts<'a>(
    degrees: Degrees<'_>,
    voxels: &Voxelization,
    importance: Option<Cow<'_, [f32]>>,
    options: &EncodeOptions,
    part: impl Fn(Range<usize>) -> Result<Gaussians<'a>> + Sync,
) -> Result<Encoded> {
    let n = voxels.len();
    let log_classes = log_classes(importance, n)?;
    let slices = slices::count(n, options);
    let entropy = options.entropy.of(n, &options.steps);
    let slice = |i: usize| {
        let range = slices::range(n, slices, i);
        let part = part(range.clone())?;
        let log_classes = log_classes.as_ref().map(|all| Cow::Borrowed(&all[range.clone()]));
        let leaves = Arc::new(voxels.leaves[range.clone()].to_vec());
        let leaves = Leaves { leaves, j_high: voxels.j_high, entropy };
        check(&part, &leaves, &voxels.cube, range.start)?;
        leaves.sections(part, log_classes, degrees.most, options)
    };
    // At most a quarter of the Gaussians at a time, for memory's sake.
    let at_once = (slices / 4).clamp(1, rayon::current_num_threads());
    let mut parts = Vec::with_capacity(slices);
    ordered::in_order(slices, at_once, slice, |sections| -> Result<()> {
        parts.push(sections);
        Ok(())
    })?;
    Ok(finish(parts, degrees, voxels, n))
}

/// As [`encode_parts`], of Gaussians that are gone before the stream is finished: one slice after
/// the other, each of which leaves nothing behind.
pub(crate) fn encode_owned(
    degrees: Degrees<'_>,
    mut voxels: Voxelization,
    importance: Option<Cow<'_, [f32]>>,
    options: &EncodeOptions,
    mut all: Gaussians<'static>,
) -> Result<Encoded> {
    let n = voxels.len();
    let slices = slices::count(n, options);
    let entropy = options.entropy.of(n, &options.steps);
    let mut classes = log_classes(importance, n)?;
    let mut leaves = take(&mut voxels.leaves);
    let mut pieces = Vec::with_capacity(slices);
    // From the last on: what is split off is a copy, and what is left gives its memory back.
    for slice in (0..slices).rev() {
        let at = slices::range(n, slices, slice).start;
        let leaves = Arc::new(cut(&mut leaves, at));
        let leaves = Leaves { leaves, j_high: voxels.j_high, entropy };
        let classes = classes.as_mut().map(|all| Cow::Owned(cut(all, at)));
        pieces.push((at, leaves, classes, all.split_off(at)));
    }
    let mut parts = Vec::with_capacity(slices);
    for (first, leaves, classes, part) in pieces.into_iter().rev() {
        check(&part, &leaves, &voxels.cube, first)?;
        // In the pool from here on: the threads are woken once.
        parts.push(rayon::scope(|_| leaves.sections(part, classes, degrees.most, options))?);
    }
    Ok(finish(parts, degrees, &voxels, n))
}

/// One per leaf, from importances, which are gone then if they can be.
fn log_classes(importance: Option<Cow<'_, [f32]>>, leaves: usize) -> Result<Option<Vec<f64>>> {
    match importance {
        Some(given) if given.len() != leaves => {
            Err(Error::CountMismatch { scene: given.len(), leaves })
        }
        Some(given) => Ok(Some(importance::log_classes(&given))),
        None => Ok(None),
    }
}

/// Puts the sections of all slices together.
fn finish(
    parts: Vec<Vec<Section>>,
    degrees: Degrees<'_>,
    voxels: &Voxelization,
    n: usize,
) -> Encoded {
    let slices = parts.len();
    let Degrees { outliers, least, most: sh_degree } = degrees;
    let mut parts: Vec<_> = parts.into_iter().map(Vec::into_iter).collect();
    let mut sections = Vec::new();
    // Of each section, whether it says nothing.
    let mut zero = Vec::new();
    loop {
        let slices: Vec<Section> = parts.iter_mut().filter_map(Iterator::next).collect();
        let Some(&Section { kind, .. }) = slices.first() else { break };
        zero.push(slices.iter().all(|s| s.all_zero) && n > 0 && kind != SectionKind::Dc);
        sections.push((kind, slices::join(slices.into_iter().map(|s| s.payload).collect())));
    }
    // Degrees at the end that say nothing are left out, and the header's degree falls.
    let least = sections.len() - usize::from(sh_degree - least);
    while zero.len() > least && zero.pop() == Some(true) {
        sections.pop();
    }
    let is_sh = |kind| matches!(kind, SectionKind::Sh1 | SectionKind::Sh2 | SectionKind::Sh3);
    let header = Header {
        count: n as u64,
        slices: slices as u64,
        sh_degree: sections.iter().filter(|(kind, _)| is_sh(*kind)).count() as u8,
        j_high: voxels.j_high,
        cube: voxels.cube,
        colour_space: Default::default(),
        coordinate_system: Default::default(),
    };
    if let Some(outliers) = outliers {
        // Before what a decoder may not ask for.
        let at = sections.iter().position(|(kind, _)| is_sh(*kind)).unwrap_or(sections.len());
        let payload = outliers::encode(outliers, header.sh_degree);
        sections.insert(at, (SectionKind::Outliers, payload));
    }
    let bytes = stream::assemble(&header, &sections);
    let sections = sections.iter().map(|(kind, payload)| (*kind, payload.len())).collect();
    Encoded { bytes, sections }
}

/// The highest degree, up to `most`, with a coefficient that is not zero: what is zero throughout
/// costs nothing, not even its section.
pub(crate) fn used_degree(scene: &Scene, most: u8) -> u8 {
    let mut degree = scene.sh_degree.min(most);
    if scene.is_empty() {
        return degree;
    }
    let zero = |v: &[f32; 3]| v.iter().all(|&x| x == 0.0);
    while degree > 0 {
        let d = usize::from(degree);
        let empty = scene
            .sh
            .par_chunks(scene.sh_len())
            .all(|sh| sh[d * d..(d + 1) * (d + 1)].iter().all(zero));
        if !empty {
            break;
        }
        degree -= 1;
    }
    degree
}

/// A section of one slice.
struct Section {
    kind: SectionKind,
    payload: Vec<u8>,
    /// Every coefficient in it is zero.
    all_zero: bool,
}

/// The leaves of one slice.
pub(crate) struct Leaves {
    pub(crate) leaves: Arc<Vec<Leaf>>,
    pub(crate) j_high: u8,
    /// [Resolved](Entropy::of).
    pub(crate) entropy: Entropy,
}

impl Leaves {
    /// Every section of one slice but the outliers, in stream order.
    fn sections(
        &self,
        part: Gaussians<'_>,
        log_classes: Option<Cow<'_, [f64]>>,
        sh_degree: u8,
        options: &EncodeOptions,
    ) -> Result<Vec<Section>> {
        // Geometry needs nothing of the rest, and the rest nothing of its bytes.
        let (geometry, attributes) = rayon::join(
            || self.geometry(),
            || self.attributes(part, log_classes, sh_degree, options),
        );
        let kind = SectionKind::Geometry;
        let mut sections = vec![Section { kind, payload: geometry?, all_zero: false }];
        sections.extend(attributes?);
        Ok(sections)
    }

    /// How a section's group is coded.
    pub(crate) fn coding(&self, kind: SectionKind, options: &EncodeOptions) -> Coding {
        Coding { entropy: self.entropy, ..options.coding(kind) }
    }

    fn geometry(&self) -> Result<Vec<u8>> {
        let quick = matches!(self.entropy, Entropy::Symbols | Entropy::Fast);
        let coded = if quick {
            gpcc_lite::geometry::encode_fast(&self.leaves, self.j_high)
        } else {
            gpcc_lite::geometry::encode(&self.leaves, self.j_high)
        };
        coded.map_err(coding("geometry"))
    }

    fn attributes(
        &self,
        mut part: Gaussians<'_>,
        log_classes: Option<Cow<'_, [f64]>>,
        sh_degree: u8,
        options: &EncodeOptions,
    ) -> Result<Vec<Section>> {
        // Other modes want whole Gaussians.
        let plain = options.covariance == CovarianceMode::Transform && options.paper_qp.is_none();
        if plain {
            part.forget_means();
        }
        let mut sections = Vec::new();
        let mut transform = Transform::of(self.leaves.clone(), self.j_high)?;
        let mut classes = None;
        if let Some(log_classes) = log_classes {
            let (payload, decoded) = importance::encode_by(&transform, log_classes, self.entropy)?;
            let kind = SectionKind::Importance;
            sections.push(Section { kind, payload, all_zero: false });
            transform = transform.weighted(&decoded)?;
            classes = Some(decoded);
        }
        let mut own = |kind: SectionKind| {
            let apart = plain || kind.sh_coefficients().start > 0;
            (kind, if apart { part.take(kind) } else { None })
        };
        let kinds = [SectionKind::Opacity, SectionKind::Dc, SectionKind::Covariance];
        let mut jobs = kinds.map(|kind| vec![own(kind)]).into_iter().collect::<Vec<_>>();
        let degrees = (1..=sh_degree).map(SectionKind::of_sh_degree).map(own);
        if options.predicts_sh() {
            // Each wants what a decoder will have of the one before.
            jobs.push(degrees.collect());
        } else {
            jobs.extend(degrees.map(|job| vec![job]));
        }
        let (scene, filling) = (&*part.scene, Mutex::new(()));
        let group = Group { scene, leaves: self, transform, classes, options, filling };
        let coded = ordered::in_turn(
            jobs,
            |job| job.first().map(|(kind, _)| turn(*kind, job.len())),
            |job| group.sections(job),
        );
        for coded in coded {
            sections.extend(coded?);
        }
        Ok(sections)
    }
}

/// When the coding of a job of so many sections begins. The rows of the largest groups take the most
/// memory, and are made when the values of others have gone; SH degrees one after another take
/// longest, and are begun first.
fn turn(kind: SectionKind, sections: usize) -> usize {
    match kind {
        _ if sections > 1 => 0,
        SectionKind::Covariance => 1,
        SectionKind::Dc => 2,
        SectionKind::Sh1 => 3,
        SectionKind::Opacity => 4,
        SectionKind::Sh3 => 5,
        _ => 6,
    }
}

/// What the attributes of a slice are coded from.
struct Group<'a> {
    scene: &'a Scene,
    leaves: &'a Leaves,
    transform: Transform,
    /// Importance classes, as decoded.
    classes: Option<Vec<u8>>,
    options: &'a EncodeOptions,
    /// Held by one section of SH coefficients at a time, as long as they are in memory twice.
    filling: Mutex<()>,
}

impl Group<'_> {
    /// These sections, one after another.
    fn sections(&self, job: Vec<(SectionKind, Option<Own>)>) -> Result<Vec<Section>> {
        let mut below = None;
        let count = job.len();
        let mut sections = Vec::with_capacity(count);
        for (i, (kind, own)) in job.into_iter().enumerate() {
            let values = Values { scene: self.scene, own, range: kind.sh_coefficients() };
            sections.push(match kind {
                SectionKind::Opacity => self.opacity(values)?,
                SectionKind::Covariance => {
                    let payload =
                        covariance::encode(values, self.leaves, &self.transform, self.options)?;
                    Section { kind, payload, all_zero: false }
                }
                _ => {
                    let (section, rows) = self.sh((kind, values), below.as_ref(), i + 1 < count)?;
                    below = Some(rows);
                    section
                }
            });
        }
        Ok(sections)
    }

    fn opacity(&self, values: Values<'_>) -> Result<Section> {
        let options = self.options;
        let kind = SectionKind::Opacity;
        let domain = options.opacity_domain;
        let value = |&l: &f32| opacity::forward(domain, l);
        let step = match options.paper_qp {
            Some(qp) => PaperQp::step(qp.opacity, values.opacity_logits().iter().map(value)),
            None => f64::from(options.steps.opacity),
        };
        let mut payload = vec![opacity::code(domain)];
        let leaf = move |i: usize, row: &mut [f64]| row.fill(value(&values.opacity_logits()[i]));
        payload.extend(self.transform.encode(&[step], self.leaves.coding(kind, options), leaf)?.0);
        Ok(Section { kind, payload, all_zero: false })
    }

    /// DC or an SH degree, predicted from the rows `below` if they are there and it pays; with the
    /// rows that a decoder will have of it if they are `wanted`.
    fn sh(
        &self,
        (kind, values): (SectionKind, Values<'_>),
        below: Option<&Rows>,
        wanted: bool,
    ) -> Result<(Section, Rows)> {
        let Self { options, transform, .. } = self;
        let steps = &options.steps;
        let degree = kind.sh_degree();
        let luma = match degree {
            0 => steps.dc,
            _ => steps.sh[usize::from(degree) - 1],
        };
        let range = kind.sh_coefficients();
        let chroma = luma * steps.chroma;
        let value = |i: usize, c: usize| colour::forward_plane(values.sh_of(i)[c / 3], c % 3);
        let qp = options.paper_qp.map(|qp| if kind == SectionKind::Dc { qp.dc } else { qp.ac });
        let steps: Vec<f64> = (0..3 * range.len())
            .map(|c| match qp {
                Some(qp) => PaperQp::step(qp, (0..transform.len()).map(|i| value(i, c))),
                None => f64::from(if c % 3 == 0 { luma } else { chroma }),
            })
            .collect();
        let mut payload = Vec::new();
        let mut predictor = None;
        if degree >= 2 {
            predictor = below.and_then(|below| {
                let steps = [luma, chroma].map(|step| step * UNITS as f32);
                let exact = |i: usize, row: &mut [f32]| {
                    for (out, &c) in row.as_chunks_mut::<3>().0.iter_mut().zip(values.sh_of(i)) {
                        *out = colour::forward(c).map(|v| (v * UNITS) as f32);
                    }
                };
                Some((Predictor::fit(degree, below, self.classes.as_deref(), steps, exact)?, below))
            });
            Predictor::write(predictor.as_ref().map(|(predictor, _)| predictor), &mut payload);
        }
        // A few leaves at a time.
        let mut lower = [0.0; FEW * CHANNELS];
        let mut predicted = [0.0; FEW * CHANNELS];
        let (predictor, leaves) = (predictor.as_ref(), transform.len());
        let filling = self.filling.lock().unwrap_or_else(PoisonError::into_inner);
        let leaf = move |i: usize, row: &mut [f64]| {
            let _until_rows_are_filled = &filling;
            for (out, &c) in row.as_chunks_mut::<3>().0.iter_mut().zip(values.sh_of(i)) {
                *out = colour::forward(c);
            }
            if let Some((predictor, below)) = predictor {
                if i.is_multiple_of(FEW) {
                    let lower = &mut lower[..FEW * below.channels()];
                    below.copy(i, lower);
                    predicted.fill(0.0);
                    let leaves = FEW.min(leaves - i);
                    predictor.add(i, lower, &mut predicted[..leaves * row.len()]);
                }
                let predicted = &predicted[i % FEW * row.len()..];
                for (v, p) in row.iter_mut().zip(predicted) {
                    *v -= f64::from(*p) * (1.0 / UNITS);
                }
            }
        };
        let mut coded =
            transform.encode_rows(&steps, self.leaves.coding(kind, options), wanted, leaf)?;
        payload.extend(coded.bytes);
        if let (Some((predictor, below)), true) = (predictor, wanted) {
            coded.reconstruction.change(|first, values| {
                let lower = &mut lower[..values.len() / (3 * range.len()) * below.channels()];
                below.copy(first, lower);
                predictor.add(first, lower, values);
            });
        }
        let all_zero = coded.all_zero && predictor.is_none();
        Ok((Section { kind, payload, all_zero }, coded.reconstruction))
    }
}

/// Leaves that are predicted at a time, and most channels of a section.
const FEW: usize = 32;
const CHANNELS: usize = 21;

/// Checks the Gaussians of the leaves from `first` on.
fn check(part: &Gaussians<'_>, leaves: &Leaves, cube: &Cube, first: usize) -> Result<()> {
    let scene = &*part.scene;
    let Leaves { leaves, j_high, .. } = leaves;
    let off = leaves
        .par_iter()
        .with_min_len(4096)
        .zip(&scene.means)
        .position_first(|(&leaf, mean)| cube.leaf_centre(leaf, *j_high) != *mean);
    if let Some(index) = off {
        return Err(Error::OffCentre { index: first + index });
    }
    let finite = |field, ok: &(dyn Fn(usize) -> bool + Sync)| match (0..scene.len())
        .into_par_iter()
        .with_min_len(4096)
        .find_first(|&i| !ok(i))
    {
        Some(index) => Err(Error::NonFinite { index: first + index, field }),
        None => Ok(()),
    };
    finite("mean", &|i| scene.means[i].iter().all(|v| v.is_finite()))?;
    finite("opacity", &|i| scene.opacity_logits[i].is_finite())?;
    finite("rotation", &|i| {
        let q = scene.rotations[i];
        q.iter().all(|v| v.is_finite()) && q.iter().any(|&v| v != 0.0)
    })?;
    finite("log-scale", &|i| scene.log_scales[i].iter().all(|v| v.is_finite()))?;
    // Of what is not right, the same error whichever array it is in.
    let fine = part.all_sh(|v| v.abs() <= LARGEST);
    if !fine {
        finite("SH coefficient", &|i| part.sh_of(i).iter().all(|v| v.is_finite()))?;
    }
    let fits = |field, of: &dyn Fn(usize) -> f32| {
        let found = (0..scene.len()).map(|i| (i, of(i))).find(|(_, v)| v.abs() > LARGEST);
        match found {
            Some((index, value)) => {
                Err(Error::TooLarge { index: first + index, field, value, limit: LARGEST })
            }
            None => Ok(()),
        }
    };
    let largest =
        |v: &[f32]| v.iter().copied().fold(0.0, |m: f32, v| if v.abs() > m.abs() { v } else { m });
    fits("log-scale", &|i| largest(&scene.log_scales[i]))?;
    if fine { Ok(()) } else { fits("SH coefficient", &|i| largest(&part.sh_of(i))) }
}

/// Greatest magnitude of a log-scale or an SH coefficient: what an `i32` in units of 2^-16 holds of
/// sums of three values over the root of three, far beyond any trained attribute. A DC beyond
/// would saturate its 32 bits without a word.
const LARGEST: f32 = 18_900.0;

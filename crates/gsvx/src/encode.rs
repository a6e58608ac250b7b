//! The encoder.

use crate::attributes::group::{Coding, Transform, UNITS, coding};
use crate::attributes::prediction::Predictor;
use crate::attributes::{colour, opacity};
use crate::covariance;
use crate::error::{Error, Result};
use crate::importance;
use crate::options::{EncodeOptions, Entropy, PaperQp};
use crate::outliers;
use crate::stream::{self, Header, SectionKind};
use crate::{ordered, slices};
use gpcc_lite::Leaf;
use gpcc_lite::attribute::Rows;
use gs_model::Scene;
use rayon::prelude::*;
use std::borrow::Cow;
use std::ops::Range;
use voxel::Voxelization;

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
    let guessed;
    let importance = match &options.importance {
        _ if options.uniform_precision => None,
        Some(given) => Some(given),
        None => {
            guessed = importance::without_cameras(scene);
            Some(&guessed)
        }
    };
    let whole = 0..scene.len();
    encode_parts(scene, voxels, importance.map(Vec::as_slice), options, |range| {
        if range == whole {
            return Ok(Cow::Borrowed(scene));
        }
        Ok(Cow::Owned(part_of(scene, range)))
    })
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

/// Encodes leaves whose Gaussians `part` gives, a slice at a time. `like` has their SH degree, and
/// coefficients that are not zero where theirs are not.
pub(crate) fn encode_parts<'a>(
    like: &Scene,
    voxels: &Voxelization,
    importance: Option<&[f32]>,
    options: &EncodeOptions,
    part: impl Fn(Range<usize>) -> Result<Cow<'a, Scene>> + Sync,
) -> Result<Encoded> {
    let n = voxels.len();
    let outliers = outliers::of(options.outliers.as_ref(), like)?;
    // The degree of the exact coefficients is the header's: it must not fall below theirs.
    let least = outliers::degree(outliers, options.max_sh_degree);
    let sh_degree = used_degree(like, options.max_sh_degree).max(least);
    let log_classes = match importance {
        Some(given) if given.len() != n => {
            return Err(Error::CountMismatch { scene: given.len(), leaves: n });
        }
        Some(given) => Some(importance::log_classes(given)),
        None => None,
    };
    let slices = slices::count(n, options);
    let entropy = options.entropy.of(n);
    let slice = |i: usize| {
        let range = slices::range(n, slices, i);
        let scene = part(range.clone())?;
        check(&scene, voxels, range.start)?;
        let leaves =
            Leaves { leaves: &voxels.leaves[range.clone()], j_high: voxels.j_high, entropy };
        let log_classes = log_classes.as_ref().map(|all| &all[range]);
        leaves.sections(&scene, log_classes, sh_degree, options)
    };
    // At most a quarter of the Gaussians at a time, for memory's sake.
    let at_once = (slices / 4).clamp(1, rayon::current_num_threads());
    let mut parts: Vec<std::vec::IntoIter<Section>> = Vec::with_capacity(slices);
    ordered::in_order(slices, at_once, slice, |sections: Vec<Section>| -> Result<()> {
        parts.push(sections.into_iter());
        Ok(())
    })?;
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
    Ok(Encoded { bytes, sections })
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
pub(crate) struct Leaves<'a> {
    pub(crate) leaves: &'a [Leaf],
    pub(crate) j_high: u8,
    /// [Resolved](Entropy::of).
    pub(crate) entropy: Entropy,
}

impl Leaves<'_> {
    /// Every section of one slice but the outliers, in stream order.
    fn sections(
        &self,
        scene: &Scene,
        log_classes: Option<&[f64]>,
        sh_degree: u8,
        options: &EncodeOptions,
    ) -> Result<Vec<Section>> {
        // Geometry needs nothing of the rest, and the rest nothing of its bytes.
        let (geometry, attributes) = rayon::join(
            || self.geometry(),
            || self.attributes(scene, log_classes, sh_degree, options),
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
            gpcc_lite::geometry::encode_fast(self.leaves, self.j_high)
        } else {
            gpcc_lite::geometry::encode(self.leaves, self.j_high)
        };
        coded.map_err(coding("geometry"))
    }

    fn attributes(
        &self,
        scene: &Scene,
        log_classes: Option<&[f64]>,
        sh_degree: u8,
        options: &EncodeOptions,
    ) -> Result<Vec<Section>> {
        let mut sections = Vec::new();
        let mut transform = Transform::new(self.leaves, self.j_high, None)?;
        let mut classes = None;
        if let Some(log_classes) = log_classes {
            let (payload, decoded) = importance::encode_by(&transform, log_classes, self.entropy)?;
            let kind = SectionKind::Importance;
            sections.push(Section { kind, payload, all_zero: false });
            transform = transform.weighted(&decoded)?;
            classes = Some(decoded);
        }
        let kinds = [SectionKind::Opacity, SectionKind::Dc, SectionKind::Covariance];
        let mut jobs = kinds.map(|kind| vec![kind]).to_vec();
        let degrees = (1..=sh_degree).map(SectionKind::of_sh_degree);
        if options.predicts_sh() {
            // Each wants what a decoder will have of the one before.
            jobs.push(degrees.collect());
        } else {
            jobs.extend(degrees.map(|kind| vec![kind]));
        }
        let group = Group { scene, leaves: self, transform, classes, options };
        let coded = ordered::longest_first(
            jobs,
            |job| job.iter().map(|kind| kind.channels()).sum::<usize>(),
            |job| group.sections(&job),
        );
        for coded in coded {
            sections.extend(coded?);
        }
        Ok(sections)
    }
}

/// What the attributes of a slice are coded from.
struct Group<'a> {
    scene: &'a Scene,
    leaves: &'a Leaves<'a>,
    transform: Transform,
    /// Importance classes, as decoded.
    classes: Option<Vec<u8>>,
    options: &'a EncodeOptions,
}

impl Group<'_> {
    /// These sections, one after another.
    fn sections(&self, kinds: &[SectionKind]) -> Result<Vec<Section>> {
        let mut below = None;
        let mut sections = Vec::with_capacity(kinds.len());
        for (i, &kind) in kinds.iter().enumerate() {
            sections.push(match kind {
                SectionKind::Opacity => self.opacity()?,
                SectionKind::Covariance => {
                    let payload =
                        covariance::encode(self.scene, self.leaves, &self.transform, self.options)?;
                    Section { kind, payload, all_zero: false }
                }
                _ => {
                    let (section, rows) = self.sh(kind, below.as_ref(), i + 1 < kinds.len())?;
                    below = Some(rows);
                    section
                }
            });
        }
        Ok(sections)
    }

    fn opacity(&self) -> Result<Section> {
        let Self { scene, options, .. } = self;
        let kind = SectionKind::Opacity;
        let domain = options.opacity_domain;
        let value = |&l: &f32| opacity::forward(domain, l);
        let step = match options.paper_qp {
            Some(qp) => PaperQp::step(qp.opacity, scene.opacity_logits.iter().map(value)),
            None => f64::from(options.steps.opacity),
        };
        let mut payload = vec![opacity::code(domain)];
        let values: Vec<f64> = scene.opacity_logits.par_iter().map(value).collect();
        let leaf = |i: usize, row: &mut [f64]| row.fill(values[i]);
        payload.extend(self.transform.encode(&[step], self.leaves.coding(kind, options), leaf)?.0);
        Ok(Section { kind, payload, all_zero: false })
    }

    /// DC or an SH degree, predicted from the rows `below` if they are there and it pays; with the
    /// rows that a decoder will have of it if they are `wanted`.
    fn sh(&self, kind: SectionKind, below: Option<&Rows>, wanted: bool) -> Result<(Section, Rows)> {
        let Self { scene, options, .. } = self;
        let steps = &options.steps;
        let degree = kind.sh_degree();
        let luma = match degree {
            0 => steps.dc,
            _ => steps.sh[usize::from(degree) - 1],
        };
        let range = kind.sh_coefficients();
        let chroma = luma * steps.chroma;
        let value =
            |i: usize, c: usize| colour::forward_plane(scene.sh_of(i)[range.start + c / 3], c % 3);
        let qp = options.paper_qp.map(|qp| if kind == SectionKind::Dc { qp.dc } else { qp.ac });
        let steps: Vec<f64> = (0..3 * range.len())
            .map(|c| match qp {
                Some(qp) => PaperQp::step(qp, (0..scene.len()).map(|i| value(i, c))),
                None => f64::from(if c % 3 == 0 { luma } else { chroma }),
            })
            .collect();
        let planes = |i: usize| scene.sh_of(i)[range.clone()].iter().map(|&c| colour::forward(c));
        let mut payload = Vec::new();
        let mut predictor = None;
        if degree >= 2 {
            predictor = below.and_then(|below| {
                let steps = [luma, chroma].map(|step| step * UNITS as f32);
                let exact = |i: usize, row: &mut [f32]| {
                    for (out, planes) in row.as_chunks_mut::<3>().0.iter_mut().zip(planes(i)) {
                        *out = planes.map(|v| (v * UNITS) as f32);
                    }
                };
                Some((Predictor::fit(degree, below, self.classes.as_deref(), steps, exact)?, below))
            });
            Predictor::write(predictor.as_ref().map(|(predictor, _)| predictor), &mut payload);
        }
        // A few leaves at a time.
        let mut lower = [0.0; FEW * CHANNELS];
        let mut predicted = [0.0; FEW * CHANNELS];
        let leaf = |i: usize, row: &mut [f64]| {
            for (out, planes) in row.as_chunks_mut::<3>().0.iter_mut().zip(planes(i)) {
                *out = planes;
            }
            if let Some((predictor, below)) = &predictor {
                if i.is_multiple_of(FEW) {
                    let lower = &mut lower[..FEW * below.channels()];
                    below.copy(i, lower);
                    predicted.fill(0.0);
                    let leaves = FEW.min(scene.len() - i);
                    predictor.add(i, lower, &mut predicted[..leaves * row.len()]);
                }
                let predicted = &predicted[i % FEW * row.len()..];
                for (v, p) in row.iter_mut().zip(predicted) {
                    *v -= f64::from(*p) * (1.0 / UNITS);
                }
            }
        };
        let mut coded =
            self.transform.encode_rows(&steps, self.leaves.coding(kind, options), wanted, leaf)?;
        payload.extend(coded.bytes);
        if let (Some((predictor, below)), true) = (&predictor, wanted) {
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
fn check(scene: &Scene, voxels: &Voxelization, first: usize) -> Result<()> {
    let leaves = &voxels.leaves[first..first + scene.len()];
    let off = leaves
        .par_iter()
        .with_min_len(4096)
        .zip(&scene.means)
        .position_first(|(&leaf, mean)| voxels.cube.leaf_centre(leaf, voxels.j_high) != *mean);
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
    finite("SH coefficient", &|i| scene.sh_of(i).as_flattened().iter().all(|v| v.is_finite()))?;
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
    fits("SH coefficient", &|i| largest(scene.sh_of(i).as_flattened()))
}

/// Greatest magnitude of a log-scale or an SH coefficient: what an `i32` in units of 2^-16 holds of
/// sums of three values over the root of three, far beyond any trained attribute. A DC beyond
/// would saturate its 32 bits without a word.
const LARGEST: f32 = 18_900.0;

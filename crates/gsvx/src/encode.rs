//! The encoder.

use crate::attributes::group::{Transform, coding};
use crate::attributes::{colour, opacity};
use crate::covariance;
use crate::error::{Error, Result};
use crate::importance;
use crate::options::{EncodeOptions, Entropy, PaperQp};
use crate::outliers;
use crate::stream::{self, Header, SectionKind};
use gs_model::Scene;
use rayon::prelude::*;
use std::ops::RangeInclusive;
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
    check(scene, voxels)?;
    let outliers = outliers::of(options.outliers.as_ref(), scene)?;
    // The degree of the exact coefficients is the header's: it must not fall below theirs.
    let least = outliers::degree(outliers, options.max_sh_degree);
    let sh_degree = used_degree(scene, options.max_sh_degree).max(least);
    // The paper's profile codes geometry as small as can be; RLGR by itself asks for speed.
    let fast = options.entropy == Entropy::Rlgr && options.paper_qp.is_none();
    let geometry = || {
        let coded = if fast {
            gpcc_lite::geometry::encode_fast(&voxels.leaves, voxels.j_high)
        } else {
            gpcc_lite::geometry::encode(&voxels.leaves, voxels.j_high)
        };
        coded.map_err(coding("geometry"))
    };
    // Geometry needs nothing of the rest, and the rest nothing of its bytes.
    let (geometry, attributes) =
        rayon::join(geometry, || attribute_sections(scene, voxels, least..=sh_degree, options));
    let mut sections = vec![(SectionKind::Geometry, geometry?)];
    sections.extend(attributes?);
    let is_sh = |kind| matches!(kind, SectionKind::Sh1 | SectionKind::Sh2 | SectionKind::Sh3);
    let header = Header {
        count: scene.len() as u64,
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

/// Every section that follows from the leaves but the geometry, in stream order; SH degrees up to
/// the highest that says something or the least wanted.
fn attribute_sections(
    scene: &Scene,
    voxels: &Voxelization,
    sh_degrees: RangeInclusive<u8>,
    options: &EncodeOptions,
) -> Result<Vec<(SectionKind, Vec<u8>)>> {
    let mut sections = Vec::new();
    let classes = if options.uniform_precision {
        None
    } else {
        let log_classes = match &options.importance {
            Some(given) if given.len() != scene.len() => {
                return Err(Error::CountMismatch { scene: given.len(), leaves: scene.len() });
            }
            Some(given) => importance::log_classes(given),
            None => importance::log_classes(&importance::without_cameras(scene)),
        };
        let entropy = options.entropy;
        let (payload, classes) =
            importance::encode(&log_classes, &voxels.leaves, voxels.j_high, entropy)?;
        sections.push((SectionKind::Importance, payload));
        Some(classes)
    };
    let transform = Transform::new(&voxels.leaves, voxels.j_high, classes.as_deref())?;
    drop(classes);
    let mut kinds = vec![SectionKind::Opacity, SectionKind::Dc, SectionKind::Covariance];
    kinds.extend((1..=*sh_degrees.end()).map(SectionKind::of_sh_degree));
    let coded =
        largest_first(&kinds, |kind| attribute_section(kind, scene, voxels, &transform, options));
    let mut zero = Vec::new();
    for (&kind, payload) in kinds.iter().zip(coded) {
        let (payload, all_zero) = payload?;
        sections.push((kind, payload));
        zero.push(all_zero && !scene.is_empty() && kind != SectionKind::Dc);
    }
    // Degrees at the end that say nothing are left out, and the header's degree falls.
    let least = kinds.len() - usize::from(sh_degrees.end() - sh_degrees.start());
    while zero.len() > least && zero.pop() == Some(true) {
        sections.pop();
    }
    Ok(sections)
}

/// Runs `work` on every kind, those of most channels first, so that no core waits for a long one
/// that was begun last; results in the order of `kinds`.
pub(crate) fn largest_first<T: Send>(
    kinds: &[SectionKind],
    work: impl Fn(SectionKind) -> T + Sync,
) -> Vec<T> {
    let mut order: Vec<usize> = (0..kinds.len()).collect();
    order.sort_by_key(|&i| std::cmp::Reverse(kinds[i].channels()));
    let mut slots: Vec<Option<T>> = kinds.iter().map(|_| None).collect();
    rayon::scope_fifo(|scope| {
        let mut free: Vec<Option<&mut Option<T>>> = slots.iter_mut().map(Some).collect();
        for i in order {
            if let Some(slot) = free[i].take() {
                let (kind, work) = (kinds[i], &work);
                scope.spawn_fifo(move |_| *slot = Some(work(kind)));
            }
        }
    });
    slots.into_iter().flatten().collect()
}

/// The payload of a section, and whether it says nothing (an SH degree that is zero throughout).
fn attribute_section(
    kind: SectionKind,
    scene: &Scene,
    voxels: &Voxelization,
    transform: &Transform,
    options: &EncodeOptions,
) -> Result<(Vec<u8>, bool)> {
    let steps = &options.steps;
    match kind {
        SectionKind::Opacity => {
            let domain = options.opacity_domain;
            let value = |&l: &f32| opacity::forward(domain, l);
            let step = match options.paper_qp {
                Some(qp) => PaperQp::step(qp.opacity, scene.opacity_logits.iter().map(value)),
                None => f64::from(steps.opacity),
            };
            let mut out = vec![opacity::code(domain)];
            let values: Vec<f64> = scene.opacity_logits.par_iter().map(value).collect();
            let leaf = |i: usize, row: &mut [f64]| row.fill(values[i]);
            out.extend(transform.encode(&[step], options.entropy, leaf)?.0);
            Ok((out, false))
        }
        SectionKind::Covariance => {
            Ok((covariance::encode(scene, voxels, transform, options)?, false))
        }
        _ => {
            let (range, luma) = match kind {
                SectionKind::Sh1 => (1..4, steps.sh[0]),
                SectionKind::Sh2 => (4..9, steps.sh[1]),
                SectionKind::Sh3 => (9..16, steps.sh[2]),
                _ => (0..1, steps.dc),
            };
            let chroma = luma * steps.chroma;
            let value = |i: usize, c: usize| {
                colour::forward_plane(scene.sh_of(i)[range.start + c / 3], c % 3)
            };
            let qp = options.paper_qp.map(|qp| if kind == SectionKind::Dc { qp.dc } else { qp.ac });
            let steps: Vec<f64> = (0..3 * range.len())
                .map(|c| match qp {
                    Some(qp) => PaperQp::step(qp, (0..scene.len()).map(|i| value(i, c))),
                    None => f64::from(if c % 3 == 0 { luma } else { chroma }),
                })
                .collect();
            transform.encode(&steps, options.entropy, |i, row| {
                for (planes, &rgb) in row.chunks_exact_mut(3).zip(&scene.sh_of(i)[range.clone()]) {
                    planes.copy_from_slice(&colour::forward(rgb));
                }
            })
        }
    }
}

fn check(scene: &Scene, voxels: &Voxelization) -> Result<()> {
    if scene.len() != voxels.leaves.len() {
        return Err(Error::CountMismatch { scene: scene.len(), leaves: voxels.leaves.len() });
    }
    let off = voxels
        .leaves
        .par_iter()
        .with_min_len(4096)
        .zip(&scene.means)
        .position_first(|(&leaf, mean)| voxels.cube.leaf_centre(leaf, voxels.j_high) != *mean);
    if let Some(index) = off {
        return Err(Error::OffCentre { index });
    }
    let finite = |field, ok: &(dyn Fn(usize) -> bool + Sync)| match (0..scene.len())
        .into_par_iter()
        .with_min_len(4096)
        .find_first(|&i| !ok(i))
    {
        Some(index) => Err(Error::NonFinite { index, field }),
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
            Some((index, value)) => Err(Error::TooLarge { index, field, value, limit: LARGEST }),
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

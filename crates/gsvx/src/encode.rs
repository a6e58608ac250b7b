//! The encoder.

use crate::attributes::group::{Transform, coding};
use crate::attributes::{colour, opacity};
use crate::covariance;
use crate::error::{Error, Result};
use crate::importance;
use crate::options::{EncodeOptions, Entropy, PaperQp};
use crate::stream::{self, Header, SectionKind};
use gs_model::Scene;
use rayon::prelude::*;
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
/// fit; [`Error::Coding`] if the leaves are not a valid pruned octree.
pub fn encode(scene: &Scene, voxels: &Voxelization, options: &EncodeOptions) -> Result<Encoded> {
    check(scene, voxels)?;
    let sh_degree = scene.sh_degree.min(options.max_sh_degree);
    // The paper's profile codes geometry as small as can be; RLGR by itself asks for speed.
    let fast = options.entropy == Entropy::Rlgr && options.paper_qp.is_none();
    let geometry = if fast {
        gpcc_lite::geometry::encode_fast(&voxels.leaves, voxels.j_high)
    } else {
        gpcc_lite::geometry::encode(&voxels.leaves, voxels.j_high)
    };
    let mut sections = vec![(SectionKind::Geometry, geometry.map_err(coding("geometry"))?)];
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
        let (payload, classes) = importance::encode(&log_classes, &voxels.leaves, voxels.j_high)?;
        sections.push((SectionKind::Importance, payload));
        Some(classes)
    };
    let transform = Transform::new(&voxels.leaves, voxels.j_high, classes.as_deref())?;
    let mut kinds = vec![SectionKind::Opacity, SectionKind::Dc, SectionKind::Covariance];
    kinds.extend((1..=sh_degree).map(SectionKind::of_sh_degree));
    let coded: Result<Vec<_>> = kinds
        .par_iter()
        .map(|&kind| Ok((kind, attribute_section(kind, scene, voxels, &transform, options)?)))
        .collect();
    sections.extend(coded?);
    let header = Header {
        count: scene.len() as u64,
        sh_degree,
        j_high: voxels.j_high,
        cube: voxels.cube,
        colour_space: Default::default(),
        coordinate_system: Default::default(),
    };
    let bytes = stream::assemble(&header, &sections);
    let sections = sections.iter().map(|(kind, payload)| (*kind, payload.len())).collect();
    Ok(Encoded { bytes, sections })
}

fn attribute_section(
    kind: SectionKind,
    scene: &Scene,
    voxels: &Voxelization,
    transform: &Transform,
    options: &EncodeOptions,
) -> Result<Vec<u8>> {
    let steps = &options.steps;
    match kind {
        SectionKind::Opacity => {
            let domain = options.opacity_domain;
            let channel: Vec<f64> =
                scene.opacity_logits.iter().map(|&l| opacity::forward(domain, l)).collect();
            let step = match options.paper_qp {
                Some(qp) => PaperQp::step(qp.opacity, &channel),
                None => f64::from(steps.opacity),
            };
            let mut out = vec![opacity::code(domain)];
            out.extend(transform.encode(&[channel], &[step], options.entropy)?);
            Ok(out)
        }
        SectionKind::Covariance => covariance::encode(scene, voxels, transform, options),
        _ => {
            let (range, luma) = match kind {
                SectionKind::Sh1 => (1..4, steps.sh[0]),
                SectionKind::Sh2 => (4..9, steps.sh[1]),
                SectionKind::Sh3 => (9..16, steps.sh[2]),
                _ => (0..1, steps.dc),
            };
            let chroma = luma * steps.chroma;
            let mut channels = vec![Vec::with_capacity(scene.len()); 3 * range.len()];
            for i in 0..scene.len() {
                for (k, &rgb) in scene.sh_of(i)[range.clone()].iter().enumerate() {
                    for (c, v) in colour::forward(rgb).into_iter().enumerate() {
                        channels[3 * k + c].push(v);
                    }
                }
            }
            let qp = options.paper_qp.map(|qp| if kind == SectionKind::Dc { qp.dc } else { qp.ac });
            let steps: Vec<f64> = channels
                .iter()
                .enumerate()
                .map(|(c, channel)| match qp {
                    Some(qp) => PaperQp::step(qp, channel),
                    None => f64::from(if c % 3 == 0 { luma } else { chroma }),
                })
                .collect();
            transform.encode(&channels, &steps, options.entropy)
        }
    }
}

fn check(scene: &Scene, voxels: &Voxelization) -> Result<()> {
    if scene.len() != voxels.leaves.len() {
        return Err(Error::CountMismatch { scene: scene.len(), leaves: voxels.leaves.len() });
    }
    for (index, (&leaf, mean)) in voxels.leaves.iter().zip(&scene.means).enumerate() {
        if voxels.cube.leaf_centre(leaf, voxels.j_high) != *mean {
            return Err(Error::OffCentre { index });
        }
    }
    let finite = |field, ok: &dyn Fn(usize) -> bool| match (0..scene.len()).find(|&i| !ok(i)) {
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
    finite("SH coefficient", &|i| scene.sh_of(i).as_flattened().iter().all(|v| v.is_finite()))
}

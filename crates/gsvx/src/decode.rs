//! The decoder. Needs nothing but the stream.

use crate::attributes::group::{Transform, coding, limits};
use crate::attributes::{colour, opacity};
use crate::encode::largest_first;
use crate::error::{Error, Result};
use crate::importance;
use crate::outliers;
use crate::stream::{Container, Header, SectionKind};
use gpcc_lite::Leaf;
use gs_model::Scene;
use rayon::prelude::*;

/// Gaussians per stream byte that a decoder accepts by default. Coded scenes have fewer than
/// one per byte; a solid block of equal Gaussians could have more, and then the caller says so.
pub const DEFAULT_GAUSSIANS_PER_BYTE: u64 = 64;

/// Options of [`decode`].
#[derive(Clone, Debug, PartialEq)]
pub struct DecodeOptions {
    /// Highest SH degree to decode.
    pub max_sh_degree: u8,
    /// Merge Gaussians to at most one per octree cell of this depth; `None` keeps all.
    pub lod: Option<u8>,
    /// Decode what a truncated stream still holds instead of failing. Geometry, importance,
    /// opacity and DC must be whole.
    pub allow_truncated: bool,
    /// Greatest number of Gaussians accepted; `None` derives it from the stream's length.
    pub max_gaussians: Option<u64>,
}

impl Default for DecodeOptions {
    fn default() -> Self {
        Self { max_sh_degree: 3, lod: None, allow_truncated: false, max_gaussians: None }
    }
}

/// A decoded scene.
#[derive(Clone, Debug)]
pub struct Decoded {
    /// The scene; Gaussians in Morton order (of a lossless stream: of the means, unless it keeps
    /// the order of the input), then those that were coded exactly.
    pub scene: Scene,
    /// The octree leaves, one per Gaussian that was not coded exactly; none of a lossless stream.
    pub leaves: Vec<Leaf>,
    /// The stream's header.
    pub header: Header,
    /// What was not decoded, and why; one line each.
    pub skipped: Vec<String>,
}

/// Decodes a stream.
///
/// # Errors
/// Any damage to the stream is reported as an [`Error`]; see [`DecodeOptions`] for truncation.
pub fn decode(bytes: &[u8], options: &DecodeOptions) -> Result<Decoded> {
    let decoded = decode_all(bytes, options)?;
    match options.lod {
        Some(depth) => crate::lod::reduce(decoded, depth),
        None => Ok(decoded),
    }
}

fn decode_all(bytes: &[u8], options: &DecodeOptions) -> Result<Decoded> {
    let container = Container::parse(bytes)?;
    let header = container.header.clone();
    let limit =
        options.max_gaussians.unwrap_or(DEFAULT_GAUSSIANS_PER_BYTE * bytes.len() as u64 + 1024);
    if header.count > limit {
        return Err(Error::Limit { points: header.count, limit });
    }
    if let Some(payload) = container.section(SectionKind::Lossless)? {
        let scene = crate::lossless::decode_payload(payload, header.count, header.sh_degree)?;
        return Ok(Decoded { scene, leaves: Vec::new(), header, skipped: Vec::new() });
    }
    let need = |kind| match container.section(kind)? {
        Some(payload) => Ok(payload),
        None => Err(Error::MissingSection { kind }),
    };
    let geometry = gpcc_lite::geometry::decode(need(SectionKind::Geometry)?, &limits(header.count))
        .map_err(coding("geometry"))?;
    let leaves = geometry.leaves;
    if leaves.len() as u64 != header.count {
        return Err(Error::Corrupt { what: "leaf count", value: leaves.len() as u64 });
    }
    if geometry.j_high != header.j_high {
        return Err(Error::Corrupt { what: "geometry depth", value: geometry.j_high.into() });
    }
    let classes = match container.section(SectionKind::Importance)? {
        Some(payload) => Some(importance::decode(payload, &leaves, header.j_high)?),
        None => None,
    };
    let transform = Transform::new(&leaves, header.j_high, classes.as_deref())?;
    let mut skipped = Vec::new();
    let outliers = match container.section(SectionKind::Outliers) {
        Ok(None) => None,
        Ok(Some(payload)) => {
            let points = header.count.saturating_add(container.outliers());
            if points > limit {
                return Err(Error::Limit { points, limit });
            }
            Some(outliers::decode(payload, header.sh_degree)?)
        }
        Err(e @ Error::Truncated { .. }) if options.allow_truncated => {
            skipped.push(format!("{}: {e}", SectionKind::Outliers));
            None
        }
        Err(e) => return Err(e),
    };

    let wanted = header.sh_degree.min(options.max_sh_degree);
    for degree in wanted + 1..=header.sh_degree {
        skipped.push(format!("{}: not asked for", SectionKind::of_sh_degree(degree)));
    }
    for entry in &container.toc {
        if let SectionKind::Unknown(code) = entry.kind {
            skipped.push(format!("section of unknown kind {code}: written by a newer version"));
        }
    }
    let mut kinds = vec![SectionKind::Opacity, SectionKind::Dc, SectionKind::Covariance];
    kinds.extend((1..=wanted).map(SectionKind::of_sh_degree));
    let parts = largest_first(&kinds, |kind| {
        section(kind, need(kind)?, &transform, &leaves, header.j_high)
    });
    drop(transform);

    let n = leaves.len();
    let mut scene = Scene { means: centres(&leaves, &header)?, ..Default::default() };
    let mut sh: Vec<Degree> = Vec::new();
    let mut broken = false;
    for (&kind, part) in kinds.iter().zip(parts) {
        match part {
            Ok(Part::Opacity(v)) => scene.opacity_logits = v,
            Ok(Part::Covariance(q, l)) => (scene.rotations, scene.log_scales) = (q, l),
            // A later degree is of no use when an earlier one is missing.
            Ok(Part::Sh(_)) if broken => skipped.push(format!("{kind}: a lower degree is missing")),
            Ok(Part::Sh(degree)) => sh.push(degree),
            Err(e @ Error::Truncated { .. })
                if options.allow_truncated
                    && !matches!(kind, SectionKind::Opacity | SectionKind::Dc) =>
            {
                skipped.push(format!("{kind}: {e}"));
                if kind == SectionKind::Covariance {
                    (scene.rotations, scene.log_scales) = spheres(&leaves, &header);
                }
                broken = true;
            }
            Err(e) => return Err(e),
        }
    }
    scene.sh_degree = sh.len() as u8 - 1;
    scene.sh = interleave(&sh, n);
    if let Some(outliers) = outliers {
        scene.append(&outliers);
    }
    Ok(Decoded { scene, leaves, header, skipped })
}

/// Centres of the leaves. A cube that reaches beyond what an f32 holds is damage: an encoder
/// refuses such scenes.
pub(crate) fn centres(leaves: &[Leaf], header: &Header) -> Result<Vec<[f32; 3]>> {
    let means: Vec<[f32; 3]> =
        leaves.par_iter().map(|&l| header.cube.leaf_centre(l, header.j_high)).collect();
    match means.iter().position(|m| m.iter().any(|v| !v.is_finite())) {
        Some(index) => Err(Error::Corrupt { what: "Gaussian beyond f32", value: index as u64 }),
        None => Ok(means),
    }
}

/// The coefficients of one SH degree, RGB: those of one Gaussian after another.
struct Degree {
    coefficients: usize,
    rgb: Vec<[f32; 3]>,
}

enum Part {
    Opacity(Vec<f32>),
    Covariance(Vec<[f32; 4]>, Vec<[f32; 3]>),
    Sh(Degree),
}

fn section(
    kind: SectionKind,
    payload: &[u8],
    transform: &Transform,
    leaves: &[Leaf],
    j_high: u8,
) -> Result<Part> {
    Ok(match kind {
        SectionKind::Opacity => {
            let Some((&code, rest)) = payload.split_first() else {
                return Err(Error::Truncated { what: "opacity", offset: 0, need: 1, have: 0 });
            };
            let domain = opacity::domain(code)?;
            let mut values = Vec::with_capacity(leaves.len());
            transform.decode(rest, 1, |_, row| values.push(row[0]))?;
            let logit = |v| opacity::inverse(domain, v);
            Part::Opacity(values.into_par_iter().with_min_len(4096).map(logit).collect())
        }
        SectionKind::Covariance => {
            let (q, l) = crate::covariance::decode(payload, transform, leaves, j_high)?;
            Part::Covariance(q, l)
        }
        _ => {
            let coefficients = match kind {
                SectionKind::Sh1 => 3,
                SectionKind::Sh2 => 5,
                SectionKind::Sh3 => 7,
                _ => 1,
            };
            let mut rgb = Vec::with_capacity(coefficients * leaves.len());
            transform.decode(payload, 3 * coefficients, |_, row| {
                for ycc in row.chunks_exact(3) {
                    rgb.push(colour::inverse([ycc[0], ycc[1], ycc[2]]));
                }
            })?;
            Part::Sh(Degree { coefficients, rgb })
        }
    })
}

/// Stand-in covariances where that section is missing: balls that fill their voxels.
fn spheres(leaves: &[Leaf], header: &Header) -> (Vec<[f32; 4]>, Vec<[f32; 3]>) {
    let log_scales = leaves
        .iter()
        .map(|leaf| {
            let cell = header.cube.side / (1u64 << leaf.depth) as f64;
            [libm::log((0.5 * cell).max(f64::MIN_POSITIVE)) as f32; 3]
        })
        .collect();
    (vec![[1.0, 0.0, 0.0, 0.0]; leaves.len()], log_scales)
}

/// Degrees to rows of all coefficients.
fn interleave(degrees: &[Degree], n: usize) -> Vec<[f32; 3]> {
    let per_gaussian: usize = degrees.iter().map(|d| d.coefficients).sum();
    let mut sh = vec![[0.0; 3]; n * per_gaussian];
    const CHUNK: usize = 4096;
    sh.par_chunks_mut(CHUNK * per_gaussian.max(1)).enumerate().for_each(|(chunk, out)| {
        for (j, row) in out.chunks_exact_mut(per_gaussian).enumerate() {
            let (i, mut at) = (chunk * CHUNK + j, 0);
            for Degree { coefficients, rgb } in degrees {
                row[at..at + coefficients]
                    .copy_from_slice(&rgb[i * coefficients..][..*coefficients]);
                at += coefficients;
            }
        }
    });
    sh
}

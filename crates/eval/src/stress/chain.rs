//! One input through the whole chain in one mode, and its errors against the bounds of
//! docs/accuracy.md.

use anyhow::{Result, anyhow};
use gs_model::{Scene, ply};
use gsvx::attributes::{colour, opacity};
use gsvx::covariance::log_euclidean;
use gsvx::stream::{Container, Reader, SectionKind};
use gsvx::{
    CovarianceMode, DecodeOptions, EncodeOptions, Entropy, OpacityDomain, Prepared, importance,
    slices,
};
use serde::{Deserialize, Serialize};
use voxel::{Strategy, Voxelization};

/// Settings of voxelization, encoder and decoder.
pub(crate) const MODES: [&str; 8] = [
    "default",
    "--fast",
    "vq:8",
    "lossless:16",
    "uniform depth 12",
    "paper 6 to 12",
    "LoD depth 6",
    "--lossless",
];

/// Depth of the mode that decodes a level of detail.
const LOD: u8 = 6;

/// The result of one run.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub(crate) struct Outcome {
    /// Which part refused, and its message.
    pub(crate) refused: Option<String>,
    pub(crate) gaussians: usize,
    pub(crate) bytes: usize,
    /// Per attribute: the worst error over its bound.
    pub(crate) worst: Vec<(String, f64)>,
    pub(crate) seconds: f64,
    /// Of all threads.
    pub(crate) cpu_seconds: f64,
    pub(crate) peak_mb: f64,
}

/// Runs `scene` in `mode`.
///
/// # Errors
/// If the chain accepts the scene, but the decoded scene is invalid or not what it must be.
pub(crate) fn run(scene: &Scene, mode: &str) -> Result<Outcome> {
    if mode == "--lossless" {
        return lossless(scene);
    }
    // Through a file, as the command does: the reader decides what is valid.
    let mut file = Vec::new();
    let refused = |what: &str, error: &dyn std::fmt::Display| {
        Ok(Outcome { refused: Some(format!("{what}: {error}")), ..Default::default() })
    };
    if let Err(e) = ply::write_to(&mut file, scene) {
        return refused("write", &e);
    }
    let scene = match ply::read_bytes(&file) {
        Ok((scene, _)) => scene,
        Err(e) => return refused("read", &e),
    };
    drop(file);
    let quality = gsvx::DEFAULT_QUALITY;
    let strategy = |importance: &[f32], seen| match mode {
        "uniform depth 12" => Ok(Strategy::Uniform { depth: 12 }),
        "paper 6 to 12" => Ok(Strategy::paper(6, 12)),
        _ => gsvx::default_strategy(quality, importance, seen),
    };
    let prepared = match gsvx::prepare(&scene, strategy, None) {
        Ok(prepared) => prepared,
        Err(e) => return refused("voxelize", &e),
    };
    let Prepared { scene: merged, voxels, importance } = prepared;
    let options = EncodeOptions {
        covariance: match mode {
            "vq:8" => CovarianceMode::Vq { bits: 8 },
            "lossless:16" => CovarianceMode::Lossless { bits: 16 },
            _ => CovarianceMode::Transform,
        },
        entropy: if mode == "--fast" { Entropy::Fast } else { Entropy::Range },
        importance: Some(importance),
        ..EncodeOptions::default()
    };
    let bytes = match gsvx::encode(&merged, &voxels, &options) {
        Ok(encoded) => encoded.bytes,
        Err(e) => return refused("encode", &e),
    };
    let lod = (mode == "LoD depth 6").then_some(LOD);
    let decoded = gsvx::decode(&bytes, &DecodeOptions { lod, ..Default::default() })?;
    decoded.scene.validate().map_err(|e| anyhow!("the decoder returned {e}"))?;
    let mut back = Vec::new();
    ply::write_to(&mut back, &decoded.scene)?;
    if ply::read_bytes(&back)?.0 != decoded.scene {
        return Err(anyhow!("the decoded scene changed by being written and read"));
    }
    drop(back);
    let mut outcome =
        Outcome { gaussians: decoded.scene.len(), bytes: bytes.len(), ..Default::default() };
    let mut add = |name: &str, ratio: f64| outcome.worst.push((name.into(), ratio));
    if lod.is_some() {
        add("mean", off_centre(&decoded, &voxels));
        return Ok(outcome);
    }
    add("mean", displacement(&scene, &voxels));
    if decoded.scene.means != merged.means {
        return Err(anyhow!("decoded means are not those of the voxels"));
    }
    outcome.worst.extend(attributes(&bytes, &voxels, &merged, &decoded.scene, &options)?);
    Ok(outcome)
}

/// For each attribute, its worst error over its bound.
fn attributes(
    bytes: &[u8],
    voxels: &Voxelization,
    merged: &Scene,
    decoded: &Scene,
    options: &EncodeOptions,
) -> Result<Vec<(String, f64)>> {
    let mut worst = Vec::new();
    let mut add = |name: &str, ratio: f64| worst.push((name.into(), ratio));
    let bound = Bound::of(bytes, voxels, merged.len())?;
    let steps = &options.steps;
    let log_alpha =
        |s: &Scene, i: usize| [opacity::forward(OpacityDomain::LogAlpha, s.opacity_logits[i])];
    add("opacity", bound.ratio(merged, decoded, steps.opacity, log_alpha));
    for k in 0..merged.sh_len() {
        let step = if k == 0 { steps.dc } else { steps.sh[0] };
        // A degree of zeros is left out of the stream.
        let planes =
            |s: &Scene, i: usize| colour::forward(s.sh_of(i).get(k).copied().unwrap_or_default());
        add("SH", bound.ratio(merged, decoded, step, planes));
    }
    match options.covariance {
        CovarianceMode::Transform => {
            let c =
                |s: &Scene, i: usize| log_euclidean::coordinates(s.rotations[i], s.log_scales[i]);
            add("covariance", bound.ratio(merged, decoded, steps.covariance, c));
        }
        CovarianceMode::Lossless { bits } => {
            add("covariance", integers(merged, decoded, bits));
        }
        _ => {
            add("covariance (shape)", shapes(bytes, merged, decoded)?);
            let size = |s: &Scene, i: usize| [log_size(s.log_scales[i])];
            let bound = Bound { rounding: CODEWORD_SIZE, ..bound };
            add("covariance (size)", bound.ratio(merged, decoded, steps.covariance, size));
        }
    }
    Ok(worst)
}

/// Worst distance of a shape from its codeword's over the bound. Every Gaussian (or every so many)
/// must have the nearest codeword of the stream.
fn shapes(bytes: &[u8], want: &Scene, got: &Scene) -> Result<f64> {
    use vq::{Codebook, Covariance, index};
    if want.is_empty() {
        return Ok(0.0);
    }
    let container = Container::parse(bytes)?;
    let payload = container.section(SectionKind::Covariance)?.unwrap_or_default();
    // A byte that names the mode, the codebook, the indices (docs/bitstream.md).
    let mut r = Reader::new(payload.get(1..).unwrap_or_default(), "covariance");
    let book = Codebook::from_bytes(r.block()?)?;
    let indices = index::decode(r.block()?, want.len(), book.len())?;
    let words: Vec<[f64; 6]> = book.decode_all().iter().map(|&(q, l)| root(q, l)).collect();
    let bound = (2.0 + book.trace_tolerance()).sqrt();
    let mut worst = 0.0f64;
    for i in (0..want.len()).step_by(1 + want.len() / SHAPES) {
        let clamped = want.log_scales[i].map(|v| v.clamp(-100.0, 100.0));
        let (shape, _) = Covariance::split(want.rotations[i], clamped)?;
        let shape = root(shape.quaternion(), shape.log_scales());
        let square = |w: &[f64; 6]| (0..6).map(|k| (w[k] - shape[k]) * (w[k] - shape[k])).sum();
        let index = indices[i];
        let (q, l) = book.decode(index)?;
        let own: f64 = square(&words[index as usize]);
        let nearest: f64 = words.iter().map(square).fold(f64::INFINITY, f64::min);
        // The search compares squares in f32.
        if own > nearest + 1e-6 {
            return Err(anyhow!("Gaussian {i}: {own} from its codeword, {nearest} from another"));
        }
        let apart = |k: usize| (got.log_scales[i][k] - got.log_scales[i][0]) - (l[k] - l[0]);
        let ulp = 1e-6 * got.log_scales[i].iter().fold(1.0f32, |m, v| m.max(v.abs()));
        if got.rotations[i] != q || (1..3).any(|k| apart(k).abs() > 4.0 * ulp) {
            return Err(anyhow!("Gaussian {i} was not decoded to the shape of its codeword"));
        }
        worst = worst.max(own.sqrt() / bound);
    }
    Ok(worst)
}

/// Shapes compared with all codewords, at most.
const SHAPES: usize = 100_000;

/// Root of a covariance as a vector whose norm is the matrix's (off-diagonal entries count twice).
fn root(q: [f32; 4], l: [f32; 3]) -> [f64; 6] {
    let [w, x, y, z] = q.map(f64::from);
    let r = [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
        [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
        [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
    ];
    let s = l.map(|v| libm::exp(f64::from(v)));
    let entry = |i: usize, j: usize| (0..3).map(|k| r[i][k] * s[k] * r[j][k]).sum::<f64>();
    let off = std::f64::consts::SQRT_2;
    [entry(0, 0), entry(1, 1), entry(2, 2), off * entry(0, 1), off * entry(0, 2), off * entry(1, 2)]
}

/// How far the logarithm of a codeword's size can be from 0 (`vq::Codebook::trace_tolerance`).
const CODEWORD_SIZE: f64 = 0.02;

/// `ln` of the root of the covariance's trace, over the range that is coded.
fn log_size(l: [f32; 3]) -> f64 {
    let l = l.map(|v| v.clamp(-100.0, 100.0));
    let top = f64::from(l.iter().copied().fold(f32::NEG_INFINITY, f32::max));
    let sum: f64 = l.iter().map(|&v| libm::exp(2.0 * (f64::from(v) - top))).sum();
    top + 0.5 * libm::log(sum)
}

fn lossless(scene: &Scene) -> Result<Outcome> {
    let encoded = gsvx::encode_lossless(scene)?;
    let decoded = gsvx::decode(&encoded.bytes, &DecodeOptions::default())?;
    if rows(scene) != rows(&decoded.scene) {
        return Err(anyhow!("a float came back with other bits"));
    }
    Ok(Outcome {
        gaussians: decoded.scene.len(),
        bytes: encoded.bytes.len(),
        worst: vec![("every float".into(), 0.0)],
        ..Default::default()
    })
}

/// Hashes of the bits of every Gaussian, sorted, because a stream does not keep the order.
fn rows(s: &Scene) -> Vec<[u8; 16]> {
    use sha2::{Digest, Sha256};
    let mut rows: Vec<[u8; 16]> = (0..s.len())
        .map(|i| {
            let mut sha = Sha256::new();
            let parts: [&[f32]; 5] = [
                &s.means[i],
                &s.rotations[i],
                &s.log_scales[i],
                &s.opacity_logits[i..=i],
                s.sh_of(i).as_flattened(),
            ];
            parts.concat().iter().for_each(|v| sha.update(v.to_bits().to_le_bytes()));
            let mut row = [0; 16];
            row.copy_from_slice(&sha.finalize()[..16]);
            row
        })
        .collect();
    rows.sort_unstable();
    rows
}

/// Distance of each input mean from its leaf's centre, per axis, over half the leaf's side.
fn displacement(scene: &Scene, voxels: &Voxelization) -> f64 {
    let mut worst = 0.0f64;
    for (leaf, &l) in voxels.leaves.iter().enumerate() {
        let centre = voxels.cube.leaf_centre(l, voxels.j_high);
        let half = voxels.cube.cell(l.depth) / 2.0;
        for &member in voxels.members_of(leaf) {
            for k in 0..3 {
                let mean = f64::from(scene.means[member as usize][k]);
                // The rounding of an f32 of this size is not the voxelization's error.
                let ulp = mean.abs().max(f64::from(centre[k]).abs()) * f64::from(f32::EPSILON)
                    + f64::from(f32::from_bits(1));
                worst = worst.max((f64::from(centre[k]) - mean).abs() / (half + ulp));
            }
        }
    }
    worst
}

/// 0 if every mean is the centre of its cell and no two cells are the same, else infinite.
fn off_centre(decoded: &gsvx::Decoded, voxels: &Voxelization) -> f64 {
    let at_centre = decoded
        .leaves
        .iter()
        .zip(&decoded.scene.means)
        .all(|(l, m)| voxels.cube.leaf_centre(*l, voxels.j_high) == *m && l.depth <= LOD);
    let ascending = decoded.leaves.windows(2).all(|w| w[0].morton < w[1].morton);
    if at_centre && ascending { 0.0 } else { f64::INFINITY }
}

/// Bounds of transform-coded channels (docs/accuracy.md).
struct Bound {
    /// Per Gaussian: the step of its importance class over that of the mean class.
    fineness: Vec<f64>,
    /// Greatest number of coefficients that reach a Gaussian.
    path: f64,
    /// Error beside that of quantisation.
    rounding: f64,
}

/// Greatest error of one coefficient, in steps: the dead zone ends at 1.45.
const COEFFICIENT: f64 = 1.5;

impl Bound {
    fn of(bytes: &[u8], voxels: &Voxelization, n: usize) -> Result<Self> {
        let container = Container::parse(bytes)?;
        let mut fineness = Vec::with_capacity(n);
        if let Some(payload) = container.section(SectionKind::Importance)? {
            let count = container.header.slices as usize;
            for (i, part) in slices::split(payload, count)?.into_iter().enumerate() {
                let leaves = &voxels.leaves[slices::range(voxels.leaves.len(), count, i)];
                let classes = importance::decode(part, leaves, voxels.j_high)?;
                fineness.extend(
                    classes
                        .iter()
                        .map(|&c| libm::exp2(f64::from(importance::MEAN_CLASS) - f64::from(c))),
                );
            }
        }
        fineness.resize(n, 1.0);
        let path = (3.0 * f64::from(voxels.j_high) + 1.0).min((n as f64).sqrt());
        // Fixed point of 2^-16.
        Ok(Self { fineness, path, rounding: 4.0 / 65536.0 })
    }

    /// The greater of: worst error over its bound, and weighted root mean square over its bound.
    fn ratio<const C: usize>(
        &self,
        want: &Scene,
        got: &Scene,
        step: f32,
        channels: impl Fn(&Scene, usize) -> [f64; C],
    ) -> f64 {
        let step = f64::from(step);
        let (mut worst, mut square) = (0.0f64, [0.0f64; C]);
        for (i, fineness) in self.fineness.iter().enumerate() {
            let (a, b) = (channels(want, i), channels(got, i));
            // Every channel of a Gaussian shares the f32 rounding of its largest.
            let size = a.iter().fold(0.0f64, |m, v| m.max(v.abs()));
            let rounding = 2e-6 * size + self.rounding;
            for c in 0..C {
                let error = ((a[c] - b[c]).abs() - rounding).max(0.0);
                worst = worst.max(error / (self.path * COEFFICIENT * step * fineness));
                square[c] += (error / fineness) * (error / fineness);
            }
        }
        let n = self.fineness.len().max(1) as f64;
        let rms = square.iter().map(|s| (s / n).sqrt() / (COEFFICIENT * step));
        rms.fold(worst, f64::max)
    }
}

/// Worst error of log-scales and quaternion components over half a unit of their grids.
fn integers(want: &Scene, got: &Scene, bits: u8) -> f64 {
    let units = (libm::exp2(f64::from(bits)) - 1.0).max(1.0);
    let mut worst = 0.0f64;
    let mut channel = |a: &[f32], b: &[f32], width: usize, k: usize| {
        let column = || a.iter().skip(k).step_by(width).copied();
        let low = f64::from(column().fold(f32::INFINITY, f32::min));
        let high = f64::from(column().fold(f32::NEG_INFINITY, f32::max));
        let half = 0.5 * (high - low) / units;
        for (x, y) in column().zip(b.iter().skip(k).step_by(width)) {
            let rounding = 1e-6 * f64::from(x.abs()) + 1e-12;
            worst = worst.max((f64::from(x) - f64::from(*y)).abs() / (half + rounding));
        }
    };
    for k in 0..3 {
        channel(want.log_scales.as_flattened(), got.log_scales.as_flattened(), 3, k);
    }
    for k in 0..4 {
        channel(want.rotations.as_flattened(), got.rotations.as_flattened(), 4, k);
    }
    worst
}

//! One input through the whole chain in one mode, and its errors against the bounds of
//! docs/accuracy.md.

use std::num::NonZeroUsize;

use anyhow::{Result, anyhow, ensure};
use gs_model::{Scene, ply};
use gsvx::covariance;
use gsvx::{CodeOptions, DEFAULT_QUALITY, EncodeOptions, Leaves, Steps, VoxelScene, importance};
use voxel::Voxelization;

use super::levels::{self, of_degree, rows};
use super::outcome::{ChainOutcome, by};
use super::paper_codec;
use crate::attributes::{colour_planes, log_alpha};

/// Settings of voxelization and encoder, and the paper's codec.
pub(crate) const MODES: [&str; 17] = [
    "default",
    "quality 5",
    "quality 100",
    "chunks of 64",
    "lod",
    "lod, chunks of 64",
    "uniform precision",
    "SH degree 0",
    "uniform depth 12",
    "paper 6 to 12",
    "--lossless",
    "--lossless, in order",
    "paper's codec, QP 4",
    "paper's codec, QP 28",
    "paper's codec, QP 51",
    "paper's codec, QP 28, lossless covariances",
    "W2 barycenters",
];

/// Leaves of small chunks.
const SMALL: NonZeroUsize = NonZeroUsize::MIN.saturating_add(63);

/// What the encoder is asked for in a mode: a quality, and how.
fn options_of(mode: &str) -> (f32, EncodeOptions) {
    let quality = mode.strip_prefix("quality ").and_then(|q| q.parse().ok());
    let mut options = EncodeOptions::default();
    let EncodeOptions { prepare, code } = &mut options;
    code.lod = mode.starts_with("lod");
    if mode.ends_with("chunks of 64") {
        code.chunk_leaves = SMALL;
    }
    code.uniform_precision = mode == "uniform precision";
    prepare.leaves = match mode {
        "uniform depth 12" => Leaves::Uniform { depth: 12 },
        "paper 6 to 12" => Leaves::Paper { j_low: 6, j_high: 12 },
        _ => Leaves::RateDistortion,
    };
    if mode == "SH degree 0" {
        code.max_sh_degree = 0;
    }
    (quality.unwrap_or(DEFAULT_QUALITY), options)
}

/// What a stream was made from, and the stream.
struct Stream {
    /// One Gaussian per leaf, as the encoder merges them.
    prepared: VoxelScene,
    /// The Gaussians that were voxelized, and those that are coded exactly.
    inside: Scene,
    outliers: Scene,
    bytes: Vec<u8>,
    steps: Steps,
    options: CodeOptions,
}

/// Runs `scene` in `mode`.
///
/// # Errors
/// If the chain accepts the scene, but the decoded scene is invalid or not what it must be.
pub(crate) fn run(scene: &Scene, mode: &str) -> Result<ChainOutcome> {
    if mode.starts_with("--lossless") {
        return lossless(scene, mode.ends_with("in order"));
    }
    let scene = match through_a_file(scene) {
        Ok(scene) => scene,
        Err(refused) => return Ok(Err(refused)),
    };
    match mode {
        "W2 barycenters" => paper_codec::barycenters(&scene),
        _ if mode.starts_with("paper's codec") => paper_codec::run(&scene, mode),
        _ => encoded(&scene, mode).map_or_else(|refused| Ok(Err(refused)), |stream| check(&stream)),
    }
}

/// The scene as the command reads it: the reader decides what is valid.
fn through_a_file(scene: &Scene) -> Result<Scene, String> {
    let mut file = Vec::new();
    ply::write_to(&mut file, scene).map_err(by("write"))?;
    Ok(ply::read_bytes(&file).map_err(by("read"))?.0)
}

/// The scene through voxelization and encoder; or which part refused, and its message.
fn encoded(scene: &Scene, mode: &str) -> Result<Stream, String> {
    let (quality, EncodeOptions { prepare, code: options }) = options_of(mode);
    let steps = Steps::of_quality(quality).map_err(by("options"))?;
    let mut prepared = gsvx::prepare(scene, None, quality, &prepare).map_err(by("voxelize"))?;
    let whole = EncodeOptions { prepare, code: options };
    let encoded = gsvx::encode(scene, None, quality, &whole).map_err(by("encode"))?;
    let outliers = prepared.outliers.take().unwrap_or_default();
    // Outliers follow the leaves.
    let leaves = prepared.scene.len() as u32;
    let rows = encoded.rows;
    let inside: Vec<usize> = (0..scene.len()).filter(|&i| rows[i] < leaves).collect();
    let (inside, bytes) = (scene.select(&inside), encoded.bytes);
    Ok(Stream { prepared, inside, outliers, bytes, steps, options })
}

/// Decodes a stream and compares with what it was made from.
fn check(stream: &Stream) -> Result<ChainOutcome> {
    let Stream { prepared, inside, outliers, bytes, steps, options } = stream;
    let decoded = gsvx::decode(bytes)?;
    decoded.validate().map_err(|e| anyhow!("the decoder returned {e}"))?;
    let mut file = Vec::new();
    ply::write_to(&mut file, &decoded)?;
    ensure!(
        ply::read_bytes(&file)?.0 == decoded,
        "the decoded scene changed by being written and read"
    );
    drop(file);
    let (merged, voxels) = (&prepared.scene, &prepared.voxels);
    let n = merged.len();
    ensure!(decoded.len() == n + outliers.len(), "{} Gaussians decoded", decoded.len());
    let leaves = decoded.select(&(0..n).collect::<Vec<_>>());
    let exact = decoded.select(&(n..decoded.len()).collect::<Vec<_>>());
    ensure!(leaves.means == merged.means, "decoded means are not those of the voxels");
    let outliers = of_degree(outliers, outliers.sh_degree.min(options.max_sh_degree));
    ensure!(
        rows(&of_degree(&exact, outliers.sh_degree)) == rows(&outliers),
        "an outlier came back with other bits"
    );
    let (found, classes) = gsvx::decode_leaves(bytes)?;
    ensure!(&found == voxels.octree(), "decoded leaves are not those of the voxels");
    if options.lod {
        levels::check(bytes, voxels, &outliers)?;
    }
    let mut worst = attributes(&classes, prepared, &leaves, steps, options)?;
    worst.insert(0, ("mean", displacement(inside, voxels)));
    Ok(Ok(worst))
}

/// For each attribute, its worst error over its bound.
fn attributes(
    classes: &[u8],
    prepared: &VoxelScene,
    decoded: &Scene,
    steps: &Steps,
    options: &CodeOptions,
) -> Result<Vec<(&'static str, f64)>> {
    let merged = &prepared.scene;
    let bound = Bound::of(classes, &prepared.voxels);
    let opacity = |s: &Scene, i: usize| [log_alpha(s.opacity_logits[i])];
    let opacity = bound.ratio(merged, decoded, steps.opacity, opacity);
    let kept = usize::from(options.max_sh_degree.min(merged.sh_degree)) + 1;
    ensure!(decoded.sh_len() <= kept * kept, "SH degree {}", decoded.sh_degree);
    let mut sh = 0.0f64;
    for k in 0..kept * kept {
        let step = if k == 0 { steps.dc } else { steps.sh[0] };
        // A degree of zeros is left out of the stream.
        let planes =
            |s: &Scene, i: usize| colour_planes(s.sh_of(i).get(k).copied().unwrap_or_default());
        let ratio = bound.ratio(merged, decoded, step, planes);
        ensure!(!ratio.is_nan(), "SH coefficient {k} is not a number");
        sh = sh.max(ratio);
    }
    let c = |s: &Scene, i: usize| {
        covariance::coordinates(s.rotations[i], s.log_scales[i]).map(f64::from)
    };
    let covariance = bound.ratio(merged, decoded, steps.covariance, c);
    Ok(vec![("opacity", opacity), ("SH", sh), ("covariance", covariance)])
}

fn lossless(scene: &Scene, in_order: bool) -> Result<ChainOutcome> {
    let encoded = gsvx::encode_lossless(scene, in_order)?;
    let decoded = gsvx::decode(&encoded.bytes)?;
    let (mut want, mut got) = (rows(scene), rows(&decoded));
    if !in_order {
        want.sort_unstable();
        got.sort_unstable();
    }
    ensure!(want == got, "a float came back with other bits");
    Ok(Ok(vec![("every float", 0.0)]))
}

/// Distance of each input mean from its leaf's centre, per axis, over half the leaf's side.
fn displacement(scene: &Scene, voxels: &Voxelization) -> f64 {
    let mut worst = 0.0f64;
    for (leaf, &l) in voxels.octree().leaves().iter().enumerate() {
        let centre = voxels.octree().cube().leaf_centre(l, voxels.octree().depth());
        let half = voxels.octree().cube().cell(l.depth) / 2.0;
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
    fn of(classes: &[u8], voxels: &Voxelization) -> Self {
        let fineness = |&c: &u8| libm::exp2(f64::from(importance::MEAN_CLASS) - f64::from(c));
        let n = classes.len() as f64;
        Self {
            fineness: classes.iter().map(fineness).collect(),
            path: (3.0 * f64::from(voxels.octree().depth()) + 1.0).min(n.sqrt()),
            rounding: 4.0 / 65536.0,
        }
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

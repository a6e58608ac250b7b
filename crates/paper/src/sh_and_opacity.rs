//! Section 2.4: SH coefficients and opacity.
//!
//! SH coefficients are converted to YUV. Each channel, and the opacity, goes through RAHT and is "uniformly
//! quantized and [...] entropy coded using the run-length Golomb-Rice (RLGR) algorithm". The opacity is
//! coded as its logit, as in the authors' code.

use gpcc_lite::paper::rlgr;
use gpcc_lite::raht::RahtPlan;
use gs_model::{Scene, sh_len};
use rayon::prelude::*;

use crate::container::{ContainerReader, ContainerWriter};
use crate::error::{Error, Result, coding};

/// Quantisation parameters, 0 to 51. The step is `2^((qp - 4) / 6)` 255ths of a channel's range, as in the
/// authors' code, which quantises to 8 bits before it transforms.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Qp {
    /// Q_ac, of all SH coefficients of degree 1 and up; the authors use 4 to 40.
    pub ac: u8,
    /// Q_dc, of the base colour; the authors use 4 to 28.
    pub dc: u8,
    /// Q_op, of the opacity; the authors use 4 to 40.
    pub opacity: u8,
}

impl Qp {
    pub(crate) fn check(&self) -> Result<()> {
        for (name, value) in [("Q_ac", self.ac), ("Q_dc", self.dc), ("Q_op", self.opacity)] {
            if value > 51 {
                return Err(Error::Option { name, value, range: "0 to 51" });
            }
        }
        Ok(())
    }
}

/// Opacity logits outside this range are moved to its ends: no rasterizer shows the difference.
const LOGITS: [f32; 2] = [-8.0, 12.0];

/// What a channel holds.
#[derive(Clone, Copy)]
pub(crate) enum Channel {
    Opacity,
    /// One of Y, U, V of an SH coefficient.
    Sh {
        coefficient: usize,
        plane: usize,
    },
}

/// The channels in the order of the stream.
pub(crate) fn channels(sh_degree: u8) -> Vec<Channel> {
    let of = |c| Channel::Sh { coefficient: c / 3, plane: c % 3 };
    std::iter::once(Channel::Opacity).chain((0..3 * sh_len(sh_degree)).map(of)).collect()
}

impl Channel {
    pub(crate) fn qp(self, qp: &Qp) -> u8 {
        match self {
            Self::Opacity => qp.opacity,
            Self::Sh { coefficient: 0, .. } => qp.dc,
            Self::Sh { .. } => qp.ac,
        }
    }

    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Opacity => "opacity",
            Self::Sh { coefficient: 0, .. } => "DC",
            Self::Sh { coefficient: 1..4, .. } => "SH degree 1",
            Self::Sh { coefficient: 4..9, .. } => "SH degree 2",
            Self::Sh { .. } => "SH degree 3",
        }
    }

    /// Its values, one per Gaussian.
    pub(crate) fn values(self, scene: &Scene) -> Vec<f64> {
        match self {
            Self::Opacity => {
                let logit = |v: &f32| f64::from(v.clamp(LOGITS[0], LOGITS[1]));
                scene.opacity_logits.iter().map(logit).collect()
            }
            Self::Sh { coefficient, plane } => {
                (0..scene.len()).map(|i| yuv(scene.sh_of(i)[coefficient])[plane]).collect()
            }
        }
    }
}

/// Writes opacity and SH coefficients of the Gaussians at the leaves of `plan`.
pub(crate) fn encode(
    scene: &Scene,
    plan: &RahtPlan,
    qp: &Qp,
    out: &mut ContainerWriter,
) -> Result<()> {
    let all = channels(scene.sh_degree);
    let code = |c: &Channel| {
        let values = c.values(scene);
        let step = step(c.qp(qp), &values);
        encode_channel(plan, values, step, c.name())
    };
    let coded: Vec<Vec<u8>> = all.par_iter().map(code).collect::<Result<_>>()?;
    all.iter().zip(&coded).for_each(|(channel, bytes)| out.block(channel.name(), bytes));
    Ok(())
}

/// Reads opacity logits and SH coefficients.
pub(crate) fn decode(
    input: &mut ContainerReader<'_>,
    plan: &RahtPlan,
    sh_degree: u8,
) -> Result<(Vec<f32>, Vec<[f32; 3]>)> {
    let logits = decode_channel(plan, input.block("opacity")?, "opacity")?;
    let k = sh_len(sh_degree);
    let mut sh = vec![[0.0; 3]; plan.len() * k];
    // One coefficient after the other: three channels in double precision take little memory.
    for coefficient in 0..k {
        let channel = |plane| Channel::Sh { coefficient, plane }.name();
        let blocks =
            [0, 1, 2].map(|plane| Ok::<_, Error>((input.block(channel(plane))?, channel(plane))));
        let [y, u, v] = blocks;
        let decoded: Vec<Vec<f64>> = [y?, u?, v?]
            .into_par_iter()
            .map(|(block, name)| decode_channel(plan, block, name))
            .collect::<Result<_>>()?;
        for (i, sh) in sh.iter_mut().skip(coefficient).step_by(k).enumerate() {
            *sh = rgb([decoded[0][i], decoded[1][i], decoded[2][i]]);
        }
    }
    Ok((logits.into_iter().map(finite).collect(), sh))
}

/// A level is the magnitude in steps plus this, rounded down: what TMC13 does with RAHT coefficients.
const ROUNDING: f64 = 1.0 / 3.0;

/// The step of a QP for a channel.
pub(crate) fn step(qp: u8, values: &[f64]) -> f32 {
    let (mut min, mut max) = (f64::INFINITY, f64::NEG_INFINITY);
    for &v in values {
        min = min.min(v);
        max = max.max(v);
    }
    let range = if max > min { max - min } else { 1.0 };
    let step = range / 255.0 * libm::exp2((f64::from(qp) - 4.0) / 6.0);
    // No coefficient is more than the greatest value times the root of their number; levels are i32.
    let greatest = min.abs().max(max.abs()) * (values.len() as f64).sqrt();
    let least = if values.is_empty() { 0.0 } else { greatest / f64::from(1 << 30) };
    (step.max(least) as f32).clamp(f32::MIN_POSITIVE, f32::MAX)
}

/// Codes the values of all leaves, step first: RAHT without weights, a uniform quantiser, RLGR.
pub(crate) fn encode_channel(
    plan: &RahtPlan,
    mut values: Vec<f64>,
    step: f32,
    name: &'static str,
) -> Result<Vec<u8>> {
    plan.forward_f64(&mut values).map_err(coding(name))?;
    let level = |v: &f64| {
        let steps = v / f64::from(step);
        (steps.abs() + ROUNDING).floor().copysign(steps) as i32
    };
    let levels: Vec<i32> = values.iter().map(level).collect();
    let mut out = step.to_le_bytes().to_vec();
    out.extend(rlgr::encode(&levels));
    Ok(out)
}

/// Decodes what [`encode_channel`] coded.
pub(crate) fn decode_channel(
    plan: &RahtPlan,
    coded: &[u8],
    name: &'static str,
) -> Result<Vec<f64>> {
    let mut coded = ContainerReader(coded);
    let step = coded.float(name)?;
    let levels = rlgr::decode(coded.0, plan.len()).map_err(coding(name))?;
    let mut values: Vec<f64> = levels.into_iter().map(|l| f64::from(l) * step).collect();
    plan.inverse_f64(&mut values).map_err(coding(name))?;
    Ok(values)
}

/// In single precision; what is beyond its range becomes its ends.
pub(crate) fn finite(v: f64) -> f32 {
    (v as f32).clamp(f32::MIN, f32::MAX)
}

const LUMA: f64 = 0.577_350_269_189_625_8;
const RED_BLUE: f64 = std::f64::consts::FRAC_1_SQRT_2;
const GREEN: f64 = 0.408_248_290_463_863;

/// Luma and two chroma planes of a coefficient of the three colours; orthonormal, as RAHT is.
fn yuv(rgb: [f32; 3]) -> [f64; 3] {
    let [r, g, b] = rgb.map(f64::from);
    [(r + g + b) / 3.0f64.sqrt(), (r - b) * RED_BLUE, (2.0 * g - r - b) / 6.0f64.sqrt()]
}

/// The inverse of [`yuv`].
fn rgb([y, u, v]: [f64; 3]) -> [f32; 3] {
    let [y, u, v] = [y * LUMA, u * RED_BLUE, v * GREEN];
    [y + u - v, y + v + v, y - u - v].map(finite)
}

#[cfg(test)]
mod tests {
    use testing::{Rng, trained_like};
    use voxel::Strategy;

    use super::*;

    #[test]
    fn channels_come_back_within_their_steps() {
        let scene = trained_like(3000, 3, &mut Rng::seeded(5));
        let voxelized = crate::voxelize(&scene, &Strategy::paper(5, 9)).unwrap();
        let plan = RahtPlan::new(voxelized.voxels.octree().clone());
        let qp = Qp { ac: 28, dc: 4, opacity: 16 };
        for channel in channels(3) {
            let values = channel.values(&voxelized.scene);
            let step = step(channel.qp(&qp), &values);
            let coded = encode_channel(&plan, values.clone(), step, "").unwrap();
            let back = decode_channel(&plan, &coded, "").unwrap();
            let square: f64 = values.iter().zip(&back).map(|(a, b)| (a - b) * (a - b)).sum();
            let error = (square / values.len() as f64).sqrt();
            // A coefficient is at most two thirds of a step off, and the transform is orthonormal.
            assert!(error > 0.0 && error <= 0.667 * f64::from(step), "{error}, {step}");
        }
    }

    #[test]
    fn six_more_of_a_qp_double_the_step() {
        for (qp, wanted) in [(4, 1.0), (10, 2.0), (16, 4.0), (28, 16.0)] {
            assert!((step(qp, &[-55.0, 0.0, 200.0]) - wanted).abs() < 1e-5, "{qp}");
        }
    }

    #[test]
    fn colours_come_back() {
        for colour in [[0.3, -1.5, 2.25], [1.0; 3], [0.0, 0.0, -7.0]] {
            let back = rgb(yuv(colour));
            assert!((0..3).all(|k| (back[k] - colour[k]).abs() < 1e-6), "{back:?}");
        }
        assert!(yuv([1.0; 3])[1..].iter().all(|c| c.abs() < 1e-15));
    }

    #[test]
    fn levels_fit_however_little_values_differ() {
        let root = gpcc_lite::Leaf { morton: 0, depth: 0 };
        let plan = RahtPlan::new(gpcc_lite::Octree::of_points(0, vec![root]).unwrap());
        for value in [1e30, -3.4e38, 1e-45, 0.0] {
            let coded = encode_channel(&plan, vec![value], step(4, &[value]), "").unwrap();
            let back = decode_channel(&plan, &coded, "").unwrap()[0];
            assert!((back - value).abs() <= 1e-2 + 1e-8 * value.abs(), "{back} {value}");
        }
        let mut many = vec![5.0; 10_000];
        many[0] += 1e-12;
        assert!(step(4, &many) >= 5.0 * 100.0 / 1.1e9);
    }
}

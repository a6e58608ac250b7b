//! Attributes as the authors give them to tmc3: integers over each channel's range.

use gs_model::Scene;

use crate::cloud::Channels;

/// Least and greatest value of each channel.
pub(super) type Ranges = Vec<[f64; 2]>;

/// What one run of tmc3 codes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Part {
    /// DC as YUV.
    Dc,
    /// The group of three consecutive AC coefficients of one colour channel: as the authors'
    /// code groups them, across frequencies.
    Ac(usize),
    /// Opacity logit.
    Opacity,
    /// A log-scale.
    Scale(usize),
    /// A component of the quaternion.
    Rotation(usize),
}

/// The runs of a scene of an SH degree; DC first.
pub(super) fn parts(sh_degree: u8) -> Vec<Part> {
    let ac = (usize::from(sh_degree) + 1).pow(2) - 1;
    let mut all = vec![Part::Dc, Part::Opacity];
    all.extend((0..ac).map(Part::Ac));
    all.extend((0..3).map(Part::Scale));
    all.extend((0..4).map(Part::Rotation));
    all
}

/// SH coefficients of a Gaussian per colour channel.
fn bases(scene: &Scene) -> usize {
    (usize::from(scene.sh_degree) + 1).pow(2)
}

/// Index into `Scene::sh` and colour channel of the `flat`-th AC coefficient of Gaussian `i` in
/// Inria's channel-major order.
fn ac_at(bases: usize, i: usize, flat: usize) -> (usize, usize) {
    (i * bases + 1 + flat % (bases - 1), flat / (bases - 1))
}

fn to_yuv([r, g, b]: [f64; 3]) -> [f64; 3] {
    [
        0.2126 * r + 0.7152 * g + 0.0722 * b,
        -0.114_572 * r - 0.385_428 * g + 0.5 * b,
        0.5 * r - 0.454_153 * g - 0.045_847 * b,
    ]
}

fn to_rgb([y, u, v]: [f64; 3]) -> [f64; 3] {
    [y + 1.5748 * v, y - 0.187_32 * u - 0.468_12 * v, y + 1.8556 * u]
}

fn range(values: impl Iterator<Item = f64>) -> [f64; 2] {
    values.fold([f64::INFINITY, f64::NEG_INFINITY], |[l, h], v| [l.min(v), h.max(v)])
}

/// Truncated, not rounded: as the authors do.
fn quantise(value: f64, [low, high]: [f64; 2], most: f64) -> f64 {
    if high > low { ((value - low) / (high - low) * most).floor() } else { 0.0 }
}

fn restore(integer: f64, [low, high]: [f64; 2], most: f64) -> f64 {
    if high > low { integer / most * (high - low) + low } else { low }
}

impl Part {
    /// Whether it has three channels.
    pub(super) fn is_colour(self) -> bool {
        matches!(self, Self::Dc | Self::Ac(_))
    }

    fn triple(self, scene: &Scene, i: usize) -> [f64; 3] {
        let n = bases(scene);
        match self {
            Self::Dc => scene.sh[i * n].map(f64::from),
            Self::Ac(group) => [0, 1, 2].map(|k| {
                let (at, channel) = ac_at(n, i, 3 * group + k);
                f64::from(scene.sh[at][channel])
            }),
            _ => [0.0; 3],
        }
    }

    fn scalar(self, scene: &Scene, i: usize) -> f64 {
        f64::from(match self {
            Self::Opacity => scene.opacity_logits[i],
            Self::Scale(k) => scene.log_scales[i][k],
            Self::Rotation(k) => scene.rotations[i][k],
            _ => 0.0,
        })
    }

    /// The integers to code, and the ranges that restore them.
    pub(super) fn take(self, scene: &Scene) -> (Channels, Ranges) {
        let n = scene.len();
        if self.is_colour() {
            let yuv: Vec<[f64; 3]> = (0..n).map(|i| to_yuv(self.triple(scene, i))).collect();
            let ranges: Ranges = (0..3).map(|k| range(yuv.iter().map(|v| v[k]))).collect();
            let whole = |v: &[f64; 3]| [0, 1, 2].map(|k| quantise(v[k], ranges[k], 255.0) as u8);
            return (Channels::Colour(yuv.iter().map(whole).collect()), ranges);
        }
        let ends = range((0..n).map(|i| self.scalar(scene, i)));
        let whole = |i: usize| quantise(self.scalar(scene, i), ends, 65535.0) as u16;
        (Channels::Scalar((0..n).map(whole).collect()), vec![ends])
    }

    /// Writes decoded integers back.
    pub(super) fn put(self, scene: &mut Scene, decoded: &Channels, ranges: &Ranges) {
        let n = bases(scene);
        match decoded {
            Channels::Colour(all) => {
                for (i, v) in all.iter().enumerate() {
                    let yuv = [0, 1, 2].map(|k| restore(f64::from(v[k]), ranges[k], 255.0));
                    let rgb = to_rgb(yuv).map(|x| x as f32);
                    if let Self::Ac(group) = self {
                        for k in 0..3 {
                            let (at, channel) = ac_at(n, i, 3 * group + k);
                            scene.sh[at][channel] = rgb[k];
                        }
                    } else {
                        scene.sh[i * n] = rgb;
                    }
                }
            }
            Channels::Scalar(all) => {
                for (i, &v) in all.iter().enumerate() {
                    let x = restore(f64::from(v), ranges[0], 65535.0) as f32;
                    match self {
                        Self::Scale(k) => scene.log_scales[i][k] = x,
                        Self::Rotation(k) => scene.rotations[i][k] = x,
                        _ => scene.opacity_logits[i] = x,
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_taken_and_put_back_is_near() {
        let n = 50;
        let noise = |seed: usize| ((seed * 2_654_435_761) % 1000) as f32 / 1000.0 - 0.5;
        let scene = Scene {
            means: (0..n).map(|i| [i as f32, 0.0, 0.0]).collect(),
            rotations: (0..n).map(|i| [1.0, noise(i), noise(i + 1), noise(i + 2)]).collect(),
            log_scales: (0..n).map(|i| [noise(3 * i), noise(5 * i), noise(7 * i)]).collect(),
            opacity_logits: (0..n).map(noise).collect(),
            sh_degree: 2,
            sh: (0..9 * n).map(|i| [noise(i), noise(i + 11), noise(i + 23)]).collect(),
        };
        let mut back = scene.clone();
        for part in parts(scene.sh_degree) {
            let (integers, ranges) = part.take(&scene);
            part.put(&mut back, &integers, &ranges);
        }
        assert_eq!(parts(scene.sh_degree).len(), 2 + 8 + 7);
        let near = |a: f32, b: f32, by: f32| assert!((a - b).abs() < by, "{a} {b}");
        for i in 0..9 * n {
            (0..3).for_each(|c| near(scene.sh[i][c], back.sh[i][c], 0.02));
        }
        for i in 0..n {
            near(scene.opacity_logits[i], back.opacity_logits[i], 1e-4);
            (0..3).for_each(|k| near(scene.log_scales[i][k], back.log_scales[i][k], 1e-4));
            (0..4).for_each(|k| near(scene.rotations[i][k], back.rotations[i][k], 1e-4));
        }
    }
}

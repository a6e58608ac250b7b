//! Quantisation in the loop: the fine-tune renders what a decoder would have.

use gs_model::Scene;
use rayon::prelude::*;

/// How attributes are disturbed before they are rendered.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum QuantizationMode {
    /// Rounded to multiples of the step; the gradient passes straight through.
    #[default]
    StraightThrough,
    /// Uniform noise of one step's width, fresh in every iteration.
    UniformNoise,
}

/// Quantises the attributes before they are rendered, as the codec does, so that the model becomes
/// robust against it. Steps are absolute, in the space of [`Scene`]'s arrays. An attribute whose step
/// is zero stays as it is.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Quantization {
    /// How attributes are disturbed.
    pub mode: QuantizationMode,
    /// Step of the SH DC coefficients.
    pub sh_dc: f32,
    /// Step of the other SH coefficients.
    pub sh_rest: f32,
    /// Step of the opacity logits.
    pub opacity_logit: f32,
    /// Step of the log-scales.
    pub log_scale: f32,
    /// Step of the quaternions' components, after normalisation.
    pub rotation: f32,
}

/// A hash of three words as a uniform number in -0.5..0.5. Any thread can compute any entry, because
/// it does not depend on other entries.
fn noise(seed: u32, step: u32, index: u32) -> f32 {
    let mut h = seed ^ step.wrapping_mul(0x9e37_79b9) ^ index.wrapping_mul(0x85eb_ca6b);
    h ^= h >> 16;
    h = h.wrapping_mul(0x7feb_352d);
    h ^= h >> 15;
    h = h.wrapping_mul(0x846c_a68b);
    h ^= h >> 16;
    (h >> 8) as f32 / 16_777_216.0 - 0.5
}

impl Quantization {
    pub(crate) fn is_idle(&self) -> bool {
        [self.sh_dc, self.sh_rest, self.opacity_logit, self.log_scale, self.rotation]
            .iter()
            .all(|&s| s == 0.0)
    }

    /// Writes the disturbed parameters of `scene` to `out`.
    pub(crate) fn apply(&self, scene: &Scene, seed: u64, step: u64, out: &mut Scene) {
        out.clone_from(scene);
        let (seed, step) = ((seed ^ (seed >> 32)) as u32, step as u32);
        let disturb = |value: f32, width: f32, class: u32, index: usize| {
            if width == 0.0 {
                return value;
            }
            match self.mode {
                QuantizationMode::StraightThrough => (value / width).round_ties_even() * width,
                QuantizationMode::UniformNoise => {
                    value
                        + noise(seed ^ class.wrapping_mul(0xc2b2_ae35), step, index as u32) * width
                }
            }
        };
        let k = scene.sh_len();
        out.sh.par_iter_mut().enumerate().for_each(|(i, v)| {
            let width = if i % k == 0 { self.sh_dc } else { self.sh_rest };
            for ch in 0..3 {
                v[ch] = disturb(v[ch], width, 0, 3 * i + ch);
            }
        });
        out.opacity_logits
            .par_iter_mut()
            .enumerate()
            .for_each(|(i, v)| *v = disturb(*v, self.opacity_logit, 1, i));
        out.log_scales.par_iter_mut().enumerate().for_each(|(i, v)| {
            for c in 0..3 {
                v[c] = disturb(v[c], self.log_scale, 2, 3 * i + c);
            }
        });
        if self.rotation != 0.0 {
            out.rotations.par_iter_mut().enumerate().for_each(|(i, q)| {
                let norm = q.iter().map(|c| c * c).sum::<f32>().sqrt();
                for c in 0..4 {
                    // Relative to the norm, which the projection divides by.
                    q[c] = disturb(q[c] / norm, self.rotation, 3, 4 * i + c) * norm;
                }
            });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scene() -> Scene {
        Scene {
            means: vec![[0.0; 3]; 100],
            rotations: (0..100).map(|i| [1.0, i as f32 * 0.1, 0.3, -0.2]).collect(),
            log_scales: (0..100).map(|i| [i as f32 * 0.037; 3]).collect(),
            opacity_logits: (0..100).map(|i| i as f32 * 0.0173).collect(),
            sh_degree: 1,
            sh: (0..400).map(|i| [i as f32 * 0.00271; 3]).collect(),
        }
    }

    #[test]
    fn rounding_hits_multiples_and_noise_stays_within_half_a_step() {
        let scene = scene();
        for mode in [QuantizationMode::StraightThrough, QuantizationMode::UniformNoise] {
            let q = Quantization { mode, sh_rest: 0.25, log_scale: 0.5, ..Default::default() };
            let mut out = Scene::default();
            q.apply(&scene, 3, 9, &mut out);
            assert_eq!(out.opacity_logits, scene.opacity_logits);
            assert_eq!(out.rotations, scene.rotations);
            let mut moved = 0;
            for (i, (a, b)) in scene.sh.iter().zip(&out.sh).enumerate() {
                if i % 4 == 0 {
                    assert_eq!(a, b, "DC has no step");
                }
                moved += usize::from(a != b);
                assert!((a[0] - b[0]).abs() <= 0.126);
                if mode == QuantizationMode::StraightThrough && i % 4 != 0 {
                    assert_eq!((b[0] / 0.25).fract(), 0.0);
                }
            }
            assert!(moved > 250, "{moved}");
        }
    }

    #[test]
    fn noise_is_centred_and_depends_on_step_and_seed() {
        let mean: f64 = (0..100_000).map(|i| f64::from(noise(1, 2, i))).sum::<f64>() / 1e5;
        assert!(mean.abs() < 3e-3, "{mean}");
        assert_ne!(noise(1, 2, 3), noise(1, 3, 3));
        assert_ne!(noise(1, 2, 3), noise(2, 2, 3));
    }
}

//! Errors of the attributes of one model against another.

use gs_model::Scene;
use gsvx::covariance::coordinates;
use rayon::prelude::*;
use rstar::RTree;
use rstar::primitives::GeomWithData;
use serde_json::{Value, json};
use std::collections::BTreeMap;

/// How the Gaussians of the two models were paired.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Pairing {
    /// Row by row: as many in both, each within its own size of its partner.
    Rows,
    /// Each of the second model with the nearest of the first.
    Nearest,
}

/// Root-mean-square errors over the pairs.
pub(crate) struct AttributeErrors {
    pairing: Pairing,
    pairs: usize,
    /// World units, and in diagonals of the first model's bounding box.
    mean: [f64; 2],
    /// Frobenius norm of the difference of the log-Euclidean shape matrices: natural logarithms.
    shape: f64,
    /// After the sigmoid.
    opacity: f64,
    /// Per coefficient and channel, SH degree 0 to 3; degrees that one model lacks count as 0.
    sh: Vec<f64>,
}

impl AttributeErrors {
    /// Compares `b` with `a`; `None` if one of them is empty.
    pub(crate) fn of(a: &Scene, b: &Scene) -> Option<Self> {
        if a.is_empty() || b.is_empty() {
            return None;
        }
        let (pairing, partner) = pair(a, b)?;
        let n = b.len();
        let rms = |f: &(dyn Fn(usize, usize) -> f64 + Sync)| {
            // Summed in index order over fixed chunks: the same for any number of threads.
            const CHUNK: usize = 4096;
            let sums: Vec<f64> = partner
                .par_chunks(CHUNK)
                .enumerate()
                .map(|(c, part)| {
                    part.iter().enumerate().map(|(j, &i)| f(i as usize, c * CHUNK + j)).sum()
                })
                .collect();
            (sums.iter().sum::<f64>() / n as f64).sqrt()
        };
        let mean = rms(&|i, j| distance2(a.means[i], b.means[j]));
        let sigmoid = |v: f32| 1.0 / (1.0 + libm::exp(-f64::from(v)));
        let shape = rms(&|i, j| {
            let p = coordinates(a.rotations[i], a.log_scales[i]);
            let q = coordinates(b.rotations[j], b.log_scales[j]);
            p.iter().zip(q).map(|(x, y)| f64::from(x - y) * f64::from(x - y)).sum()
        });
        let opacity = rms(&|i, j| {
            let d = sigmoid(a.opacity_logits[i]) - sigmoid(b.opacity_logits[j]);
            d * d
        });
        let degrees = a.sh_degree.max(b.sh_degree);
        let sh = (0..=usize::from(degrees)).map(|d| {
            let range = d * d..(d + 1) * (d + 1);
            let at = |s: &Scene, i: usize, k: usize| s.sh_of(i).get(k).copied().unwrap_or_default();
            let width = (3 * range.len()) as f64;
            rms(&|i, j| {
                let sum: f64 = range.clone().map(|k| distance2(at(a, i, k), at(b, j, k))).sum();
                sum / width
            })
        });
        let sh = sh.collect();
        Some(Self { pairing, pairs: n, mean: [mean, mean / diagonal(a)], shape, opacity, sh })
    }

    /// Lines for a person.
    pub(crate) fn human(&self) -> String {
        let how = match self.pairing {
            Pairing::Rows => "row by row",
            Pairing::Nearest => "each of the second model with the nearest of the first",
        };
        let mut text = format!(
            "attributes, root-mean-square over {} pairs ({how}):\n  \
             mean       {:.3e} ({:.3e} of the bounding box)\n  \
             shape      {:.4} (log-Euclidean)\n  \
             opacity    {:.5}\n",
            self.pairs, self.mean[0], self.mean[1], self.shape, self.opacity
        );
        for (degree, error) in self.sh.iter().enumerate() {
            text += &format!("  SH {degree}       {error:.5}\n");
        }
        text
    }

    /// The same as JSON.
    pub(crate) fn json(&self) -> Value {
        json!({
            "pairing": match self.pairing { Pairing::Rows => "rows", Pairing::Nearest => "nearest" },
            "pairs": self.pairs,
            "mean": self.mean[0],
            "mean_of_bounding_box": self.mean[1],
            "shape_log_euclidean": self.shape,
            "opacity": self.opacity,
            "sh": self.sh,
        })
    }
}

/// For each Gaussian of `b` its partner in `a`.
fn pair(a: &Scene, b: &Scene) -> Option<(Pairing, Vec<u32>)> {
    // Row order is right wherever a converter kept it; nearest means would mispair Gaussians that
    // lie closer than the error.
    if a.len() == b.len() {
        let near = (0..a.len()).into_par_iter().filter(|&i| {
            let size = a.log_scales[i].iter().copied().fold(f32::NEG_INFINITY, f32::max);
            distance2(a.means[i], b.means[i]).sqrt() <= libm::exp(f64::from(size))
        });
        if near.count() * 100 >= a.len() * 99 {
            return Some((Pairing::Rows, (0..a.len() as u32).collect()));
        }
    }
    // Of several in one place the first counts, and of several equally near.
    let places = (0..a.len()).rev().map(|i| (a.means[i].map(f32::to_bits), i as u32));
    let places = places.collect::<BTreeMap<_, _>>().into_iter();
    let point = |mean: [f32; 3]| mean.map(f64::from);
    let place = |(mean, i): ([u32; 3], _)| GeomWithData::new(point(mean.map(f32::from_bits)), i);
    let tree = RTree::bulk_load(places.map(place).collect());
    let nearest = |&mean| tree.nearest_neighbors(&point(mean)).iter().map(|near| near.data).min();
    let partner: Option<Vec<u32>> = b.means.par_iter().map(nearest).collect();
    Some((Pairing::Nearest, partner?))
}

fn distance2(a: [f32; 3], b: [f32; 3]) -> f64 {
    a.iter().zip(b).map(|(&x, y)| f64::from(x) - f64::from(y)).map(|d| d * d).sum()
}

/// Diagonal of the bounding box; 1 if that is a point.
fn diagonal(scene: &Scene) -> f64 {
    let [low, high] = scene.bounds();
    let d = distance2(low, high).sqrt();
    if d > 0.0 { d } else { 1.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scene() -> Scene {
        let at = |i: usize| i as f32;
        Scene {
            means: (0..50).map(|i| [at(i), at(i * i % 7), at(i % 3)]).collect(),
            rotations: (0..50).map(|i| [1.0, 0.1 * at(i % 5), 0.0, 0.2]).collect(),
            log_scales: (0..50).map(|i| [-2.0, -1.0 - 0.01 * at(i), -3.0]).collect(),
            opacity_logits: (0..50).map(|i| 0.1 * at(i) - 2.0).collect(),
            sh_degree: 1,
            sh: (0..200).map(|i| [0.01 * at(i), 0.0, -0.3]).collect(),
            ..Scene::default()
        }
    }

    #[test]
    fn a_model_has_no_error_against_itself_in_any_order() {
        let a = scene();
        let reversed: Vec<usize> = (0..50).rev().collect();
        for (b, pairing) in [(a.clone(), Pairing::Rows), (a.select(&reversed), Pairing::Nearest)] {
            let e = AttributeErrors::of(&a, &b).unwrap();
            assert_eq!(e.pairing, pairing);
            assert!(e.mean[0] == 0.0 && e.shape == 0.0 && e.opacity == 0.0);
            assert_eq!(e.sh, [0.0, 0.0]);
        }
        assert!(AttributeErrors::of(&a, &Scene::default()).is_none());
    }

    #[test]
    fn errors_are_root_mean_squares_in_stated_units() {
        let a = scene();
        let mut b = a.clone();
        b.means.iter_mut().for_each(|m| m[0] += 0.03);
        b.log_scales.iter_mut().for_each(|l| l[1] += 0.5);
        b.sh.iter_mut().for_each(|c| c[2] += 0.3);
        let e = AttributeErrors::of(&a, &b).unwrap();
        assert!((e.mean[0] - 0.03).abs() < 1e-5 && (e.shape - 0.5).abs() < 1e-5);
        // One channel of three.
        assert!((e.sh[1] - 0.3 / 3f64.sqrt()).abs() < 1e-5, "{:?}", e.sh);
    }
}

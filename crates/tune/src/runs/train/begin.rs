//! The scene that training begins with: a Gaussian at each point of a COLMAP model.

use gs_model::colmap::Point;
use gs_model::{SH_C0, Scene};
use rayon::prelude::*;
use rstar::RTree;
use rstar::primitives::GeomWithData;

/// Neighbours whose mean distance is the size of a Gaussian.
const NEIGHBOURS: usize = 3;
/// Opacity, as in gsplat's MCMC preset, and the size over that distance. The preset has a size of 0.1, which takes
/// thousands of steps to grow. With 1, lone points are veils in front of everything: bonsai is at 22.0 dB after 600
/// steps, with 0.1 at 14.0 after 300, and with 0.5 at 24.5 after 600.
const OPACITY: f32 = 0.5;
const SIZE: f64 = 0.5;
/// Least size, in world units.
const LEAST: f64 = 1e-7;

/// A round Gaussian of one colour at each point.
pub(super) fn begin(points: &[Point], sh_degree: u8) -> Scene {
    let mut scene = Scene::zeros(points.len(), sh_degree);
    let of = |(i, p): (usize, &Point)| GeomWithData::new(p.position, i);
    let tree = RTree::bulk_load(points.iter().enumerate().map(of).collect());
    let size = |(i, p): (usize, &Point)| {
        let others = tree.nearest_neighbor_iter(p.position).filter(|n| n.data != i);
        let distances: Vec<f64> =
            others.take(NEIGHBOURS).map(|n| distance(n.geom(), &p.position)).collect();
        let mean = distances.iter().sum::<f64>() / distances.len().max(1) as f64;
        libm::log((SIZE * mean).max(LEAST)) as f32
    };
    let log_sizes: Vec<f32> = points.par_iter().enumerate().map(size).collect();
    let per_gaussian = scene.sh_len();
    for (i, (p, s)) in points.iter().zip(log_sizes).enumerate() {
        scene.means[i] = p.position.map(|v| v as f32);
        scene.log_scales[i] = [s; 3];
        scene.rotations[i] = [1.0, 0.0, 0.0, 0.0];
        scene.opacity_logits[i] = logit(OPACITY);
        scene.sh[i * per_gaussian] = p.colour.map(|v| (f32::from(v) / 255.0 - 0.5) / SH_C0);
    }
    scene
}

fn distance(a: &[f64; 3], b: &[f64; 3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum::<f64>().sqrt()
}

/// The logit of an opacity between 0 and 1.
pub(super) fn logit(opacity: f32) -> f32 {
    libm::logf(opacity / (1.0 - opacity))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_gaussian_is_half_as_large_as_its_neighbours_are_far() {
        let at = |x: f64| Point { position: [x, 0.0, 0.0], colour: [255, 0, 128] };
        let scene = begin(&[0.0, 1.0, 2.0, 6.0].map(at), 2);
        scene.validate().unwrap();
        assert!((libm::expf(scene.log_scales[0][0]) - 1.5).abs() < 1e-6);
        assert!((libm::expf(scene.log_scales[3][2]) - 2.5).abs() < 1e-6);
        assert!((0.5 + SH_C0 * scene.sh[9][0] - 1.0).abs() < 1e-6);
        // A single point, and points on one place.
        begin(&[at(0.0)], 0).validate().unwrap();
        begin(&[at(3.0); 5], 0).validate().unwrap();
    }
}

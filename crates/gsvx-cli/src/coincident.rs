//! Gaussians at one position: a leaf of the octree holds one Gaussian, so they are merged at any quality.

use gs_model::Scene;

/// Number of Gaussians whose mean is exactly that of another.
pub(crate) fn count(scene: &Scene) -> u64 {
    // Adding zero makes -0 equal to 0.
    let bits = |mean: &[f32; 3]| mean.map(|x| (x + 0.0).to_bits());
    let mut means: Vec<[u32; 3]> = scene.means.iter().map(bits).collect();
    means.sort_unstable();
    let groups = means.chunk_by(|a, b| a == b).map(<[_]>::len);
    groups.filter(|&n| n > 1).sum::<usize>() as u64
}

#[cfg(test)]
mod tests {
    #[test]
    fn all_that_share_a_position_count() {
        let mut scene = testing::trained_like(5, 0, &mut testing::Rng::seeded(1));
        assert_eq!(super::count(&scene), 0);
        scene.means[3] = [0.0, 1.0, 2.0];
        scene.means[4] = [-0.0, 1.0, 2.0];
        assert_eq!(super::count(&scene), 2);
    }
}

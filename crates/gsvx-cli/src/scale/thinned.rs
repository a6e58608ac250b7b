//! [`ThinnedModel`]: a scene that fits in memory instead of one that does not, to compare photos with.

use gs_model::Scene;

/// Most Gaussians.
const MOST: usize = 1 << 18;

/// Every so many Gaussians of a scene that is read in pieces, larger by as much as they are fewer, without view dependence.
#[derive(Debug)]
pub(super) struct ThinnedModel {
    kept: Scene,
    /// One Gaussian in this many is kept.
    step: usize,
    /// Gaussians before the next one that is kept.
    skipped: usize,
    most: usize,
}

impl Default for ThinnedModel {
    fn default() -> Self {
        Self { kept: Scene::default(), step: 1, skipped: 0, most: MOST }
    }
}

impl ThinnedModel {
    pub(super) fn add(&mut self, piece: &Scene) {
        let chosen: Vec<usize> = (self.skipped..piece.len()).step_by(self.step).collect();
        self.skipped += chosen.len() * self.step;
        self.skipped -= piece.len();
        self.kept.append(&piece.select(&chosen));
        while self.kept.len() > self.most {
            // The next one is a multiple of the new step, too.
            self.skipped += self.step * (self.kept.len() % 2);
            let even: Vec<usize> = (0..self.kept.len()).step_by(2).collect();
            self.kept = self.kept.select(&even);
            self.step *= 2;
        }
    }

    pub(super) fn scene(self) -> Scene {
        let mut scene = self.kept;
        let larger = 0.5 * libm::log(self.step as f64) as f32;
        scene.log_scales.as_flattened_mut().iter_mut().for_each(|scale| *scale += larger);
        scene
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_same_gaussians_are_kept_whatever_the_pieces() {
        let whole = testing::trained_like(1000, 1, &mut testing::Rng::seeded(3));
        let thinned = |piece: usize| {
            let mut few = ThinnedModel { most: 100, ..ThinnedModel::default() };
            for first in (0..whole.len()).step_by(piece) {
                let indices: Vec<usize> = (first..whole.len().min(first + piece)).collect();
                few.add(&whole.select(&indices));
            }
            few.scene()
        };
        let wanted: Vec<[f32; 3]> = whole.means.iter().step_by(16).copied().collect();
        for piece in [1, 7, 16, 333, 1000] {
            let scene = thinned(piece);
            assert_eq!((scene.sh_degree, &scene.means), (0, &wanted), "pieces of {piece}");
            let larger = scene.log_scales[1][0] - whole.log_scales[16][0];
            assert!((larger - libm::logf(4.0)).abs() < 1e-5, "{larger}");
        }
    }
}

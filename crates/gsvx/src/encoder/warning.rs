//! What the user of a stream should know: warnings, and why a stream misses its aim.

use super::encoded::{CoarseCells, EncodedStream};
use super::measure::Measure;
use gs_model::Scene;
use std::fmt;

/// Why a stream misses its aim.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum MissedAim {
    /// The smallest stream is larger.
    Bytes {
        /// Bytes at most.
        wanted: u64,
        /// Bytes of the smallest stream.
        smallest: u64,
    },
    /// The best stream is worse.
    Alike {
        /// What is measured.
        measure: Measure,
        /// Its value at least.
        wanted: f64,
        /// That of the best stream.
        best: f64,
    },
}

impl fmt::Display for MissedAim {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Bytes { wanted, smallest } => write!(
                f,
                "the target of {wanted} bytes is below the smallest stream of this scene, {smallest} bytes; \
                 pruning, or a lower SH degree, makes smaller ones"
            ),
            Self::Alike { measure, wanted, best } => write!(
                f,
                "its renders reach {}, not {wanted:.2}: quality 100 is the best there is; lossless coding keeps every \
                 float",
                measure.words(*best)
            ),
        }
    }
}

/// What the user of a stream should know.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum EncodeWarning {
    /// No rasterizer draws any of the model's Gaussians; the stream has none.
    AllTransparent(u64),
    /// Positions err visibly.
    CoarseCells(CoarseCells),
    /// Gaussians share their positions with others, and were merged.
    Coincident(u64),
    /// Many Gaussians lie so far from the others that they are coded exactly.
    ManyOutliers {
        /// Such Gaussians.
        outliers: u64,
        /// All Gaussians of the stream.
        gaussians: u64,
        /// Their share of the bytes, from 0 to 1.
        byte_share: f64,
    },
}

impl fmt::Display for EncodeWarning {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::AllTransparent(n) => write!(
                f,
                "the stream is empty: all {n} Gaussians of the model have an opacity below 1/255, which no \
                 rasterizer draws; lossless coding keeps them"
            ),
            Self::CoarseCells(coarse) => write!(
                f,
                "parts of the scene lie so far apart, or differ so much in size, that positions come in steps of \
                 {} times the size of its {} Gaussians, which shows at any quality; encode each part apart, or \
                 with bounds on the errors, or lossless",
                short(coarse.cells),
                coarse.which()
            ),
            Self::Coincident(n) => write!(
                f,
                "{n} Gaussians share their position with another; a leaf of the octree holds one Gaussian, so they \
                 are merged at any quality; bounds on the errors, or lossless coding, keep each"
            ),
            Self::ManyOutliers { outliers, gaussians, byte_share } => write!(
                f,
                "{outliers} of the stream's {gaussians} Gaussians lie so far from the others that the octree does \
                 not reach them; they are coded exactly, which takes {:.0} % of the bytes; encode each part apart \
                 for a smaller size",
                100.0 * byte_share
            ),
        }
    }
}

/// A number with two digits or more.
fn short(v: f64) -> String {
    if v < 10.0 { format!("{v:.1}") } else { format!("{v:.0}") }
}

/// The warnings on a lossy stream of a scene.
pub(crate) fn warnings(scene: &Scene, encoded: &EncodedStream) -> Vec<EncodeWarning> {
    let mut all: Vec<_> =
        encoded.coarse_cells.into_iter().map(EncodeWarning::CoarseCells).collect();
    if encoded.max_error.is_some() {
        return all;
    }
    let (before, gaussians) =
        ((scene.len() - encoded.transparent) as u64, encoded.index.header.count);
    if before == 0 && encoded.transparent > 0 {
        all.push(EncodeWarning::AllTransparent(encoded.transparent as u64));
    }
    let merged = before.saturating_sub(gaussians);
    // Counting takes time, and shows nothing where little was merged.
    if merged > before / 20 {
        let coincident = coincident(scene);
        all.extend((coincident > merged / 2).then_some(EncodeWarning::Coincident(coincident)));
    }
    let outliers = encoded.outliers() as u64;
    if outliers > gaussians / 10 {
        let byte_share = encoded.exact_share();
        all.push(EncodeWarning::ManyOutliers { outliers, gaussians, byte_share });
    }
    all
}

/// Number of Gaussians whose mean is exactly that of another.
fn coincident(scene: &Scene) -> u64 {
    // Adding zero makes -0 equal to 0.
    let bits = |mean: &[f32; 3]| mean.map(|x| (x + 0.0).to_bits());
    let mut means: Vec<[u32; 3]> = scene.means.iter().map(bits).collect();
    means.sort_unstable();
    let groups = means.chunk_by(|a, b| a == b).map(<[_]>::len);
    groups.filter(|&n| n > 1).sum::<usize>() as u64
}

#[cfg(test)]
mod tests {
    use super::coincident;

    #[test]
    fn all_that_share_a_position_count() {
        let mut scene = testing::trained_like(5, 0, &mut testing::Rng::seeded(1));
        assert_eq!(coincident(&scene), 0);
        scene.means[3] = [0.0, 1.0, 2.0];
        scene.means[4] = [-0.0, 1.0, 2.0];
        assert_eq!(coincident(&scene), 2);
    }
}

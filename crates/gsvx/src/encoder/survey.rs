//! What one pass over a scene finds: its extent, the sizes of its Gaussians, the SH degree in use.
//!
//! Invariant: the result does not depend on the order of the Gaussians, nor on how they are divided into parts.

use super::check::used_degree;
use super::encoded::CoarseCells;
use crate::error::Result;
use gpcc_lite::Cube;
use gpcc_lite::morton::MAX_DEPTH;
use gs_model::math::{ascending, of_ascending};
use gs_model::{Scene, is_point};

/// Sizes are counted by the first 16 bits of their floats: to within 0.8 %.
const SIZE_BITS: u32 = 16;
/// Cells of this part of the median Gaussian's largest axis are worth a warning. Two rooms 1e4 units apart, with 0.07,
/// lose 1 dB at quality 75; 1e5 units apart, with 0.7, 15 dB.
const COARSE: f64 = 0.2;
/// The same for the small Gaussians of a scene whose median one is large: a tenth of all are below one cell.
const COARSE_FOR_SMALL: f64 = 1.0;

/// What is known of the Gaussians seen so far.
#[derive(Clone, Debug)]
pub struct Survey {
    count: u64,
    /// Gaussians that have an extent.
    sized: u64,
    low: [f32; 3],
    high: [f32; 3],
    /// How many Gaussians have a log-scale of their largest axis in each class.
    sizes: Vec<u64>,
    most_degree: u8,
    degree: u8,
    /// See [`Scene::antialiased`].
    pub(crate) antialiased: bool,
    /// See [`Scene::origin`].
    pub(crate) origin: [f64; 3],
}

impl Survey {
    /// No Gaussian yet. SH degrees above `max_sh_degree` do not count.
    #[must_use]
    pub fn new(max_sh_degree: u8) -> Self {
        Self {
            count: 0,
            sized: 0,
            low: [f32::INFINITY; 3],
            high: [f32::NEG_INFINITY; 3],
            sizes: vec![0; 1 << SIZE_BITS],
            most_degree: max_sh_degree,
            degree: 0,
            antialiased: false,
            origin: [0.0; 3],
        }
    }

    /// Of one scene, without its SH degree.
    ///
    /// # Errors
    /// [`crate::Error::Voxel`] if a mean is not finite.
    pub(crate) fn of(scene: &Scene) -> Result<Self> {
        voxel::cube_of(&scene.means)?;
        let mut survey = Self::new(0);
        survey.add(scene);
        Ok(survey)
    }

    /// Counts valid Gaussians in. A stream as [`crate::encode`] makes it has none that [`Scene::drawn`] leaves out. All
    /// scenes have the same origin, and all or none are antialiased.
    pub fn add(&mut self, scene: &Scene) {
        if self.count == 0 {
            (self.antialiased, self.origin) = (scene.antialiased, scene.origin);
        }
        self.count += scene.len() as u64;
        for mean in &scene.means {
            for k in 0..3 {
                self.low[k] = self.low[k].min(mean[k]);
                self.high[k] = self.high[k].max(mean[k]);
            }
        }
        for log_scale in scene.log_scales.iter().filter(|s| !is_point(**s)) {
            self.sized += 1;
            let size = log_scale.iter().copied().fold(f32::NEG_INFINITY, f32::max);
            self.sizes[(ascending(size.to_bits()) >> (32 - SIZE_BITS)) as usize] += 1;
        }
        if !scene.is_empty() && scene.sh_degree.min(self.most_degree) > self.degree {
            self.degree = self.degree.max(used_degree(scene, self.most_degree));
        }
    }

    /// Gaussians.
    #[must_use]
    pub fn count(&self) -> u64 {
        self.count
    }

    /// The highest SH degree with a coefficient that is not zero.
    #[must_use]
    pub(crate) fn sh_degree(&self) -> u8 {
        self.degree
    }

    /// The cube of all means, which are finite.
    #[must_use]
    pub(crate) fn cube(&self) -> Cube {
        match self.count {
            0 => Cube::spanning([0.0; 3], [0.0; 3]),
            _ => Cube::spanning(self.low, self.high),
        }
    }

    /// The median of the logarithms of the largest axes, to within 0.8 %; `None` without Gaussians that have a size.
    pub(crate) fn median_log_scale(&self) -> Option<f64> {
        self.log_scale_of(self.sized / 2)
    }

    /// How coarse the finest cells are, if positions err visibly; see [`crate::EncodedStream::coarse_cells`]. Outliers must not
    /// be among the Gaussians.
    pub(crate) fn coarse_cells(&self) -> Option<CoarseCells> {
        let cell = self.cube().side * libm::exp2(-f64::from(MAX_DEPTH));
        let of = |place: u64| Some(cell / libm::exp(self.log_scale_of(place)?));
        if let Some(cells) = of(self.sized / 2).filter(|&cells| cells > COARSE) {
            return Some(CoarseCells { cells, of_small: false });
        }
        let cells = of(self.sized / 10).filter(|&cells| cells > COARSE_FOR_SMALL)?;
        Some(CoarseCells { cells, of_small: true })
    }

    /// The logarithm of the largest axis at this place in ascending order, counted from 0.
    fn log_scale_of(&self, place: u64) -> Option<f64> {
        let mut left = place;
        let class = self.sizes.iter().position(|&n| {
            let found = left < n;
            left = left.saturating_sub(n);
            found
        })?;
        Some(f32::from_bits(of_ascending((class as u32) << (32 - SIZE_BITS))).into())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_median_is_that_of_a_sort() {
        let mut scene = testing::trained_like(2001, 1, &mut testing::Rng::seeded(4));
        for (i, scale) in scene.log_scales.iter_mut().enumerate() {
            scale[0] += (i % 13) as f32 - 6.0;
        }
        let largest = |l: &[f32; 3]| l.iter().copied().fold(f32::NEG_INFINITY, f32::max);
        let mut sizes: Vec<f32> = scene.log_scales.iter().map(largest).collect();
        sizes.sort_by(f32::total_cmp);
        let exact = f64::from(sizes[1000]);
        let mut parts = Survey::new(3);
        parts.add(&scene.select(&(1200..2001).collect::<Vec<_>>()));
        parts.add(&Scene::default());
        parts.add(&scene.select(&(0..1200).collect::<Vec<_>>()));
        let found = parts.median_log_scale().unwrap();
        assert!((found - exact).abs() <= 0.008 * exact.abs(), "{found}, not {exact}");
        assert_eq!(parts.cube(), voxel::cube_of(&scene.means).unwrap());
        assert_eq!((parts.count(), parts.sh_degree()), (2001, 1));
        assert_eq!(Survey::new(3).median_log_scale(), None);
        assert_eq!(Survey::new(3).cube(), voxel::cube_of(&[]).unwrap());
    }

    /// Two copies of a scene, a distance apart.
    fn pair(distance: f32) -> Scene {
        let one = testing::trained_like(2000, 0, &mut testing::Rng::seeded(5));
        let mut both = one.clone();
        both.append(&one);
        both.means[2000..].iter_mut().for_each(|p| p[0] += distance);
        both
    }

    #[test]
    fn two_parts_far_apart_have_a_warning() {
        let median = libm::exp(Survey::of(&pair(1.0)).unwrap().median_log_scale().unwrap());
        for (cells, wanted) in [(0.01, false), (0.15, false), (0.3, true), (3.0, true)] {
            let both = pair((cells * median * libm::exp2(21.0)) as f32);
            let told = Survey::of(&both).unwrap().coarse_cells();
            assert_eq!(told.is_some(), wanted, "{cells}");
            let right = |t: CoarseCells| (t.cells / cells - 1.0).abs() < 0.1 && !t.of_small;
            assert!(told.is_none_or(right), "{told:?}, not {cells}");
        }
        assert_eq!(Survey::new(0).coarse_cells(), None);
    }

    #[test]
    fn a_two_centimetre_part_of_a_large_scene_has_a_warning() {
        let mut both = pair(0.0);
        // The second half is as large as all others, the first a millionth of that.
        for i in 0..2000 {
            both.means[i] = both.means[i].map(|x| 1e-6 * x);
            both.log_scales[i] = both.log_scales[i].map(|l| l - 13.8);
        }
        both.append(&pair(0.0).select(&(0..100).collect::<Vec<_>>()));
        let told = Survey::of(&both).unwrap().coarse_cells().expect("a warning");
        assert!(told.of_small && told.cells > 1.0, "{told:?}");
    }
}

//! [`Precision`]: how finely numbers are written.

/// How finely numbers are written.
pub(super) struct Precision {
    /// Distances of the numbers in the codebooks of log-scales, of colours, and of higher SH coefficients; none: the 256
    /// numbers that fit best.
    pub(super) steps: [Option<f32>; 3],
    /// Gaussians for each entry of the palette, or up to twice as many.
    pub(super) share: usize,
    /// Steps of a byte of a rotation or an opacity, an even number.
    pub(super) byte_steps: f64,
    /// The least step of positions, in sizes of a small Gaussian.
    pub(super) spacing: f64,
}

// The numbers for chunks are about those at which each kind adds as much to the error of pictures of la_fontaine.
impl Precision {
    pub(super) const FULL: Self =
        Self { steps: [None; 3], share: 1, byte_steps: 255.0, spacing: 0.0 };
    /// Of a chunk of the finest level.
    pub(super) const FINEST: Self = Self {
        steps: [Some(0.12), Some(0.05), Some(0.015)],
        share: 4,
        byte_steps: 64.0,
        spacing: 0.25,
    };
    /// Of a chunk of a coarser level, which streams code with fewer bits too.
    pub(super) const COARSER: Self = Self {
        steps: [Some(0.2), Some(0.08), Some(0.1)],
        share: 8,
        byte_steps: 14.0,
        spacing: 0.25,
    };
}

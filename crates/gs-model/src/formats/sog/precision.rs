//! [`Precision`]: how finely numbers are written.

/// How finely numbers are written.
pub(super) struct Precision {
    /// Most numbers in a codebook.
    pub(super) entries: usize,
    /// Gaussians for each entry of the palette, or up to twice as many.
    pub(super) share: usize,
    /// Steps of a byte of a rotation or an opacity, an even number.
    pub(super) steps: f64,
    /// The least step of positions, in sizes of a small Gaussian.
    pub(super) spacing: f64,
}

impl Precision {
    pub(super) const FULL: Self = Self { entries: 256, share: 1, steps: 255.0, spacing: 0.0 };
    /// Of a chunk of the finest level. Of la_fontaine, coded at quality 50, `gsvx lod --format sog` writes 97 bits for each
    /// Gaussian of it.
    pub(super) const FINEST: Self = Self { entries: 64, share: 8, steps: 64.0, spacing: 0.125 };
    /// Of a chunk of a coarser level, which streams code with fewer bits too.
    pub(super) const COARSER: Self = Self { entries: 16, share: 8, steps: 24.0, spacing: 0.5 };
}

//! [`RenderOptions`] and [`Profile`].

/// Which pixels a Gaussian affects.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Profile {
    /// Those inside the contour where alpha falls below 1/255; tiles are tested exactly. The default.
    #[default]
    Tight,
    /// As Inria's 2023 rasterizer: all tiles that touch the square of half-width
    /// `ceil(3 sqrt(lambda_max))` around the mean. Differs from [`Profile::Tight`] where the
    /// 1/255 contour of an opaque Gaussian leaves that square's tiles.
    Reference,
}

/// How to render.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RenderOptions {
    /// Which pixels a Gaussian affects.
    pub profile: Profile,
    /// Background colour, RGB.
    pub background: [f32; 3],
}

/// Adam's learning rates per attribute, in the space of the scene's arrays. The defaults are
/// those of the reference implementation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LearningRates {
    /// SH degree 0.
    pub sh_dc: f32,
    /// SH degrees 1 to 3.
    pub sh_rest: f32,
    /// Opacity logits.
    pub opacity: f32,
    /// Log-scales.
    pub log_scale: f32,
    /// Quaternions.
    pub rotation: f32,
}

impl Default for LearningRates {
    fn default() -> Self {
        Self {
            sh_dc: 0.0025,
            sh_rest: 0.0025 / 20.0,
            opacity: 0.05,
            log_scale: 0.005,
            rotation: 0.001,
        }
    }
}

/// What the fine-tune minimises.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Loss {
    /// Mean squared error over pixels and channels, as in the paper's equation 2.
    Mse,
    /// `(1 - ssim_weight) L1 + ssim_weight (1 - SSIM)`; the reference code uses 0.2. SSIM has
    /// an 11x11 Gaussian window of sigma 1.5 and zero padding.
    L1Ssim {
        /// Weight of the SSIM term.
        ssim_weight: f32,
    },
}

impl Default for Loss {
    fn default() -> Self {
        Self::L1Ssim { ssim_weight: 0.2 }
    }
}

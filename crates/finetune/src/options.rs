//! [`RenderOptions`] and [`Profile`].

/// Longest edge of an image that is drawn, in pixels. Callers refuse cameras that are larger.
pub const MAX_EDGE: u32 = 1 << 14;

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

/// What the fine-tune minimises: a weighted sum of three means over pixels and channels. No weight is negative.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Loss {
    /// Weight of the absolute error.
    pub l1: f32,
    /// Weight of the squared error.
    pub mse: f32,
    /// Weight of 1 - SSIM. SSIM has an 11x11 Gaussian window of sigma 1.5 and zero padding.
    pub ssim: f32,
}

impl Loss {
    /// The squared error alone: the paper's equation 2.
    pub const MSE: Self = Self { l1: 0.0, mse: 1.0, ssim: 0.0 };
    /// That of the reference code of 3DGS: 0.8 L1 + 0.2 (1 - SSIM).
    pub const L1_SSIM: Self = Self { l1: 0.8, mse: 0.0, ssim: 0.2 };

    /// The squared error and `ssim` (1 - SSIM).
    #[must_use]
    pub const fn mse_ssim(ssim: f32) -> Self {
        Self { ssim, ..Self::MSE }
    }
}

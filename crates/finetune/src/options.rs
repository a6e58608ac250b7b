//! [`RenderOptions`] and [`Profile`].

/// Which pixels a Gaussian reaches.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Profile {
    /// Up to the contour where alpha falls below 1/255, tiles tested exactly. The default.
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
    /// Which pixels a Gaussian reaches.
    pub profile: Profile,
    /// Background colour, RGB.
    pub background: [f32; 3],
}

//! [`Image`].

/// An RGB image of floats: interleaved rows, top row first, 0 black and 1 white, with the
/// photo's own transfer curve (no conversion to linear light).
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Image {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// `3 * width * height` values.
    pub rgb: Vec<f32>,
}

impl Image {
    /// A black image.
    #[must_use]
    pub fn new(width: u32, height: u32) -> Self {
        Self { width, height, rgb: vec![0.0; 3 * width as usize * height as usize] }
    }

    /// From 8-bit RGB, value `v` becoming `v / 255`. `None` unless `rgb` holds
    /// `3 * width * height` bytes.
    #[must_use]
    pub fn from_rgb8(width: u32, height: u32, rgb: &[u8]) -> Option<Self> {
        let expected = 3 * u64::from(width) * u64::from(height);
        (rgb.len() as u64 == expected).then(|| Self {
            width,
            height,
            rgb: rgb.iter().map(|&v| f32::from(v) / 255.0).collect(),
        })
    }

    /// To 8-bit RGB: clamped to 0..=1 and rounded to nearest (NaN becomes 0).
    #[must_use]
    pub fn to_rgb8(&self) -> Vec<u8> {
        self.rgb.iter().map(|&v| (v.clamp(0.0, 1.0) * 255.0 + 0.5) as u8).collect()
    }
}

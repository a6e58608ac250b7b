//! [`Image`] and [`Photo`].

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

    /// To 8-bit RGB: clamped to 0..=1 and rounded to nearest (NaN becomes 0).
    #[must_use]
    pub fn to_rgb8(&self) -> Vec<u8> {
        self.rgb.iter().map(|&v| (v.clamp(0.0, 1.0) * 255.0 + 0.5) as u8).collect()
    }
}

/// A photo, or a render that is kept as one: interleaved rows of RGB, top row first, 8 bits per value.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Photo {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// `3 * width * height` values.
    pub rgb: Vec<u8>,
}

impl Photo {
    /// `None` unless `rgb` holds `3 * width * height` bytes.
    #[must_use]
    pub fn new(width: u32, height: u32, rgb: Vec<u8>) -> Option<Self> {
        let expected = 3 * u64::from(width) * u64::from(height);
        (rgb.len() as u64 == expected).then_some(Self { width, height, rgb })
    }

    /// A black photo.
    #[must_use]
    pub fn black(width: u32, height: u32) -> Self {
        Self { width, height, rgb: vec![0; 3 * width as usize * height as usize] }
    }

    /// Floats for computing: value `v` becomes `v / 255`.
    #[must_use]
    pub fn image(&self) -> Image {
        let rgb = self.rgb.iter().map(|&v| f32::from(v) / 255.0).collect();
        Image { width: self.width, height: self.height, rgb }
    }
}

impl From<&Image> for Photo {
    /// As [`Image::to_rgb8`].
    fn from(image: &Image) -> Self {
        Self { width: image.width, height: image.height, rgb: image.to_rgb8() }
    }
}

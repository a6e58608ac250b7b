//! A decoded WebP image.

use std::io::Cursor;

use image_webp::WebPDecoder;

/// Pixels that an image may have whatever its length, and pixels more per byte of all images. Real
/// scenes have about 0.1 pixels per byte. The bound stops a small file from claiming a large memory.
const FREE_PIXELS: u64 = 1 << 20;
const PIXELS_PER_BYTE: u64 = 4;

/// Most pixels of an image of a scene with these images.
pub(super) fn most_pixels(images: &[Vec<u8>]) -> u64 {
    let bytes: u64 = images.iter().map(|image| image.len() as u64).sum();
    FREE_PIXELS + PIXELS_PER_BYTE * bytes
}

pub(super) struct Texture {
    pub(super) width: usize,
    pub(super) height: usize,
    /// 3 where no pixel is transparent, else 4.
    channels: usize,
    data: Vec<u8>,
}

impl Texture {
    /// Decodes an image; an error is what is wrong with it.
    pub(super) fn decode(image: &[u8], most_pixels: u64) -> Result<Self, &'static str> {
        const BROKEN: &str = "not a whole WebP image";
        let mut decoder = WebPDecoder::new(Cursor::new(image)).map_err(|_| BROKEN)?;
        let (width, height) = decoder.dimensions();
        if u64::from(width) * u64::from(height) > most_pixels {
            return Err("it has far more pixels than its length gives reason for");
        }
        if decoder.is_animated() {
            return Err("it is an animation");
        }
        if decoder.is_lossy() {
            return Err("it is a lossy WebP image: its values are not those that were meant");
        }
        let channels = if decoder.has_alpha() { 4 } else { 3 };
        let mut data = vec![0; decoder.output_buffer_size().ok_or(BROKEN)?];
        decoder.read_image(&mut data).map_err(|_| BROKEN)?;
        Ok(Self { width: width as usize, height: height as usize, channels, data })
    }

    pub(super) fn pixels(&self) -> usize {
        self.width * self.height
    }

    /// Red, green, blue and alpha of a pixel, counted row by row.
    pub(super) fn pixel(&self, i: usize) -> [u8; 4] {
        let pixel = &self.data[i * self.channels..(i + 1) * self.channels];
        [pixel[0], pixel[1], pixel[2], pixel.get(3).copied().unwrap_or(255)]
    }
}

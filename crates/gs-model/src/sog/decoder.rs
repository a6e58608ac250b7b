//! How a Gaussian is decoded from its pixels.

use std::path::Path;

use super::malformed;
use super::meta::{Meta, Palette};
use super::texture::Texture;
use crate::error::Result;
use crate::math::completed;
use crate::rows::SH;
use crate::scene::sh_len;

/// Entries of the palette in a row of its image.
const PALETTE_ROW: usize = 64;
/// The alpha of a rotation is this plus the index, in w, x, y, z, of the component left out.
const LARGEST: u8 = 252;

pub(super) struct Decoder<'a> {
    meta: &'a Meta,
    textures: &'a [Texture],
    sh_len: usize,
}

/// One Gaussian.
pub(super) struct Row<'a> {
    decoder: &'a Decoder<'a>,
    means: [u16; 3],
    rotation: [f32; 4],
    scales: [u8; 4],
    colour: [u8; 4],
    /// Index in the palette, if the scene has one.
    entry: usize,
}

impl<'a> Decoder<'a> {
    /// `textures` are those of [`Meta::files`].
    pub(super) fn new(file: &Path, meta: &'a Meta, textures: &'a [Texture]) -> Result<Self> {
        let sh_len = sh_len(meta.sh_degree());
        for (at, (texture, name)) in textures.iter().zip(&meta.files).enumerate() {
            let (pixels, width) = (texture.pixels(), PALETTE_ROW * (sh_len - 1));
            if at == 5 && texture.width != width {
                let reason = format!("it is {} pixels wide, not {width}", texture.width);
                return Err(malformed(file, name, reason));
            }
            if at != 5 && pixels < meta.count {
                let reason = format!("it has {pixels} pixels for {} Gaussians", meta.count);
                return Err(malformed(file, name, reason));
            }
        }
        Ok(Self { meta, textures, sh_len })
    }

    pub(super) fn row(&self, i: usize) -> Row<'_> {
        let pixel = |texture: usize| self.textures[texture].pixel(i);
        let (low, high) = (pixel(0), pixel(1));
        let entry = self.textures.get(6).map_or(0, |texture| {
            let [low, high, ..] = texture.pixel(i);
            usize::from(u16::from_le_bytes([low, high]))
        });
        Row {
            decoder: self,
            means: [0, 1, 2].map(|k| u16::from_le_bytes([low[k], high[k]])),
            rotation: rotation(pixel(2)),
            scales: pixel(3),
            colour: pixel(4),
            entry,
        }
    }

    /// The byte of a palette entry's coefficient.
    fn coefficient(&self, palette: &Palette, entry: usize, k: usize) -> Option<[u8; 4]> {
        let texture = &self.textures[5];
        let (y, x) = (entry / PALETTE_ROW, entry % PALETTE_ROW * (self.sh_len - 1) + k - 1);
        let known = entry < palette.entries && y < texture.height;
        known.then(|| texture.pixel(y * texture.width + x))
    }
}

impl Row<'_> {
    /// Number `c` in scene order; NaN where an index points at nothing.
    pub(super) fn number(&self, c: usize) -> f32 {
        let meta = self.decoder.meta;
        let of =
            |values: &[f32], byte: u8| values.get(usize::from(byte)).copied().unwrap_or(f32::NAN);
        match c {
            0..3 => mean(meta.means, c, self.means[c]),
            3..7 => self.rotation[c - 3],
            7..10 => of(&meta.scales[c - 7], self.scales[c - 7]),
            10 => of(&meta.opacities, self.colour[3]),
            11..14 => of(&meta.colours[c - SH], self.colour[c - SH]),
            _ => {
                let (k, channel) = ((c - SH) / 3, (c - SH) % 3);
                meta.palette.as_ref().map_or(0.0, |palette| {
                    let pixel = self.decoder.coefficient(palette, self.entry, k);
                    pixel.map_or(f32::NAN, |p| of(&palette.values, p[channel]))
                })
            }
        }
    }
}

fn mean([low, high]: [[f64; 3]; 2], k: usize, step: u16) -> f32 {
    let (low, high) = (low[k], high[k]);
    let v = low + (high - low) * (f64::from(step) / 65535.0);
    libm::expm1(v.abs()).copysign(v) as f32
}

/// The quaternion of a pixel; without direction, and so invalid, if its alpha names no component.
fn rotation([a, b, c, alpha]: [u8; 4]) -> [f32; 4] {
    let Some(largest) = alpha.checked_sub(LARGEST).map(usize::from) else { return [0.0; 4] };
    let part = |byte| (f64::from(byte) / 255.0 * 2.0 - 1.0) * std::f64::consts::FRAC_1_SQRT_2;
    completed(largest, [a, b, c].map(part))
}

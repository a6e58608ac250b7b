//! How a Gaussian is decoded from its pixels.

use std::path::Path;

use super::malformed;
use super::meta::{Meta, Palette};
use super::texture::Texture;
use crate::error::Result;
use crate::math::completed;
use crate::rows::{self, SH};
use crate::scene::{Scene, sh_len};

/// Entries of the palette in a row of its image.
pub(super) const PALETTE_ROW: usize = 64;
/// The alpha of a rotation is this plus the index, in w, x, y, z, of the component left out.
pub(super) const LARGEST: u8 = 252;

/// The scene of these images, which are those of [`Meta::files`]. A number is NaN where an index points at
/// nothing.
pub(super) fn scene(file: &Path, meta: &Meta, textures: &[Texture]) -> Result<Scene> {
    let higher = sh_len(meta.sh_degree()) - 1;
    for (at, (texture, name)) in textures.iter().zip(&meta.files).enumerate() {
        let (pixels, width) = (texture.pixels(), PALETTE_ROW * higher);
        if at == 5 && texture.width != width {
            let reason = format!("it is {} pixels wide, not {width}", texture.width);
            return Err(malformed(file, name, reason));
        }
        if at != 5 && pixels < meta.count {
            let reason = format!("it has {pixels} pixels for {} Gaussians", meta.count);
            return Err(malformed(file, name, reason));
        }
    }
    let of = |values: &[f32], byte: u8| values.get(usize::from(byte)).copied().unwrap_or(f32::NAN);
    // The three values of the higher coefficient `k` of an entry of the palette.
    let coefficient = |palette: &Palette, entry: usize, k: usize| {
        let (y, x) = (entry / PALETTE_ROW, entry % PALETTE_ROW * higher + k);
        let known = entry < palette.entries && y < textures[5].height;
        known.then(|| textures[5].pixel(y * textures[5].width + x))
    };
    rows::scene_of(file, meta.count, meta.sh_degree(), |i| {
        let [low, high, scales, colour] = [0, 1, 3, 4].map(|texture| textures[texture].pixel(i));
        let rotation = rotation(textures[2].pixel(i));
        let entry = textures.get(6).map_or(0, |texture| {
            let [low, high, ..] = texture.pixel(i);
            usize::from(u16::from_le_bytes([low, high]))
        });
        move |c| match c {
            0..3 => mean(meta.means, c, u16::from_le_bytes([low[c], high[c]])),
            3..7 => rotation[c - 3],
            7..10 => of(&meta.scales[c - 7], scales[c - 7]),
            10 => of(&meta.opacities, colour[3]),
            11..14 => of(&meta.colours[c - SH], colour[c - SH]),
            _ => meta.palette.as_ref().map_or(0.0, |palette| {
                let (k, channel) = ((c - SH) / 3 - 1, (c - SH) % 3);
                let pixel = coefficient(palette, entry, k);
                pixel.map_or(f32::NAN, |p| of(&palette.values, p[channel]))
            }),
        }
    })
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

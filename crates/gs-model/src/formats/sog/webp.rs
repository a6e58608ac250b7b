//! Writes lossless WebP images of numbers. image-webp, which reads them, writes images that are a tenth larger.
//!
//! Pixels may be predicted from the left or from above, and red and blue from green. Bands of rows have prefix codes of
//! their own. Nothing is copied from earlier pixels: numbers of Gaussians do not repeat.

use super::prefix::{Bits, Code};

/// Symbols of the alphabets of green, red, blue, alpha and distance. Those of green beyond 255 are lengths of copies.
const ALPHABETS: [usize; 5] = [280, 256, 256, 256, 40];
/// The channels in the order of their alphabets.
const CHANNELS: [usize; 4] = [1, 0, 2, 3];
/// About the bits that the codes of a band take.
const BITS_OF_CODES: f64 = 5000.0;
/// Most bands.
const BANDS: usize = 256;
/// Pixels that are looked at to choose a prediction.
const SAMPLE: usize = 1 << 16;

pub(super) type Pixel = [u8; 4];

/// Where pixels are predicted from. The numbers are those of the format.
#[derive(Clone, Copy, PartialEq)]
enum Prediction {
    None,
    Left,
    Above,
}

/// How much of green is taken from red, of green from blue, and of red from blue, in parts of 32.
type Mix = [i8; 3];

/// How often each byte occurs in each channel.
type Counts = [[u32; 256]; 4];

/// The file of an image, whose sides are 1 to 16383 pixels.
pub(super) fn encode(width: usize, pixels: &[Pixel]) -> Vec<u8> {
    let height = pixels.len() / width;
    let mut bits = Bits::default();
    bits.put(0x2f, 8);
    bits.put(width as u32 - 1, 14);
    bits.put(height as u32 - 1, 14);
    bits.put(u32::from(pixels.iter().any(|p| p[3] != 255)), 1);
    bits.put(0, 3);
    let (prediction, mix) = choose(width, pixels);
    if prediction != Prediction::None {
        put_transform(&mut bits, 0, [0, prediction as u8, 0, 255], width, height);
    }
    if mix != Mix::default() {
        let [green_to_red, green_to_blue, red_to_blue] = mix.map(|part| part as u8);
        let element = [red_to_blue, green_to_blue, green_to_red, 255];
        put_transform(&mut bits, 1, element, width, height);
    }
    // No further transform, no cache of colours.
    bits.put(0, 2);
    let residuals: Vec<Pixel> =
        (0..pixels.len()).map(|i| mixed(mix, residual(width, pixels, i, prediction))).collect();
    let band_bits = best_bands(width, &residuals);
    bits.put(u32::from(band_bits.is_some()), 1);
    let Some(band_bits) = band_bits else {
        put_coded(&mut bits, &[&residuals]);
        return riff(bits.finish());
    };
    bits.put(band_bits - 2, 3);
    let bands: Vec<&[Pixel]> = residuals.chunks(width << band_bits).collect();
    let of_band = |band: usize| vec![[0, band as u8, 0, 255]; width.div_ceil(1 << band_bits)];
    put_image(&mut bits, &(0..bands.len()).flat_map(of_band).collect::<Vec<_>>());
    put_coded(&mut bits, &bands);
    riff(bits.finish())
}

/// Writes a transform whose tiles, of 512 pixels a side, all have one element.
fn put_transform(bits: &mut Bits, kind: u32, element: Pixel, width: usize, height: usize) {
    bits.put(1 | kind << 1, 3);
    bits.put(9 - 2, 3);
    put_image(bits, &vec![element; width.div_ceil(512) * height.div_ceil(512)]);
}

/// Writes an image that belongs to another one.
fn put_image(bits: &mut Bits, pixels: &[Pixel]) {
    bits.put(0, 1);
    put_coded(bits, &[pixels]);
}

/// Writes the codes of all bands, then their pixels.
fn put_coded(bits: &mut Bits, bands: &[&[Pixel]]) {
    let codes_of = |band: &&[Pixel]| -> Vec<Code> {
        let counts = counts(band.iter().copied());
        let code = |(alphabet, &symbols): (usize, &usize)| {
            let mut all = vec![0; symbols];
            if let Some(&channel) = CHANNELS.get(alphabet) {
                all[..256].copy_from_slice(&counts[channel]);
            }
            Code::of(&all)
        };
        ALPHABETS.iter().enumerate().map(code).collect()
    };
    let codes: Vec<Vec<Code>> = bands.iter().map(codes_of).collect();
    codes.iter().flatten().for_each(|code| code.put(bits));
    for (band, codes) in bands.iter().zip(&codes) {
        for pixel in *band {
            for (code, channel) in codes.iter().zip(CHANNELS) {
                code.put_symbol(bits, pixel[channel]);
            }
        }
    }
}

/// A pixel less what is predicted from its neighbours.
fn residual(width: usize, pixels: &[Pixel], i: usize, prediction: Prediction) -> Pixel {
    let from = match prediction {
        Prediction::None => return pixels[i],
        _ if i == 0 => [0, 0, 0, 255],
        // There is nothing above the first row, and nothing left of the first column.
        Prediction::Left if !i.is_multiple_of(width) => pixels[i - 1],
        _ if i < width => pixels[i - 1],
        _ => pixels[i - width],
    };
    std::array::from_fn(|k| pixels[i][k].wrapping_sub(from[k]))
}

/// Part of a number that is predicted from another channel.
fn part(of: i8, v: u8) -> u8 {
    ((i32::from(of) * i32::from(v as i8)) >> 5) as u8
}

fn mixed([green_to_red, green_to_blue, red_to_blue]: Mix, [r, g, b, a]: Pixel) -> Pixel {
    let blue = b.wrapping_sub(part(green_to_blue, g)).wrapping_sub(part(red_to_blue, r));
    [r.wrapping_sub(part(green_to_red, g)), g, blue, a]
}

fn counts(pixels: impl Iterator<Item = Pixel>) -> Counts {
    let mut counts = [[0; 256]; 4];
    pixels.for_each(|p| (0..4).for_each(|k| counts[k][usize::from(p[k])] += 1));
    counts
}

/// The bits of these bytes with the best codes.
fn entropy(counts: &[u32; 256]) -> f64 {
    let all = f64::from(counts.iter().sum::<u32>());
    let of = |&n: &u32| if n == 0 { 0.0 } else { f64::from(n) * libm::log2(all / f64::from(n)) };
    counts.iter().map(of).sum()
}

/// The best prediction by a sample of the pixels.
fn choose(width: usize, pixels: &[Pixel]) -> (Prediction, Mix) {
    let sample = || (0..pixels.len()).step_by(pixels.len().div_ceil(SAMPLE));
    let bits = |values: &[Pixel], mix: Mix| {
        let counts = counts(values.iter().map(|&p| mixed(mix, p)));
        counts.iter().map(entropy).sum::<f64>()
    };
    let options = [Prediction::None, Prediction::Left, Prediction::Above].map(|prediction| {
        let values: Vec<Pixel> = sample().map(|i| residual(width, pixels, i, prediction)).collect();
        let mut best = (bits(&values, [0; 3]), [0; 3]);
        // One part after the other; that of green in blue anew once that of red is known.
        for k in [0, 1, 2, 1] {
            for of in (-48..=64).step_by(8) {
                let mut mix: Mix = best.1;
                mix[k] = of;
                let now = bits(&values, mix);
                if now < best.0 {
                    best = (now, mix);
                }
            }
        }
        (best.0, prediction, best.1)
    });
    let [first, rest @ ..] = options;
    let best = rest.into_iter().fold(first, |best, now| if now.0 < best.0 { now } else { best });
    (best.1, best.2)
}

/// The binary logarithm of the rows of the bands that take the fewest bits; none where one code for all does.
fn best_bands(width: usize, residuals: &[Pixel]) -> Option<u32> {
    // Bands are made of thinner ones.
    let bytes = |counts: &Counts| counts.iter().map(entropy).sum::<f64>() + BITS_OF_CODES;
    let mut bands: Vec<Counts> =
        residuals.chunks(4 * width).map(|rows| counts(rows.iter().copied())).collect();
    let (mut best, mut bits) = (None, 2);
    let mut least = f64::INFINITY;
    loop {
        let all: f64 = bands.iter().map(bytes).sum();
        if bands.len() <= BANDS && all < least {
            (best, least) = ((bands.len() > 1).then_some(bits), all);
        }
        if bands.len() == 1 || bits == 9 {
            break;
        }
        bits += 1;
        let sum = |pair: &[Counts]| {
            let mut sum = pair[0];
            pair[1..].iter().for_each(|other| {
                sum.as_flattened_mut()
                    .iter_mut()
                    .zip(other.as_flattened())
                    .for_each(|(a, b)| *a += b);
            });
            sum
        };
        bands = bands.chunks(2).map(sum).collect();
    }
    best
}

/// The file around the bits.
fn riff(bits: Vec<u8>) -> Vec<u8> {
    let padded = bits.len().next_multiple_of(2);
    let mut file = Vec::with_capacity(padded + 20);
    file.extend(b"RIFF");
    file.extend((padded as u32 + 12).to_le_bytes());
    file.extend(b"WEBPVP8L");
    file.extend((bits.len() as u32).to_le_bytes());
    file.extend(&bits);
    file.resize(padded + 20, 0);
    file
}

#[cfg(test)]
mod tests {
    use image_webp::WebPDecoder;
    use proptest::prelude::*;

    use super::*;

    fn decoded(file: &[u8]) -> (u32, Vec<Pixel>) {
        let mut decoder = WebPDecoder::new(std::io::Cursor::new(file)).unwrap();
        let mut bytes = vec![0; decoder.output_buffer_size().unwrap()];
        decoder.read_image(&mut bytes).unwrap();
        let channels = if decoder.has_alpha() { 4 } else { 3 };
        let alpha = |p: &[u8]| p.get(3).copied().unwrap_or(255);
        let pixels = bytes.chunks(channels).map(|p| [p[0], p[1], p[2], alpha(p)]).collect();
        (decoder.dimensions().0, pixels)
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]

        #[test]
        fn pixels_come_back(width in 1usize..70, height in 1usize..70, kind in 0u32..6, seed: u64) {
            let mut state = seed;
            let mut next = || {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
                (state >> 56) as u8
            };
            // Flat, of two values, smooth along rows or columns with related channels, noise, noise with alpha.
            let pixels: Vec<Pixel> = (0..width * height).map(|i| {
                let v = next();
                let ramp = |at: usize| [(7 * at) as u8 ^ (v & 1), (7 * at) as u8, (5 * at) as u8, 255];
                match kind {
                    0 => [9, 8, 7, 255],
                    1 => [v & 1, 0, v & 128, 255],
                    2 => ramp(i % width),
                    3 => ramp(i / width),
                    4 => [v, next(), next(), 255],
                    _ => [v, next(), next(), next()],
                }
            }).collect();
            prop_assert_eq!(decoded(&encode(width, &pixels)), (width as u32, pixels));
        }
    }

    #[test]
    fn bands_of_unlike_rows_have_codes_of_their_own() {
        // A hundred rows of bytes below 4, then a hundred of larger ones: 2 bits each, rather than 3.
        let noise = |i: usize| (i as u32).wrapping_mul(0x9e37_79b9).wrapping_mul(0x85eb_ca6b) >> 30;
        let pixel = |i: usize| [0, noise(i) as u8 + 4 * u8::from(i >= 20_000), 0, 255];
        let pixels: Vec<Pixel> = (0..40_000).map(pixel).collect();
        let file = encode(200, &pixels);
        assert!(file.len() < 11_000, "{}", file.len());
        assert_eq!(decoded(&file).1, pixels);
    }
}

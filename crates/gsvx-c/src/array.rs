//! The arrays that come out: how wide they are, and how they are written.

use crate::error::{Error, Result};
use crate::plain::Array;
use gs_model::layout::{colour, covariances, packed, scale};
use gs_model::{Scene, sh_len};
use std::mem::MaybeUninit;

/// Bytes of a word.
const WORD: usize = 4;

impl Array {
    const ALL: [Self; 18] = [
        Self::Means,
        Self::Rotations,
        Self::LogScales,
        Self::OpacityLogits,
        Self::Sh,
        Self::Scales,
        Self::Colours,
        Self::Covariances,
        Self::ColourBytes,
        Self::ShBytes1,
        Self::ShBytes2,
        Self::ShBytes3,
        Self::PackedA,
        Self::PackedB,
        Self::PackedSh1,
        Self::PackedSh2,
        Self::PackedSh3a,
        Self::PackedSh3b,
    ];

    pub(crate) fn numbered(number: u32) -> Result<Self> {
        let found = Self::ALL.into_iter().find(|&array| array as u32 == number);
        let range = "one of gsvx_array";
        found.ok_or(Error::Argument { what: "array", value: number.into(), range })
    }

    /// Bytes for each Gaussian; 0 for an array of degrees that a scene does not have.
    pub(crate) fn stride(self, sh_degree: u8) -> usize {
        let words = match self {
            Self::OpacityLogits | Self::ColourBytes => 1,
            Self::Means | Self::LogScales | Self::Scales => 3,
            Self::Rotations | Self::Colours | Self::PackedA | Self::PackedB => 4,
            Self::Covariances => 6,
            Self::Sh => 3 * sh_len(sh_degree),
            _ => match (self.sh_bytes(), self.packed_sh()) {
                (Some(degree), _) if degree <= sh_degree.into() => {
                    covariances::SH_WORDS[degree - 1]
                }
                (_, Some(array)) if packed::SH_DEGREES[array] <= sh_degree => packed::WORDS,
                _ => 0,
            },
        };
        WORD * words
    }

    /// The degree of an array of bytes.
    fn sh_bytes(self) -> Option<usize> {
        [Self::ShBytes1, Self::ShBytes2, Self::ShBytes3]
            .iter()
            .position(|a| *a == self)
            .map(|at| at + 1)
    }

    /// The number of an array of packed SH coefficients.
    fn packed_sh(self) -> Option<usize> {
        let all = [Self::PackedSh1, Self::PackedSh2, Self::PackedSh3a, Self::PackedSh3b];
        all.iter().position(|a| *a == self)
    }

    /// Writes the array of a scene to the start of `out`, and returns how many bytes it has.
    pub(crate) fn write(self, scene: &Scene, out: &mut [MaybeUninit<u8>]) -> Result<usize> {
        let need = scene.len() * self.stride(scene.sh_degree);
        let have = out.len();
        let mut out = Words(out.get_mut(..need).ok_or(Error::Buffer { have, need })?);
        match self {
            Self::Means => out.floats(scene.means.as_flattened()),
            Self::Rotations => out.floats(scene.rotations.as_flattened()),
            Self::LogScales => out.floats(scene.log_scales.as_flattened()),
            Self::OpacityLogits => out.floats(&scene.opacity_logits),
            Self::Sh => out.floats(scene.sh.as_flattened()),
            _ if need == 0 => (),
            _ => (0..scene.len()).for_each(|i| self.write_one(scene, i, &mut out)),
        }
        Ok(need)
    }

    /// Writes one Gaussian of an array that is computed.
    fn write_one(self, scene: &Scene, i: usize, out: &mut Words<'_>) {
        match self {
            Self::Scales => out.floats(&scale(scene, i)),
            Self::Colours => out.floats(&colour(scene, i)),
            Self::Covariances => out.floats(&covariances::covariance(scene, i)),
            Self::ColourBytes => out.words([covariances::colour_word(scene, i)]),
            Self::PackedA => out.words(packed::a(scene, i)),
            Self::PackedB => out.words(packed::b(scene, i)),
            _ => match (self.sh_bytes(), self.packed_sh()) {
                (Some(degree), _) => out.words(covariances::sh_words(scene, i, degree)),
                (_, Some(array)) => out.words(packed::sh(scene, i, array)),
                _ => (),
            },
        }
    }
}

/// Bytes for each Gaussian; 0 for what is no array.
pub(crate) fn stride(array: u32, sh_degree: u32) -> usize {
    match (Array::numbered(array), u8::try_from(sh_degree)) {
        (Ok(array), Ok(degree @ 0..=3)) => array.stride(degree),
        _ => 0,
    }
}

/// The rest of a buffer, which is written from its start.
struct Words<'a>(&'a mut [MaybeUninit<u8>]);

impl Words<'_> {
    fn floats(&mut self, floats: &[f32]) {
        self.words(floats.iter().map(|v| v.to_bits()));
    }

    fn words(&mut self, words: impl IntoIterator<Item = u32>) {
        for word in words {
            let Some((bytes, rest)) = std::mem::take(&mut self.0).split_first_chunk_mut() else {
                return;
            };
            *bytes = word.to_ne_bytes().map(MaybeUninit::new);
            self.0 = rest;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_array_fills_exactly_its_stride() {
        for degree in 0..4 {
            let scene = testing::trained_like(5, degree, &mut testing::Rng::seeded(1));
            for (number, array) in Array::ALL.into_iter().enumerate() {
                assert_eq!(Array::numbered(number as u32).unwrap() as usize, number);
                let need = 5 * array.stride(degree);
                let mut out = vec![MaybeUninit::new(0xa5); need + 1];
                assert_eq!(array.write(&scene, &mut out).unwrap(), need, "{array:?}");
                if need == 0 {
                    continue;
                }
                let short = array.write(&scene, &mut out[..need - 1]);
                assert!(matches!(short, Err(Error::Buffer { .. })), "{array:?}");
                let mut words = Words(&mut out[..need]);
                array.write_one(&scene, 0, &mut words);
                let rest = words.0.len();
                assert!(number < 5 || need - rest == need / 5, "{array:?}: {rest} of {need} left");
            }
        }
        assert!(Array::numbered(18).is_err());
    }
}

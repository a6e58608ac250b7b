//! Codes nothing, where only the values that a decoder returns are wanted.

use super::Coder;
use crate::symbols::Symbols;

/// Takes what a [`RansEncoder`](super::RansEncoder) would write, and forgets it.
#[derive(Clone, Copy, Debug, Default)]
pub struct Silent;

impl Coder for Silent {
    const ENCODING: bool = true;
    const HEARD: bool = false;

    #[inline]
    fn decision(&mut self, _p1: u32, value: bool) -> bool {
        value
    }

    #[inline]
    fn symbol(&mut self, _model: &mut Symbols, value: usize) -> usize {
        value
    }

    #[inline]
    fn bits(&mut self, value: u32, _n: u32) -> u32 {
        value
    }

    #[inline]
    fn bits_and_sign(&mut self, _: u32, value: u32, _: u32, negative: bool) -> (u32, bool) {
        (value, negative)
    }

    fn exhausted(&self) -> bool {
        false
    }
}

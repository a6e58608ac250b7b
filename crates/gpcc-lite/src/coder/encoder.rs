//! Writes a stream: keeps all intervals, and codes them when the stream ends.

use super::{Coder, LOWEST, STATES};
use crate::bytes::{BitWriter, put_varint};
use crate::symbols::{SCALE_BITS, Symbols};

/// Intervals that an encoder keeps in one piece; a multiple of [`STATES`].
const BLOCK: usize = 1 << 16;

/// The encoder half of the [coder](super).
#[derive(Clone, Debug, Default)]
pub struct RansEncoder {
    /// Start in the low 16 bits, size in the high 16. In blocks, since a growing list would be in memory
    /// twice while it is moved.
    intervals: Vec<Vec<u32>>,
    plain: BitWriter,
}

impl RansEncoder {
    #[inline]
    fn interval(&mut self, start: u32, size: u32) {
        debug_assert!(size > 0 && start + size <= 1 << SCALE_BITS);
        match self.intervals.last_mut() {
            Some(block) if block.len() < BLOCK => block.push(start | size << 16),
            _ => {
                let mut block = Vec::with_capacity(BLOCK);
                block.push(start | size << 16);
                self.intervals.push(block);
            }
        }
    }

    /// True if nothing was coded yet.
    fn is_empty(&self) -> bool {
        self.intervals.is_empty() && self.plain.is_empty()
    }

    /// Ends the stream and returns its bytes: none if nothing was coded.
    #[must_use]
    pub fn finish(self) -> Vec<u8> {
        if self.is_empty() {
            return Vec::new();
        }
        let mut states = [LOWEST; STATES];
        let mut words: Vec<u16> = Vec::new();
        let blocks = self.intervals.into_iter().rev();
        let last_first = blocks.flat_map(|block| block.into_iter().enumerate().rev());
        for (i, interval) in last_first {
            let (start, size) = (interval & 0xffff, interval >> 16);
            let x = &mut states[i % STATES];
            // The result must stay below 2^32.
            if u64::from(*x) >= u64::from(size) << (32 - SCALE_BITS) {
                words.push(*x as u16);
                *x >>= 16;
            }
            *x = (*x / size) << SCALE_BITS | (*x % size + start);
        }
        let mut out = Vec::with_capacity(2 * words.len() + 32);
        put_varint(&mut out, words.len() as u64);
        out.extend(states.iter().flat_map(|x| x.to_le_bytes()));
        out.extend(words.iter().rev().flat_map(|w| w.to_le_bytes()));
        out.extend(self.plain.finish());
        out
    }
}

impl Coder for RansEncoder {
    const ENCODING: bool = true;

    #[inline]
    fn decision(&mut self, p1: u32, value: bool) -> bool {
        if value {
            self.interval(0, p1);
        } else {
            self.interval(p1, (1 << SCALE_BITS) - p1);
        }
        value
    }

    #[inline]
    fn symbol(&mut self, model: &mut Symbols, value: usize) -> usize {
        let (start, size) = model.interval(value);
        self.interval(start, size);
        model.learn(value);
        value
    }

    #[inline]
    fn bits(&mut self, value: u32, n: u32) -> u32 {
        self.plain.put(value, n);
        value
    }

    #[inline]
    fn bits_and_sign(&mut self, above: u32, value: u32, n: u32, negative: bool) -> (u32, bool) {
        self.plain.put(value, n);
        self.plain.put(u32::from(negative), u32::from(above | value != 0));
        (value, negative)
    }

    fn exhausted(&self) -> bool {
        false
    }
}

//! Bits, and the prefix codes of lossless WebP images.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// Most bits of a code word, and of a code word of the code of the lengths.
const LONGEST: u8 = 15;
const LONGEST_OF_LENGTHS: u8 = 7;
/// The order in which the lengths of the code of the lengths are written.
const ORDER: [usize; 19] = [17, 18, 0, 1, 2, 3, 4, 5, 16, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15];

/// Bits, low ones first.
#[derive(Default)]
pub(super) struct Bits {
    bytes: Vec<u8>,
    held: u64,
    count: u32,
}

impl Bits {
    pub(super) fn put(&mut self, value: u32, bits: u32) {
        self.held |= u64::from(value) << self.count;
        self.count += bits;
        while self.count >= 8 {
            self.bytes.push(self.held as u8);
            self.held >>= 8;
            self.count -= 8;
        }
    }

    /// All bytes, the last one filled up with zeros.
    pub(super) fn finish(mut self) -> Vec<u8> {
        self.put(0, 7);
        self.bytes
    }
}

/// A prefix code: the bits of each symbol, and how many.
pub(super) struct Code {
    words: Vec<(u32, u8)>,
    used: Vec<usize>,
}

impl Code {
    /// The best code of symbols that occur that often.
    pub(super) fn of(counts: &[u32]) -> Self {
        Self::within(counts, LONGEST)
    }

    fn within(counts: &[u32], longest: u8) -> Self {
        let used: Vec<usize> = (0..counts.len()).filter(|&s| counts[s] > 0).collect();
        Self { words: words(&lengths(counts, &used, longest)), used }
    }

    /// Writes the code.
    pub(super) fn put(&self, bits: &mut Bits) {
        match self.used[..] {
            [] => bits.put(0b0001, 4),
            [first] if first < 256 => self.put_short(bits, &[first]),
            [first, second] if second < 256 => self.put_short(bits, &[first, second]),
            _ => self.put_lengths(bits),
        }
    }

    /// Writes a code of one symbol, or two.
    fn put_short(&self, bits: &mut Bits, symbols: &[usize]) {
        let (first, is_byte) = (symbols[0] as u32, symbols[0] > 1);
        bits.put(1 | (symbols.len() as u32 - 1) << 1 | u32::from(is_byte) << 2, 3);
        bits.put(first, if is_byte { 8 } else { 1 });
        symbols[1..].iter().for_each(|&second| bits.put(second as u32, 8));
    }

    fn put_lengths(&self, bits: &mut Bits) {
        let mut counts = [0; ORDER.len()];
        self.words.iter().for_each(|&(_, length)| counts[usize::from(length)] += 1);
        let code = Self::within(&counts, LONGEST_OF_LENGTHS);
        bits.put(0, 1);
        bits.put(ORDER.len() as u32 - 4, 4);
        for symbol in ORDER {
            // A code of one symbol takes no bits, but has a length.
            let length = if code.used == [symbol] { 1 } else { code.words[symbol].1 };
            bits.put(length.into(), 3);
        }
        bits.put(0, 1);
        self.words.iter().for_each(|&(_, length)| code.put_symbol(bits, length));
    }

    /// Writes the word of a symbol.
    pub(super) fn put_symbol(&self, bits: &mut Bits, symbol: u8) {
        let (word, length) = self.words[usize::from(symbol)];
        bits.put(word, length.into());
    }
}

/// The length of each word of the best code (Huffman's); 0 where there is one symbol. Counts are halved until none is
/// too long.
fn lengths(counts: &[u32], used: &[usize], longest: u8) -> Vec<u8> {
    let mut lengths = vec![0; counts.len()];
    let mut weights: Vec<u64> = used.iter().map(|&s| counts[s].into()).collect();
    loop {
        // Nodes: the symbols, then pairs of nodes.
        let mut open: BinaryHeap<_> = (0..used.len()).map(|k| Reverse((weights[k], k))).collect();
        let mut pairs = Vec::new();
        while let (Some(Reverse(a)), Some(Reverse(b))) = (open.pop(), open.pop()) {
            open.push(Reverse((a.0 + b.0, used.len() + pairs.len())));
            pairs.push([a.1, b.1]);
        }
        let mut depths = vec![0u8; used.len() + pairs.len()];
        for (k, pair) in pairs.iter().enumerate().rev() {
            pair.iter().for_each(|&node| depths[node] = depths[used.len() + k] + 1);
        }
        if depths.iter().all(|&depth| depth <= longest) {
            used.iter().zip(depths).for_each(|(&s, depth)| lengths[s] = depth);
            return lengths;
        }
        weights.iter_mut().for_each(|weight| *weight = *weight / 2 + 1);
    }
}

/// The words of these lengths, first bit lowest: short before long, and in the order of the symbols.
fn words(lengths: &[u8]) -> Vec<(u32, u8)> {
    let mut words: Vec<(u32, u8)> = lengths.iter().map(|&length| (0, length)).collect();
    let mut next = 0u32;
    for length in 1..=LONGEST {
        for word in words.iter_mut().filter(|word| word.1 == length) {
            word.0 = next.reverse_bits() >> (32 - u32::from(length));
            next += 1;
        }
        next <<= 1;
    }
    words
}

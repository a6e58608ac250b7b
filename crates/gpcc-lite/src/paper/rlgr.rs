//! RLGR: adaptive run-length / Golomb-Rice coding (Malvar, DCC 2006), the entropy coder of the
//! paper.
//!
//! Two states adapt backwards, both scaled by `L`: `k_p` chooses between Golomb-Rice mode (`k = 0`)
//! and run mode with runs of `2^k` zeros; `k_rp` is the Rice parameter. The decoder knows the
//! number of values. So a run of zeros that reaches the end is written as one full run, whatever
//! its length. A full run is bit 0, a broken one bit 1, then its length in `k` bits, then the
//! non-zero value less one. A Golomb-Rice quotient of 32 or more is written as 32 ones and the
//! value itself in 32 bits, so no value costs more than 64 bits.

use crate::bytes::{BitReader, BitWriter};
use crate::coder::{folded, unfolded};
use crate::error::{Error, Result};

// Constants of the adaptation: those of RemoteFX.

/// Binary logarithm of `L`, the scale of both states.
const L_LOG2: u32 = 3;
/// Increment of `k_p` on a zero in Golomb-Rice mode, and decrement on a non-zero.
const U0: u32 = 3;
const D0: u32 = 3;
/// Increment of `k_p` on a full run, and decrement on a broken one.
const U1: u32 = 4;
const D1: u32 = 6;
/// Greatest `k_p` and `k_rp`.
const K_P_MAX: u32 = 80;
const K_RP_MAX: u32 = 192;

/// Quotients from here on escape to a plain 32-bit value.
const ESCAPE: u32 = 32;

struct State {
    k_p: u32,
    k_rp: u32,
}

impl State {
    fn new() -> Self {
        Self { k_p: 0, k_rp: 2 << L_LOG2 }
    }

    #[inline]
    fn adapt_rice(&mut self, quotient: u32) {
        match quotient {
            0 => self.k_rp = self.k_rp.saturating_sub(2),
            1 => {}
            q => self.k_rp = (self.k_rp + q).min(K_RP_MAX),
        }
    }

    /// After a number in Golomb-Rice mode.
    #[inline]
    fn adapt_mode(&mut self, number: u32) {
        if number == 0 { self.up(U0) } else { self.down(D0) }
    }

    #[inline]
    fn up(&mut self, by: u32) {
        self.k_p = (self.k_p + by).min(K_P_MAX);
    }

    #[inline]
    fn down(&mut self, by: u32) {
        self.k_p = self.k_p.saturating_sub(by);
    }
}

#[inline]
fn put_rice(w: &mut BitWriter, u: u32, s: &mut State) {
    let k = s.k_rp >> L_LOG2;
    let q = u >> k;
    if q >= ESCAPE {
        w.put(u32::MAX, 32);
        w.put(u, 32);
        s.adapt_rice(ESCAPE);
        return;
    }
    let (ones, low) = ((1u64 << (q + 1)) - 2, u & ((1u32 << k) - 1));
    if q + 1 + k <= 32 {
        w.put((ones << k) as u32 | low, q + 1 + k);
    } else {
        w.put(ones as u32, q + 1);
        w.put(low, k);
    }
    s.adapt_rice(q);
}

#[inline]
fn get_rice(r: &mut BitReader<'_>, s: &mut State) -> u32 {
    let k = s.k_rp >> L_LOG2;
    let q = r.ones();
    s.adapt_rice(q);
    if q == ESCAPE { r.get(32) } else { (q << k) | r.get(k) }
}

/// Codes `values`; the decoder must be told how many there are.
#[must_use]
pub fn encode(values: &[i32]) -> Vec<u8> {
    let mut w = BitWriter::default();
    let mut s = State::new();
    let mut i = 0;
    while i < values.len() {
        let k = s.k_p >> L_LOG2;
        if k == 0 {
            let u = folded(values[i]);
            i += 1;
            put_rice(&mut w, u, &mut s);
            s.adapt_mode(u);
            continue;
        }
        let full = 1usize << k;
        let window = &values[i..values.len().min(i + full)];
        match window.iter().position(|&v| v != 0) {
            None => {
                w.put(0, 1);
                s.up(U1);
                i += window.len();
            }
            Some(run) => {
                w.put(1, 1);
                w.put(run as u32, k);
                put_rice(&mut w, folded(values[i + run]) - 1, &mut s);
                s.down(D1);
                i += run + 1;
            }
        }
    }
    w.finish()
}

/// Decodes `count` values.
///
/// # Errors
/// [`Error::Truncated`] if the stream ends early.
pub fn decode(bytes: &[u8], count: usize) -> Result<Vec<i32>> {
    let mut r = BitReader::new(bytes);
    let mut s = State::new();
    // `count` is a claim: memory is reserved for at most a value a bit, and grows where runs hold more.
    let mut values = Vec::with_capacity(count.min(8 * (bytes.len() + 1)));
    while values.len() < count {
        if r.overrun() {
            return Err(Error::Truncated { offset: bytes.len(), what: "RLGR stream" });
        }
        let k = s.k_p >> L_LOG2;
        if k == 0 {
            let u = get_rice(&mut r, &mut s);
            values.push(unfolded(u));
            s.adapt_mode(u);
            continue;
        }
        let left = count - values.len();
        if r.get(1) == 0 {
            values.resize(values.len() + left.min(1 << k), 0);
            s.up(U1);
        } else {
            let run = r.get(k) as usize;
            if run >= left {
                return Err(Error::Corrupt { what: "RLGR run past the end", offset: r.consumed() });
            }
            values.resize(values.len() + run, 0);
            let u = get_rice(&mut r, &mut s);
            values.push(unfolded(u.wrapping_add(1)));
            s.down(D1);
        }
    }
    if r.overrun() {
        return Err(Error::Truncated { offset: bytes.len(), what: "RLGR stream" });
    }
    Ok(values)
}

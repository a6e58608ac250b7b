//! The logistic function and its inverse, in integers.
//!
//! The tables are computed at compile time from one integer constant, so they are the same on every
//! machine.

/// `e^(1/256)` with 62 fraction bits.
const EXP_STEP: u128 = 4629735647166717428;

const SQUASH: [u16; 4096] = {
    let mut t = [0u16; 4096];
    let mut e: u128 = 1 << 40; // e^(i/256), 40 fraction bits
    let mut i = 0;
    while i < 2048 {
        let p = (65536 * e + (((1 << 40) + e) >> 1)) / ((1 << 40) + e);
        let p = if p > 65535 - 31 { 65535 - 31 } else { p };
        t[2048 + i] = p as u16;
        t[2048 - i] = (65536 - p) as u16;
        e = (e * EXP_STEP) >> 62;
        i += 1;
    }
    t[0] = t[1];
    t
};

const STRETCH: [i16; 4096] = {
    let mut t = [0i16; 4096];
    let mut i = 0usize;
    let mut p = 0usize;
    while p < 4096 {
        while i < 4095 && (SQUASH[i] as usize) < 16 * p + 8 {
            i += 1;
        }
        t[p] = i as i16 - 2048;
        p += 1;
    }
    t
};

/// [`STRETCH`] of the probabilities that a [`Bit`](crate::model::Bit) codes with, by the top 12 bits of its state.
const STRETCH_STATE: [i16; 4096] = {
    let mut t = STRETCH;
    // The coder's probabilities are at least 32 and at most 65504, in 1/65536.
    t[0] = t[2];
    t[1] = t[2];
    t[4095] = t[4094];
    t
};

/// `ln(p / (1 - p))` of the probability in a [`Bit`](crate::model::Bit), with 8 fraction bits.
#[inline]
pub(crate) fn stretch_of_state(state: u32) -> i32 {
    i32::from(STRETCH_STATE[(state >> 20) as usize])
}

/// The 16-bit probability whose `ln(p / (1 - p))` is `x / 256`, within `[32, 65504]`.
#[inline]
pub(crate) fn squash(x: i32) -> u32 {
    u32::from(SQUASH[(x.clamp(-2047, 2047) + 2048) as usize])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    #[allow(clippy::disallowed_methods, reason = "the definition the tables are compared with")]
    fn squash_is_the_logistic_function() {
        for x in -2047..=2047 {
            let want = 65536.0 / (1.0 + (-f64::from(x) / 256.0).exp());
            let got = f64::from(squash(x));
            assert!((got - want.clamp(32.0, 65504.0)).abs() <= 1.0, "{x}: {got} {want}");
        }
        assert_eq!(squash(i32::MIN), squash(-2047));
        assert_eq!(squash(i32::MAX), squash(2047));
        for p in (64..65472).step_by(16) {
            let back = squash(i32::from(STRETCH[(p >> 4) as usize])) as i32;
            assert!((back - p).abs() <= 16 + p.min(65536 - p) / 100, "{p} {back}");
        }
    }
}

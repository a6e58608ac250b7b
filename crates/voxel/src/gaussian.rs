//! Formulae of one Gaussian that the strategies and the merging share.
//!
//! *Invariant:* the same bits on every machine. Therefore the exponential and the logarithm are
//! written here, and not taken from the platform.

/// Bound on |log-scale| inside the formulae: exp(+-115) = 1e+-50 keeps fourth powers of scales
/// finite and non-zero in `f64`. Trained scales lie within +-20; stored values are never changed.
const MAX_LOG_SCALE: f32 = 115.0;

/// Greatest opacity a rasterizer gives one Gaussian (Inria's alpha cap).
pub(crate) const MAX_ALPHA: f64 = 0.99;

/// `e^x` for `|x| <= 700`, to 1.5 units in the last place.
///
/// It consists of additions and multiplications, without a branch or a table. So the bits are the
/// same everywhere, and loops over it become vector instructions, which those of `libm` do not.
#[inline(always)]
pub(crate) fn exp(x: f64) -> f64 {
    // Adding 1.5 * 2^52 rounds to an integer, which is then in the low bits.
    const ROUND: f64 = 6_755_399_441_055_744.0;
    const LN2_HIGH: f64 = 6.931_471_803_691_238e-1;
    const LN2_LOW: f64 = 1.908_214_929_270_587_7e-10;
    let shifted = x * std::f64::consts::LOG2_E + ROUND;
    let n = shifted - ROUND;
    let r = (x - n * LN2_HIGH) - n * LN2_LOW;
    // Taylor series. |r| <= 0.347, so the first term that is left out is 4e-18.
    let term = |k: usize| 1.0 / FACTORIALS[k];
    let (r2, r4) = (r * r, (r * r) * (r * r));
    let low = (term(2) + r * term(3)) + r2 * (term(4) + r * term(5));
    let middle = (term(6) + r * term(7)) + r2 * (term(8) + r * term(9));
    let high = (term(10) + r * term(11)) + r2 * (term(12) + r * term(13));
    let p = 1.0 + (r + r2 * (low + r4 * (middle + r4 * high)));
    // Times 2^n, by adding n to the exponent.
    f64::from_bits(p.to_bits().wrapping_add(shifted.to_bits() << 52))
}

const FACTORIALS: [f64; 14] = {
    let mut all = [1.0; 14];
    let mut k = 1;
    while k < 14 {
        all[k] = all[k - 1] * k as f64;
        k += 1;
    }
    all
};

/// Natural logarithm of a positive, normal, finite `x`, to 1 unit in the last place.
///
/// It is the series of FreeBSD's `log` without its branches, for the same reasons as [`exp`].
/// Zero gives about -709 and infinity about 710, neither NaN.
#[inline(always)]
pub(crate) fn ln(x: f64) -> f64 {
    const LN2_HIGH: f64 = 6.931_471_803_691_238e-1;
    const LN2_LOW: f64 = 1.908_214_929_270_587_7e-10;
    // The significand in sqrt(1/2) to sqrt(2), and the exponent, 1023 too large, as the low bits
    // of a number around 2^52.
    const FIRST: u64 = 0x3fe6_a09e_0000_0000;
    const ONE: u64 = 1023 << 52;
    const TWO_52: u64 = (1023 + 52) << 52;
    let biased = x.to_bits().wrapping_add(ONE - FIRST);
    let n = f64::from_bits(TWO_52 | biased >> 52) - (4_503_599_627_370_496.0 + 1023.0);
    let f = f64::from_bits((biased & ((1 << 52) - 1)) + FIRST) - 1.0;
    let s = f / (2.0 + f);
    let z = s * s;
    let w = z * z;
    let even = w
        * (3.999_999_999_940_942e-1
            + w * (2.222_219_843_214_978_4e-1 + w * 1.531_383_769_920_937_3e-1));
    let odd = z
        * (6.666_666_666_666_735e-1
            + w * (2.857_142_874_366_239e-1
                + w * (1.818_357_216_161_805e-1 + w * 1.479_819_860_511_658_6e-1)));
    let half = 0.5 * f * f;
    n * LN2_HIGH - ((half - (s * (half + (even + odd)) + n * LN2_LOW)) - f)
}

/// Standard deviation, world units.
#[inline(always)]
#[allow(clippy::manual_clamp, reason = "NaN must end up in range, as exp needs")]
pub(crate) fn scale(log_scale: f32) -> f64 {
    exp(f64::from(log_scale.max(-MAX_LOG_SCALE).min(MAX_LOG_SCALE)))
}

/// Logarithm of a Gaussian's volume, the product of its three scales (the paper's section 3.2.2).
///
/// It orders Gaussians as the volume does, is cheaper and cannot overflow.
pub(crate) fn log_volume(log_scale: [f32; 3]) -> f64 {
    log_scale.iter().map(|&l| f64::from(l)).sum()
}

/// Opacity in (0, 1) from its logit.
#[inline(always)]
#[allow(clippy::manual_clamp, reason = "NaN must end up in range, as exp needs")]
pub(crate) fn opacity(logit: f32) -> f64 {
    // Beyond 700 the opacity is 0 or 1 in `f64` anyway.
    1.0 / (1.0 + exp(f64::from((-logit).max(-700.0).min(700.0))))
}

/// Logit of an opacity in (0, 1).
#[inline(always)]
pub(crate) fn logit(opacity: f64) -> f64 {
    ln(opacity / (1.0 - opacity))
}

/// Root mean square of the three principal cross-sections, divided by pi: a measure of the area
/// that an ellipsoid covers on a screen, averaged over directions. For flat and for round
/// Gaussians it is within 10 % of the mean area of the projections, which needs elliptic
/// integrals.
#[inline(always)]
pub(crate) fn area(s: [f64; 3]) -> f64 {
    let [a, b, c] = [s[1] * s[2], s[0] * s[2], s[0] * s[1]];
    ((a * a + b * b + c * c) / 3.0).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exp_agrees_with_libm() {
        for i in -70_000..=70_000 {
            let x = f64::from(i) * 0.01 + f64::from(i % 97) * 1e-5;
            let x = x.clamp(-700.0, 700.0);
            let (got, want) = (exp(x), libm::exp(x));
            assert!((got / want - 1.0).abs() <= 4.5e-16, "exp({x}) = {got:e}, not {want:e}");
        }
        assert_eq!(exp(0.0), 1.0);
    }

    #[test]
    fn ln_agrees_with_libm() {
        for i in -70_000..=70_000 {
            let x = exp(f64::from(i) * 0.01 + f64::from(i % 97) * 1e-5);
            let (got, want) = (ln(x), libm::log(x));
            assert!(
                (got - want).abs() <= 2.3e-16 * want.abs(),
                "ln({x:e}) = {got:e}, not {want:e}"
            );
        }
        // Near 1, and at the ends.
        for i in -1000..=1000 {
            let x = 1.0 + f64::from(i) * 1e-9;
            assert!((ln(x) - libm::log(x)).abs() <= 2.3e-16 * libm::log(x).abs());
        }
        assert!(ln(0.0) < -700.0 && ln(f64::INFINITY) > 700.0 && ln(1.0) == 0.0);
    }

    #[test]
    fn opacity_saturates() {
        assert_eq!(opacity(f32::MAX), 1.0);
        assert_eq!(opacity(0.0), 0.5);
        assert!(opacity(f32::MIN) > 0.0 && opacity(f32::MIN) < 1e-300);
    }
}

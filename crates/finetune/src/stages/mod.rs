//! The stages of the pipeline, each a Rust file and a WGSL file of the same name.
//!
//! The per-splat mathematics is written once, in `math/*.wgsl`: the text uses only what WGSL
//! and Rust have in common (`fn`, `struct`, `let`, positional constructors, no `var`, no
//! `if`), and a prelude per instance supplies the scalar type `F`, the boolean type `B` and a
//! dozen functions. This module is the f32 instance; `f64_instance` is the
//! other.
#![allow(
    private_interfaces,
    non_snake_case,
    clippy::needless_return,
    clippy::too_many_arguments,
    clippy::excessive_precision,
    clippy::approx_constant,
    clippy::inline_always,
    reason = "the included text is WGSL as well: its idiom, literals and argument lists"
)]

pub(crate) mod blend;
pub(crate) mod blend_adjoint;
#[cfg(any(test, feature = "reference"))]
pub(crate) mod f64_instance;
pub(crate) mod gather;
pub(crate) mod loss;
pub(crate) mod project;
pub(crate) mod project_adjoint;
#[cfg(test)]
pub(crate) mod reference;
pub(crate) mod removal;
pub(crate) mod sort_depth;
pub(crate) mod tiles;

pub(crate) use consts::*;

/// Constants that both executors share; the WGSL prelude is generated from them.
pub(crate) mod consts {
    /// Tile edge in pixels.
    pub(crate) const TILE: u32 = 16;
    /// Blending stops before the transmittance would fall below this.
    pub(crate) const T_STOP: f32 = 1.0e-4;
    /// Cap of alpha.
    pub(crate) const ALPHA_MAX: f32 = 0.99;
    /// Bound of sigma before the exponential; above every possible cut, ln 255 = 5.54.
    pub(crate) const SIGMA_MAX: f32 = 6.0;
    /// Log-scales are clamped to this magnitude before the exponential.
    pub(crate) const LOG_SCALE_MAX: f32 = 40.0;
    /// Variance of the screen-space low-pass filter, pixels squared.
    pub(crate) const BLUR: f32 = 0.3;
    /// Quaternions whose squared norm is outside this range are culled: they cannot be
    /// normalised in f32. The bounds are those of `gs_model`'s validation.
    pub(crate) const MIN_QUATERNION_NORM2: f32 = f32::MIN_POSITIVE;
    /// See [`MIN_QUATERNION_NORM2`].
    pub(crate) const MAX_QUATERNION_NORM2: f32 = f32::MAX;
}

// --- the f32 prelude of math/*.wgsl ---

type F = f32;
type B = bool;

#[inline(always)]
fn F(x: f32) -> F {
    x
}
#[inline(always)]
fn select(otherwise: F, then: F, condition: B) -> F {
    if condition { then } else { otherwise }
}
#[inline(always)]
fn min(a: F, b: F) -> F {
    if b < a { b } else { a }
}
#[inline(always)]
fn max(a: F, b: F) -> F {
    if b > a { b } else { a }
}
#[inline(always)]
fn clamp(x: F, low: F, high: F) -> F {
    min(max(x, low), high)
}
#[inline(always)]
fn abs(x: F) -> F {
    x.abs()
}
#[inline(always)]
fn sqrt(x: F) -> F {
    x.sqrt()
}
/// Round to nearest, ties to even, for |x| < 2^22: adding and subtracting 1.5 * 2^23 needs no
/// instruction beyond SSE2. (WGSL uses `round`, because its compilers may simplify the two additions.)
#[inline(always)]
fn round_even(x: F) -> F {
    const MAGIC: f32 = 12_582_912.0;
    (x + MAGIC) - MAGIC
}
/// 2^n for integral n in [-126, 127].
#[inline(always)]
fn power_of_two(n: F) -> F {
    // The low bits of n + 1.5 * 2^23 are n in two's complement.
    const MAGIC: f32 = 12_582_912.0;
    f32::from_bits(((n + MAGIC).to_bits() << 23).wrapping_add(0x3f80_0000))
}
/// Exponent e with x = m 2^e, m in [sqrt(1/2), sqrt(2)).
#[inline(always)]
fn exponent_of(x: F) -> F {
    ((x.to_bits().wrapping_sub(0x3f35_04f3) as i32) >> 23) as f32
}
/// Mantissa m with x = m 2^e, m in [sqrt(1/2), sqrt(2)).
#[inline(always)]
fn mantissa_of(x: F) -> F {
    let offset = x.to_bits().wrapping_sub(0x3f35_04f3);
    f32::from_bits((offset & 0x007f_ffff).wrapping_add(0x3f35_04f3))
}
/// True unless NaN or infinite. Tests the exponent's bits, as in WGSL, where compilers may assume
/// that NaN and infinity do not occur.
#[inline(always)]
pub(crate) fn finite(x: F) -> B {
    x.to_bits() & 0x7f80_0000 != 0x7f80_0000
}

/// The opacity of a Gaussian, as the stages compute it.
pub(crate) fn opacity_of(logit: f32) -> f32 {
    sigmoid(logit)
}

/// The SH basis of `degree` in the direction of a vector, and the inverse of its length.
pub(crate) fn sh_basis_along(degree: u8, [x, y, z]: [f32; 3]) -> ([f32; 16], f32) {
    let (unit, inverse) = direction(V3 { x, y, z });
    (sh_basis(degree, unit), inverse)
}

include!("math/prelude.rs");
include!("math/scalar.wgsl");
include!("math/project.wgsl");
include!("math/reach.wgsl");
include!("math/project_adjoint.wgsl");
include!("math/sh.wgsl");
include!("math/blend.wgsl");
include!("math/frame.rs");

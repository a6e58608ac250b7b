//! Importance classes: how precisely each Gaussian deserves to be coded.
//!
//! A colour error `e` of one Gaussian changes the squared error of the rendered views by
//! `e^2 * sum((alpha T)^2)` over its pixels. That sum varies over six orders of magnitude
//! within a scene, so a common quantisation step spends most bits on errors that nobody sees.
//! Each Gaussian gets a class `c`; attributes are transformed with weight `4^c`, which makes
//! the effective step of a Gaussian finer by `2^c`. Squared error suggests one class per factor
//! of four in importance; measured, a smaller slope with a floor is better, because steps far
//! above the mean one leave the range in which errors stay small (a log-scale off by 1.5
//! makes a Gaussian 4.5 times as wide). Classes are coded in the base layer of each chunk,
//! before all attributes.

#[cfg(feature = "encode")]
mod encode;

#[cfg(feature = "encode")]
pub(crate) use encode::{UnseenUnit, log_classes, log_classes_about, sum};
#[cfg(feature = "encode")]
pub use encode::{with_unseen, without_cameras};

/// Number of classes; weights run from 1 to `4^(CLASSES - 1)`.
pub(crate) const CLASSES: u8 = 12;
/// The class of the mean importance of a scene.
pub const MEAN_CLASS: u8 = 5;

/// RAHT weight of a class, `4^class`.
pub(crate) fn weight(class: u8) -> u32 {
    1 << (2 * u32::from(class.min(CLASSES - 1)))
}

/// The class of a decoded value.
pub(crate) fn class_of(value: f32) -> u8 {
    (value + 0.5).clamp(0.0, f32::from(CLASSES - 1)) as u8
}

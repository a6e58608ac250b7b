//! How Gaussians are laid out in JavaScript's typed arrays.
//!
//! Invariant: a layout writes each Gaussian straight into the arrays that JavaScript gets. In WebAssembly's
//! memory there is one block of Gaussians at a time.

mod column;
mod covariances;
mod packed;
mod planar;

use crate::error;
use gs_model::Scene;
use js_sys::Object;
use wasm_bindgen::JsValue;

/// SH basis function of degree 0.
const C0: f32 = 0.282_094_8;

/// Arrays that are being filled.
pub(crate) trait ArrayLayout {
    /// Puts Gaussians at `first` and behind it. Their SH degree is the layout's.
    fn put(&mut self, first: usize, block: &Scene);
}

/// The arrays of a layout in `arrays`, with room for so many Gaussians; those that are missing are made.
pub(crate) fn named(
    name: &str,
    arrays: &Object,
    capacity: usize,
    sh_degree: u8,
) -> Result<Box<dyn ArrayLayout>, JsValue> {
    Ok(match name {
        "planar" => Box::new(planar::Planar::of(arrays, capacity, sh_degree)),
        "packed" => Box::new(packed::Packed::of(arrays, capacity, sh_degree)),
        "covariances" => Box::new(covariances::Covariances::of(arrays, capacity, sh_degree)),
        _ => {
            let message = format!("no layout {name}: use planar, packed or covariances");
            return Err(error::object(&message, "option").into());
        }
    })
}

/// The base colour of a DC coefficient.
fn base_colour(dc: f32) -> f32 {
    dc * C0 + 0.5
}

/// The opacity of a logit.
fn opacity(logit: f32) -> f32 {
    1.0 / (1.0 + libm::expf(-logit))
}

/// The SH coefficients of a degree among those of a Gaussian.
fn of_degree(sh: &[[f32; 3]], degree: usize) -> &[[f32; 3]] {
    &sh[degree * degree..(degree + 1) * (degree + 1)]
}

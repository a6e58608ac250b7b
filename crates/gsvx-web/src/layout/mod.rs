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
        "planar" => Box::new(planar::Planar::of(arrays, capacity, sh_degree)?),
        "packed" => Box::new(packed::Packed::of(arrays, capacity, sh_degree)?),
        "covariances" => Box::new(covariances::Covariances::of(arrays, capacity, sh_degree)?),
        _ => {
            let message = format!("no layout {name}: use planar, packed or covariances");
            return Err(error::object(&message, "option").into());
        }
    })
}

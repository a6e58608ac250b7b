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

/// Gaussians handed over at a time: they fit a core's cache.
pub(crate) const BLOCK: usize = 512;

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
        "packed" => Box::new(packed::PackedLayout::of(arrays, capacity, sh_degree)?),
        "covariances" => Box::new(covariances::Covariances::of(arrays, capacity, sh_degree)?),
        _ => {
            let message = format!("no layout {name}: use planar, packed or covariances");
            return Err(error::object(&message, "option").into());
        }
    })
}

/// Puts some Gaussians of a scene at the beginning of arrays; `sh_degree` is at most that of the scene.
#[cfg(feature = "sequence")]
pub(crate) fn fill(
    scene: &Scene,
    range: std::ops::Range<usize>,
    arrays: &Object,
    capacity: usize,
    layout: &str,
    sh_degree: u8,
) -> Result<(), JsValue> {
    let mut out = named(layout, arrays, capacity, sh_degree)?;
    let mut block = scene.emptied(sh_degree);
    for first in range.clone().step_by(BLOCK) {
        block.clear();
        block.append_range(scene, first..range.end.min(first + BLOCK));
        out.put(first - range.start, &block);
    }
    Ok(())
}

//! Plain floats, as trained: one array for each attribute.

use super::ArrayLayout;
use super::column::Column;
use gs_model::Scene;
use js_sys::Object;
use wasm_bindgen::JsValue;

/// `means`, `rotations` (w, x, y, z), `logScales`, `opacityLogits`, `sh` (coefficient after coefficient,
/// each red, green, blue).
pub(crate) struct Planar {
    means: Column<f32>,
    rotations: Column<f32>,
    log_scales: Column<f32>,
    opacity_logits: Column<f32>,
    sh: Column<f32>,
}

impl Planar {
    pub(crate) fn of(arrays: &Object, capacity: usize, sh_degree: u8) -> Result<Self, JsValue> {
        let sh = 3 * (usize::from(sh_degree) + 1) * (usize::from(sh_degree) + 1);
        Ok(Self {
            means: Column::of(arrays, "means", 3, capacity)?,
            rotations: Column::of(arrays, "rotations", 4, capacity)?,
            log_scales: Column::of(arrays, "logScales", 3, capacity)?,
            opacity_logits: Column::of(arrays, "opacityLogits", 1, capacity)?,
            sh: Column::of(arrays, "sh", sh, capacity)?,
        })
    }
}

impl ArrayLayout for Planar {
    fn put(&mut self, first: usize, block: &Scene) {
        self.means.copy(first, block.means.as_flattened());
        self.rotations.copy(first, block.rotations.as_flattened());
        self.log_scales.copy(first, block.log_scales.as_flattened());
        self.opacity_logits.copy(first, &block.opacity_logits);
        self.sh.copy(first, block.sh.as_flattened());
    }
}

//! Models in other formats, for the viewer page: PLY, glTF, SPZ and .splat.

use crate::error;
use crate::layout;
use crate::outlook::{self, ENOUGH};
use gs_model::{Invalid, ReadOptions, Scene, chain, model};
use wasm_bindgen::prelude::*;

/// A model that was read whole.
#[wasm_bindgen(js_name = Model)]
#[derive(Debug)]
pub struct WholeModel {
    scene: Scene,
}

#[wasm_bindgen(js_class = Model)]
impl WholeModel {
    /// Reads a model. `name` tells a .splat from others. Invalid Gaussians are left out.
    ///
    /// # Errors
    /// An object with `message` and `code`.
    #[wasm_bindgen(constructor)]
    pub fn new(name: &str, bytes: &[u8]) -> Result<Self, JsValue> {
        let codec = Some(&gsvx::gltf::CODEC);
        let options = ReadOptions { invalid: Invalid::Drop, codec, ..Default::default() };
        let (scene, _) = model::read_named(name, bytes, &options)
            .map_err(|e| JsValue::from(error::object(&chain(&e), "model")))?;
        outlook::see(&scene, scene.len().div_ceil(ENOUGH));
        Ok(Self { scene })
    }

    /// The number of Gaussians.
    #[wasm_bindgen(getter)]
    #[must_use]
    pub fn count(&self) -> usize {
        self.scene.len()
    }

    /// Highest SH degree.
    #[wasm_bindgen(getter, js_name = shDegree)]
    #[must_use]
    pub fn sh_degree(&self) -> u8 {
        self.scene.sh_degree
    }

    /// Whether opacity is to be compensated for the blur.
    #[wasm_bindgen(getter)]
    #[must_use]
    pub fn antialiased(&self) -> bool {
        self.scene.antialiased
    }

    /// Some Gaussians as an object of typed arrays with room for `capacity`.
    ///
    /// # Errors
    /// An object with `message` and `code` for an unknown layout.
    pub fn take(
        &self,
        first: usize,
        count: usize,
        capacity: usize,
        layout: &str,
        sh_degree: u8,
    ) -> Result<js_sys::Object, JsValue> {
        let first = first.min(self.scene.len());
        let range = first..first + count.min(self.scene.len() - first);
        let sh_degree = sh_degree.min(self.scene.sh_degree);
        let arrays = js_sys::Object::new();
        let capacity = capacity.max(range.len());
        layout::fill(&self.scene, range, &arrays, capacity, layout, sh_degree)?;
        Ok(arrays)
    }
}

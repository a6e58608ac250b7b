//! 32 bytes for each Gaussian, and a word for each SH coefficient: the arrays of Spark's `ExtSplats`, which
//! the PlayCanvas adapter reads too.

use super::ArrayLayout;
use super::column::Column;
use gs_model::Scene;
use gs_model::layout::packed::{SH_DEGREES, WORDS, a, b, sh};
use js_sys::Object;
use wasm_bindgen::JsValue;

/// `a`, `b`, and the arrays of SH coefficients.
pub(crate) struct PackedLayout {
    a: Column<u32>,
    b: Column<u32>,
    sh: Vec<Column<u32>>,
}

/// The arrays of SH coefficients.
const SH: [&str; 4] = ["sh1", "sh2", "sh3a", "sh3b"];

impl PackedLayout {
    pub(crate) fn of(arrays: &Object, capacity: usize, sh_degree: u8) -> Result<Self, JsValue> {
        let sh = SH.into_iter().zip(SH_DEGREES).filter(|(_, degree)| *degree <= sh_degree);
        Ok(Self {
            a: Column::of(arrays, "a", WORDS, capacity)?,
            b: Column::of(arrays, "b", WORDS, capacity)?,
            sh: sh
                .map(|(name, _)| Column::of(arrays, name, WORDS, capacity))
                .collect::<Result<_, _>>()?,
        })
    }
}

impl ArrayLayout for PackedLayout {
    fn put(&mut self, first: usize, block: &Scene) {
        for i in 0..block.len() {
            self.a.block.extend(a(block, i));
            self.b.block.extend(b(block, i));
            for (array, column) in self.sh.iter_mut().enumerate() {
                column.block.extend(sh(block, i, array));
            }
        }
        self.a.flush(first);
        self.b.flush(first);
        self.sh.iter_mut().for_each(|column| column.flush(first));
    }
}

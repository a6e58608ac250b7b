//! What the GaussianSplat addon of three.js takes: means and covariances as floats, colours and SH
//! coefficients as bytes.

use super::ArrayLayout;
use super::column::Column;
use gs_model::Scene;
use gs_model::layout::covariances::{SH_WORDS, colour_word, covariance, sh_words};
use js_sys::Object;
use wasm_bindgen::JsValue;

/// `centers`, `covariances` (xx, xy, xz, yy, yz, zz), `colors` (a word of red, green, blue and alpha),
/// `sh1` to `sh3`.
pub(crate) struct Covariances {
    centers: Column<f32>,
    covariances: Column<f32>,
    colours: Column<u32>,
    sh: Vec<Column<u32>>,
}

impl Covariances {
    pub(crate) fn of(arrays: &Object, capacity: usize, sh_degree: u8) -> Result<Self, JsValue> {
        let degrees = ["sh1", "sh2", "sh3"].into_iter().zip(SH_WORDS).take(sh_degree.into());
        Ok(Self {
            centers: Column::of(arrays, "centers", 3, capacity)?,
            covariances: Column::of(arrays, "covariances", 6, capacity)?,
            colours: Column::of(arrays, "colors", 1, capacity)?,
            sh: degrees
                .map(|(name, words)| Column::of(arrays, name, words, capacity))
                .collect::<Result<_, _>>()?,
        })
    }
}

impl ArrayLayout for Covariances {
    fn put(&mut self, first: usize, block: &Scene) {
        self.centers.copy(first, block.means.as_flattened());
        for i in 0..block.len() {
            self.covariances.block.extend(covariance(block, i));
            self.colours.block.push(colour_word(block, i));
            for (degree, column) in (1..).zip(&mut self.sh) {
                column.block.extend(sh_words(block, i, degree));
            }
        }
        self.covariances.flush(first);
        self.colours.flush(first);
        self.sh.iter_mut().for_each(|column| column.flush(first));
    }
}

//! The head of a stream as a plain JavaScript object.

use crate::error::set;
use gsvx::{Chunk, Index, Kind};
use js_sys::{Array, Object};
use wasm_bindgen::JsValue;

fn numbers(values: impl IntoIterator<Item = f64>) -> JsValue {
    values.into_iter().map(JsValue::from_f64).collect::<Array>().into()
}

/// `{ count, shDegree, antialiased, headLength, length, lods, chunks }`.
pub(crate) fn of(index: &Index) -> JsValue {
    let head = Object::new();
    set(&head, "count", &(index.header.count as f64).into());
    set(&head, "shDegree", &index.header.sh_degree.into());
    set(&head, "antialiased", &index.header.antialiased.into());
    set(&head, "headLength", &(index.head_len as f64).into());
    set(&head, "length", &(index.stream_len() as f64).into());
    set(&head, "lods", &(1 + index.coarsest_lod()).into());
    let chunks: Array = (0..index.chunks.len()).map(|i| chunk(index, i)).collect();
    set(&head, "chunks", &chunks);
    head.into()
}

/// `{ exact, lod, count, bounds, layers, finer }`; a layer is `[offset, length]`.
fn chunk(index: &Index, number: usize) -> JsValue {
    let Chunk { kind, lod, count, bounds, ref layers, .. } = index.chunks[number];
    let entry = Object::new();
    set(&entry, "exact", &(kind == Kind::Exact).into());
    set(&entry, "lod", &lod.into());
    set(&entry, "count", &(count as f64).into());
    set(&entry, "bounds", &numbers(bounds.as_flattened().iter().map(|&v| v.into())));
    let layers: Array = layers.iter().map(|l| numbers([l.offset as f64, l.len as f64])).collect();
    set(&entry, "layers", &layers);
    set(&entry, "finer", &numbers(index.finer(number).map(|i| i as f64)));
    entry.into()
}

#[cfg(test)]
mod tests {
    use gsvx::{ALWAYS_ACCEPTED, DEFAULT_GROWTH};

    #[test]
    fn the_script_accepts_as_many_gaussians_as_the_decoder() {
        let script = include_str!("../npm/core.js");
        for line in [
            format!("const GROWTH = {DEFAULT_GROWTH};"),
            format!("const ALWAYS_ACCEPTED = {} << 20;", ALWAYS_ACCEPTED >> 20),
        ] {
            assert!(script.contains(&line), "{line}");
        }
    }
}

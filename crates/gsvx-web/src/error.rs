//! Errors as JavaScript sees them: objects with a message, a code, and the place in the stream.

use gsvx::{Error, Index};
use js_sys::{Object, Reflect};
use wasm_bindgen::JsValue;

/// What the caller can do about an error.
fn code(error: &Error) -> &'static str {
    match error {
        Error::NotGsvx => "not-gsvx",
        Error::Version { .. } => "version",
        Error::Truncated { .. } => "truncated",
        Error::Limit { .. } => "limit",
        Error::Memory { .. } => "memory",
        _ => "damaged",
    }
}

/// Chunk, layer and offset in the stream, as far as they are known.
fn place(error: &Error, index: Option<&Index>) -> (Option<usize>, Option<usize>, u64) {
    match error {
        Error::Checksum { chunk, layer, offset, .. } => (Some(*chunk), Some(*layer), *offset),
        Error::Chunk { chunk, .. } => {
            let entry = index.and_then(|i| i.chunks.get(*chunk));
            let base = entry.and_then(|c| c.layers.first());
            (Some(*chunk), None, base.map_or(0, |l| l.offset))
        }
        Error::Truncated { offset, .. } => (None, None, *offset),
        _ => (None, None, 0),
    }
}

/// The error as an object: `message`, `code`, `offset`, and `chunk` and `layer` where they are known.
pub(crate) fn of(error: &Error, index: Option<&Index>) -> JsValue {
    let (chunk, layer, offset) = place(error, index);
    let object = object(&gs_model::chain(error), code(error));
    set(&object, "offset", &(offset as f64).into());
    for (name, number) in [("chunk", chunk), ("layer", layer)] {
        if let Some(number) = number {
            set(&object, name, &(number as f64).into());
        }
    }
    object.into()
}

/// An error that has no place in a stream.
pub(crate) fn object(message: &str, code: &str) -> Object {
    let object = Object::new();
    set(&object, "message", &message.into());
    set(&object, "code", &code.into());
    object
}

/// Sets a property of a plain object, which cannot fail.
pub(crate) fn set(object: &Object, name: &str, value: &JsValue) {
    let _ = Reflect::set(object, &name.into(), value);
}

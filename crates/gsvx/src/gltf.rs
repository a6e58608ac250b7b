//! Streams inside glTF: the extension `GSVX_gaussian_splatting_compression`, for readers of gs-model.
//!
//! ```no_run
//! use gs_model::ReadOptions;
//!
//! let options = ReadOptions { codec: Some(&gsvx::gltf::CODEC), ..ReadOptions::default() };
//! let (scene, _) = gs_model::model::read("scene.glb", &options)?;
//! # Ok::<(), gs_model::Error>(())
//! ```

use crate::decode::{DecodeOptions, decode_with, default_max_gaussians};
use crate::error::Error;
use crate::head::Index;
use gs_model::{Codec, Scene, chain};

/// What decodes primitives of glTF that hold a stream.
pub static CODEC: Codec = Codec {
    extension: "GSVX_gaussian_splatting_compression",
    // The SH degree is not known yet, so the bound is that of degree 3.
    most: |bytes| default_max_gaussians(bytes, 3),
    decode: of_primitive,
};

fn of_primitive(stream: &[u8], count: usize) -> Result<Scene, String> {
    let in_words = |e: Error| chain(&e);
    let held = Index::parse(stream).map_err(in_words)?.header.count;
    if held != count as u64 {
        return Err(format!("its accessors promise {count} Gaussians, its stream holds {held}"));
    }
    // The reader of glTF has bounded the number.
    let options = DecodeOptions { max_gaussians: Some(held), ..DecodeOptions::default() };
    Ok(decode_with(stream, &options).map_err(in_words)?.scene)
}

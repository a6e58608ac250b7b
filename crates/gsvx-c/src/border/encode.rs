//! Encoding.

use super::{place, run, slice};
use crate::error::{Error, Result};
use crate::model::{Arrays, encode, shape};
use crate::plain::{EncodeOptions, Message, Model, Status};
use std::mem::MaybeUninit;

/// Encodes a model. `bytes` and `size` get the stream, which `gsvx_free` frees, or NULL and 0 on an error. `options` may
/// be NULL: quality 80. On success the message has what is worth knowing, and is empty if there is nothing.
///
/// Gaussians that share a cell of the octree are merged, and their order changes. The work uses all cores, on threads
/// that stay for the next call. The same model and options give the same bytes.
///
/// GSVX_STATUS_ARGUMENT for a null pointer, an option out of its range, or a `max_bytes` below the smallest stream.
/// GSVX_STATUS_MODEL if a number is not finite or too large; the message names the Gaussian.
///
/// Libraries that were built without the feature `encode` do not have this function.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn gsvx_encode(
    model: Option<&Model>,
    options: Option<&EncodeOptions>,
    bytes: Option<&mut MaybeUninit<*mut u8>>,
    size: Option<&mut MaybeUninit<usize>>,
    message: Option<&mut MaybeUninit<Message>>,
) -> Status {
    run(message, || {
        let (bytes, size) = (place(bytes, "bytes")?, place(size, "size")?);
        bytes.write(std::ptr::null_mut());
        size.write(0);
        let model = model.ok_or(Error::Null("model"))?;
        // SAFETY: the header asks for arrays of these lengths that do not change during the call.
        let arrays = unsafe { arrays(model) }?;
        let (stream, remarks) = encode(&arrays, options)?;
        size.write(stream.len());
        bytes.write(Box::into_raw(stream.into_boxed_slice()).cast());
        Ok(remarks)
    })
}

/// The arrays of a model.
///
/// # Safety
/// As the comments of `Model` say.
unsafe fn arrays(model: &Model) -> Result<Arrays<'_>> {
    let (count, sh_degree) = shape(model)?;
    let floats = |pointer, width: usize, what| {
        let len = count.checked_mul(width).ok_or(Error::TooMany(model.gaussians))?;
        // SAFETY: the caller's promise.
        unsafe { slice(pointer, len, what) }
    };
    Ok(Arrays {
        axes: model.axes,
        sh_degree,
        antialiased: model.antialiased != 0,
        means: floats(model.means, 3, "means")?,
        rotations: floats(model.rotations, 4, "rotations")?,
        log_scales: floats(model.log_scales, 3, "log_scales")?,
        opacity_logits: floats(model.opacity_logits, 1, "opacity_logits")?,
        sh: floats(model.sh, 3 * gs_model::sh_len(sh_degree), "sh")?,
    })
}

/// Frees a stream that `gsvx_encode` made. NULL is allowed.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn gsvx_free(bytes: *mut u8, size: usize) {
    if !bytes.is_null() {
        // SAFETY: the header asks for pointer and size of one stream of `gsvx_encode`, once: those of a boxed slice.
        drop(unsafe { Box::from_raw(std::ptr::slice_from_raw_parts_mut(bytes, size)) });
    }
}

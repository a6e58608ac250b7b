//! Decoding.

use super::{buffer, changed, given, place, run, slice};
use crate::array::stride;
use crate::plain::{ByteRange, Chunk, Frame, Info, Message, Options, Status};
use crate::stream::Stream;
use std::mem::MaybeUninit;
use std::ptr::NonNull;

/// Opens a stream of which no byte is known yet.
///
/// `options` may be NULL: see `gsvx_options`. `stream` gets the handle, or NULL if the options are out of their
/// ranges (GSVX_STATUS_ARGUMENT).
#[unsafe(no_mangle)]
pub extern "C" fn gsvx_open(
    options: Option<&Options>,
    stream: Option<&mut MaybeUninit<Option<Box<Stream>>>>,
    message: Option<&mut MaybeUninit<Message>>,
) -> Status {
    run(message, || {
        let stream = place(stream, "stream")?;
        stream.write(None);
        stream.write(Some(Box::new(Stream::new(options)?)));
        Ok(String::new())
    })
}

/// Frees a stream and all it holds. NULL is allowed. No thread may use the handle during the call or after it.
#[unsafe(no_mangle)]
pub extern "C" fn gsvx_close(stream: Option<Box<Stream>>) {
    run(None, || {
        drop(stream);
        Ok(String::new())
    });
}

/// Gives `size` bytes of the stream, of which the first is number `offset` of the stream. They may come in any order, in
/// pieces of any size, asked for or not. A stream in memory is given whole with `offset` 0. The bytes are copied.
///
/// GSVX_STATUS_NOT_GSVX, GSVX_STATUS_VERSION or GSVX_STATUS_DAMAGED if the head shows it. All that was given is
/// forgotten then, and the stream is as after `gsvx_open`. `gsvx_decode` tells of damage in chunks. Bytes behind the end
/// of the stream are ignored. A NULL `bytes` is allowed if `size` is 0.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn gsvx_give(
    stream: Option<NonNull<Stream>>,
    offset: u64,
    bytes: *const u8,
    size: usize,
    message: Option<&mut MaybeUninit<Message>>,
) -> Status {
    run(message, || {
        // SAFETY: the header asks for `size` bytes at `bytes` that do not change during the call.
        let bytes = unsafe { slice(bytes, size, "bytes") }?;
        // SAFETY: the header asks for a handle that is not closed during the call.
        unsafe { changed(stream) }?.lock()?.give(offset, bytes)?;
        Ok(String::new())
    })
}

/// Says which bytes are to be given next: those of the head until it is known, then those that are missing for the
/// first `layers` layers of chunk `chunk`, but not for layers that `gsvx_decode` holds already. `range` gets the first
/// missing range; `begin` equals `end` when nothing is missing. To read the head alone, pass 0 layers; `chunk` is not
/// looked at then, nor before the head is known.
///
/// Before the head is known the range may reach beyond the end of a short file: give what there is. A file that has no
/// bytes from `begin` on is truncated; only the caller can know.
#[unsafe(no_mangle)]
pub extern "C" fn gsvx_needs(
    stream: Option<&Stream>,
    chunk: u64,
    layers: u32,
    range: Option<&mut MaybeUninit<ByteRange>>,
    message: Option<&mut MaybeUninit<Message>>,
) -> Status {
    run(message, || {
        let range = place(range, "range")?;
        range.write(given(stream)?.lock()?.needs(chunk, layers)?);
        Ok(String::new())
    })
}

/// Tells what holds for the whole stream. GSVX_STATUS_TRUNCATED until the head is known.
#[unsafe(no_mangle)]
pub extern "C" fn gsvx_get_info(
    stream: Option<&Stream>,
    info: Option<&mut MaybeUninit<Info>>,
    message: Option<&mut MaybeUninit<Message>>,
) -> Status {
    run(message, || {
        let info = place(info, "info")?;
        info.write(given(stream)?.lock()?.info()?);
        Ok(String::new())
    })
}

/// Tells what the index knows of chunk number `chunk`, from 0 to `gsvx_info.chunks - 1`.
/// GSVX_STATUS_TRUNCATED until the head is known.
#[unsafe(no_mangle)]
pub extern "C" fn gsvx_get_chunk(
    stream: Option<&Stream>,
    chunk: u64,
    entry: Option<&mut MaybeUninit<Chunk>>,
    message: Option<&mut MaybeUninit<Message>>,
) -> Status {
    run(message, || {
        let entry = place(entry, "entry")?;
        entry.write(given(stream)?.lock()?.chunk(chunk)?);
        Ok(String::new())
    })
}

/// Decodes the first `layers` layers of a chunk and holds its Gaussians in place of those held before. `gaussians` gets
/// their number, which is `gsvx_chunk.gaussians`; it may be NULL. Fewer layers than there are leave the higher SH
/// coefficients 0; numbers of layers beyond what there is stand for all, and 0 for 1. Further layers of a chunk that is
/// held are added without decoding the first again.
///
/// GSVX_STATUS_TRUNCATED if bytes are missing (see `gsvx_needs`), GSVX_STATUS_DAMAGED if a checksum or a rule of the
/// format is broken, GSVX_STATUS_LIMIT if there are too many Gaussians. Nothing is held then. The layers before one that
/// is missing or damaged are good: ask for fewer until the call succeeds or 1 fails. After GSVX_STATUS_ARGUMENT what was
/// held stays.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn gsvx_decode(
    stream: Option<NonNull<Stream>>,
    chunk: u64,
    layers: u32,
    gaussians: Option<&mut MaybeUninit<u64>>,
    message: Option<&mut MaybeUninit<Message>>,
) -> Status {
    run(message, || {
        // SAFETY: the header asks for a handle that is not closed during the call.
        let count = unsafe { changed(stream) }?.lock()?.decode(chunk, layers)?;
        if let Some(gaussians) = gaussians {
            gaussians.write(count);
        }
        Ok(String::new())
    })
}

/// Decodes frame number `number` of a sequence, whose `size` bytes are in memory, and holds its Gaussians in place of those
/// held before: gsvx_copy copies them. `frame` gets what they are. Further frames of the
/// same group take little time. The work uses all cores, on threads that stay for the next call.
///
/// `stream` gives its options, of which `max_gaussians` is the limit of a frame; nothing need be given to it.
/// GSVX_STATUS_ARGUMENT if there is no such frame, GSVX_STATUS_VERSION if the stream is none of a sequence,
/// GSVX_STATUS_TRUNCATED, GSVX_STATUS_DAMAGED and GSVX_STATUS_LIMIT as in gsvx_decode. What was held stays then.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn gsvx_decode_frame(
    stream: Option<NonNull<Stream>>,
    bytes: *const u8,
    size: usize,
    number: u64,
    frame: Option<&mut MaybeUninit<Frame>>,
    message: Option<&mut MaybeUninit<Message>>,
) -> Status {
    run(message, || {
        // SAFETY: the header asks for `size` bytes at `bytes` that do not change during the call.
        let bytes = unsafe { slice(bytes, size, "bytes") }?;
        let frame = place(frame, "frame")?;
        // SAFETY: the header asks for a handle that is not closed during the call.
        frame.write(unsafe { changed(stream) }?.lock()?.decode_frame(bytes, number)?);
        Ok(String::new())
    })
}

/// The bytes that each Gaussian takes in an array (one of `gsvx_array`) of a stream of SH degree `sh_degree`. 0 for
/// what is no array, for degrees above 3, and for arrays of degrees above `sh_degree`.
#[unsafe(no_mangle)]
pub extern "C" fn gsvx_stride(array: u32, sh_degree: u32) -> usize {
    stride(array, sh_degree)
}

/// Copies an array (one of `gsvx_array`) of the chunk that is held to `out`: as many times `gsvx_stride` bytes as there
/// are Gaussians. `size` is what `out` has room for; if that is less, GSVX_STATUS_BUFFER. GSVX_STATUS_ARGUMENT if nothing
/// is held. Bytes beyond stay as they are. `out` needs no alignment. The order of the Gaussians is that of the stream, the same in all arrays.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn gsvx_copy(
    stream: Option<&Stream>,
    array: u32,
    out: *mut std::ffi::c_void,
    size: usize,
    message: Option<&mut MaybeUninit<Message>>,
) -> Status {
    run(message, || {
        // SAFETY: the header asks for `size` bytes at `out` that nobody else uses during the call.
        let out = unsafe { buffer(out.cast(), size) }?;
        given(stream)?.lock()?.copy(array, out)?;
        Ok(String::new())
    })
}

/// Frees the bytes that were given of a chunk. What is held of it stays, and further layers can be added; to decode it
/// anew, its bytes must be given again.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn gsvx_forget(
    stream: Option<NonNull<Stream>>,
    chunk: u64,
    message: Option<&mut MaybeUninit<Message>>,
) -> Status {
    run(message, || {
        // SAFETY: the header asks for a handle that is not closed during the call.
        unsafe { changed(stream) }?.lock()?.forget(chunk)?;
        Ok(String::new())
    })
}

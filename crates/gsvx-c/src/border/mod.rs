//! The functions that C calls: the one place with raw pointers.
//!
//! Invariant: nothing unwinds into C, and every pointer that may be null is looked at first. Structs and handles
//! are references and boxes, of which Rust guarantees that they are pointers in C and null is `None`. What is unsafe is
//! a buffer, which comes as pointer and length, and a handle that is not const, which two threads may have.
#![allow(
    unsafe_code,
    reason = "functions with names for C, buffers that come as pointer and length, handles that threads share"
)]
#![allow(
    clippy::missing_safety_doc,
    reason = "the header states the rules of pointers once, for C"
)]

mod decode;
#[cfg(feature = "encode")]
mod encode;

pub use decode::*;
#[cfg(feature = "encode")]
pub use encode::*;

use crate::error::{Error, Result};
use crate::plain::{Message, Status};
use crate::stream::Stream;
use std::ffi::c_char;
use std::mem::MaybeUninit;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::ptr::NonNull;

/// A place in the caller's memory that is written before a function returns, or null.
type Out<'a, T> = Option<&'a mut MaybeUninit<T>>;

/// Runs what a function does. Its error, or what it remarks, becomes the message.
fn run(message: Out<'_, Message>, work: impl FnOnce() -> Result<String>) -> Status {
    // What a panic leaves half changed is behind a lock, which is poisoned then.
    let done = catch_unwind(AssertUnwindSafe(work)).unwrap_or_else(|panic| {
        let text = panic.downcast_ref::<String>().map(String::as_str);
        let text = text.or_else(|| panic.downcast_ref::<&str>().copied());
        let text = text.unwrap_or("it panicked").to_owned();
        // Dropping what was thrown could panic in turn.
        std::mem::forget(panic);
        Err(Error::Internal(text))
    });
    let (status, text) = match done {
        Ok(remarks) => (Status::Ok, remarks),
        Err(error) => (error.status(), gs_model::chain(&error)),
    };
    if let Some(message) = message {
        message.write(Message { text: c_text(&text) });
    }
    status
}

/// Text that ends in a zero, cut between two characters.
fn c_text<const N: usize>(text: &str) -> [c_char; N] {
    let end = text.floor_char_boundary(N - 1);
    let mut out = [0; N];
    for (to, from) in out.iter_mut().zip(&text.as_bytes()[..end]) {
        *to = *from as c_char;
    }
    out
}

/// The place for a result, which C must give.
fn place<'a, T>(out: Out<'a, T>, what: &'static str) -> Result<&'a mut MaybeUninit<T>> {
    out.ok_or(Error::Null(what))
}

/// A handle, which C must give.
fn given(stream: Option<&Stream>) -> Result<&Stream> {
    stream.ok_or(Error::Null("stream"))
}

/// The handle of a function that changes the stream, so that it is not const in the header. Several threads may have it at
/// once, so it is no `&mut`.
///
/// # Safety
/// It is one of `gsvx_open`, and is not closed during `'a`.
unsafe fn changed<'a>(stream: Option<NonNull<Stream>>) -> Result<&'a Stream> {
    // SAFETY: the caller's promise.
    given(stream.map(|stream| unsafe { stream.as_ref() }))
}

/// Refuses a null pointer, unless nothing is behind it, and more than an address space holds.
fn check<T>(pointer: *const T, len: usize, what: &'static str) -> Result<()> {
    if len > isize::MAX as usize / size_of::<T>() {
        return Err(Error::Argument {
            what,
            value: len as u64,
            range: "a length that fits the memory",
        });
    }
    if !pointer.is_aligned() {
        return Err(Error::Argument { what, value: pointer as u64, range: "an aligned address" });
    }
    if pointer.is_null() && len > 0 { Err(Error::Null(what)) } else { Ok(()) }
}

/// A buffer that is read.
///
/// # Safety
/// `pointer` is null, or `len` values lie there and stay as they are for `'a`.
unsafe fn slice<'a, T>(pointer: *const T, len: usize, what: &'static str) -> Result<&'a [T]> {
    check(pointer, len, what)?;
    if len == 0 {
        return Ok(&[]);
    }
    // SAFETY: not null, aligned, and no longer than isize::MAX bytes, as checked; the rest is the caller's promise.
    Ok(unsafe { std::slice::from_raw_parts(pointer, len) })
}

/// A buffer that is written, whose bytes may never have been.
///
/// # Safety
/// `pointer` is null, or `len` bytes lie there that nobody else reads or writes during `'a`.
unsafe fn buffer<'a>(pointer: *mut u8, len: usize) -> Result<&'a mut [MaybeUninit<u8>]> {
    check(pointer, len, "out")?;
    if len == 0 {
        return Ok(&mut []);
    }
    // SAFETY: not null and no longer than isize::MAX bytes, as checked; bytes have no alignment; `MaybeUninit` may be
    // unwritten; the rest is the caller's promise.
    Ok(unsafe { std::slice::from_raw_parts_mut(pointer.cast(), len) })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_panic_becomes_a_status_with_its_text() {
        let mut message = MaybeUninit::uninit();
        let status = run(Some(&mut message), || panic!("number {}", 7));
        assert_eq!(status, Status::Internal);
        // SAFETY: `run` has written it.
        let text = unsafe { message.assume_init() }.text.map(|c| c as u8);
        assert!(text.starts_with(b"a mistake in gsvx: number 7\0"));
    }

    #[test]
    fn text_is_cut_between_characters() {
        assert_eq!(c_text::<5>("a\u{e9}\u{e9}").map(|c| c as u8), *b"a\xc3\xa9\0\0");
        assert_eq!(c_text::<4>("abc").map(|c| c as u8), *b"abc\0");
    }
}

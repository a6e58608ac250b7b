//! What the allocator keeps to itself.

use std::path::PathBuf;

/// Models in files of at most this many bytes are one chunk of a stream or two, and take a quarter
/// of a second: 2^18 Gaussians of 248 bytes.
const SMALL: u64 = 65_000_000;
/// Blocks of at least this many bytes go back to the system as soon as they are free.
const BLOCK: i32 = 1 << 18;

/// Makes memory that small models no longer need go back to the system at once.
///
/// Each time a large block is freed, glibc keeps blocks up to that size to itself from then on,
/// for blocks to come: an encoder of 100,000 Gaussians, whose phases need blocks of different
/// sizes, then holds 7 MB more than it uses. Large models gain little, and would spend a tenth of
/// their time on fresh pages. To be called before there is a second thread.
pub(crate) fn return_soon(inputs: &[PathBuf]) {
    let small = |i| std::fs::metadata(i).is_ok_and(|m| m.is_file() && m.len() <= SMALL);
    if inputs.iter().all(small) {
        allocator::return_blocks_of(BLOCK);
    }
}

#[cfg(all(target_os = "linux", target_env = "gnu"))]
#[allow(unsafe_code, reason = "two parameters of the C library's allocator, set at the start")]
mod allocator {
    pub(super) fn return_blocks_of(bytes: i32) {
        // SAFETY: `mallopt` takes two integers and keeps no pointer; it is unsafe only to call
        // while another thread allocates, and `main` calls this before it starts any.
        unsafe {
            libc::mallopt(libc::M_MMAP_THRESHOLD, bytes);
            // One heap for all threads: each heap keeps free memory of its own.
            libc::mallopt(libc::M_ARENA_MAX, 1);
        }
    }
}

#[cfg(not(all(target_os = "linux", target_env = "gnu")))]
mod allocator {
    pub(super) fn return_blocks_of(_: i32) {}
}

//! How large an image may be.

/// Longest edge of an image, in pixels. It is the longest edge that a JPEG file can hold, and no
/// camera needs more.
pub const MAX_IMAGE_EDGE: u32 = 65_535;

/// Most pixels of an image. It is the limit of COLMAP, which computes the bytes of an RGB image,
/// `width * height * 3`, in a C++ `int` (`Bitmap` in `src/colmap/sensor/bitmap.cc`).
pub const MAX_IMAGE_PIXELS: u64 = i32::MAX as u64 / 3;

/// True if an image is within both limits.
pub(crate) fn size_fits(width: u32, height: u32) -> bool {
    width.max(height) <= MAX_IMAGE_EDGE && u64::from(width) * u64::from(height) <= MAX_IMAGE_PIXELS
}

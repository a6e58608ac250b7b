//! [`Limits`]: how much memory and time a decoder may spend on a stream.

/// Bounds on what a decoder may allocate, whatever the stream claims.
///
/// Memory and time of every decoder in this crate are proportional to `max_points` (times the
/// number of channels the caller asks for), never to a number read from the stream.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// Greatest number of points (leaves) accepted.
    pub max_points: usize,
}

impl Limits {
    /// The default for a stream of `bytes` bytes: 64 points per byte plus 65 536.
    ///
    /// Trained scenes need 10 bits and more per point; only synthetic solids (a full cube) pack
    /// more than 64 points in a byte, and a caller who expects those sets `max_points` itself.
    #[must_use]
    pub fn for_stream(bytes: usize) -> Self {
        Self { max_points: bytes.saturating_mul(64).saturating_add(1 << 16) }
    }
}

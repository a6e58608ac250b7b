//! [`Codec`]: what the reader of glTF must be given for primitives that another crate compresses.

use std::fmt;

use crate::scene::Scene;

/// The decoder of an extension of glTF that compresses Gaussians.
pub struct Codec {
    /// Name of the extension. It is inside the `KHR_gaussian_splatting` of a primitive, and its `bufferView` has
    /// the data.
    pub extension: &'static str,
    /// The most Gaussians that so many bytes may hold: a bound on memory.
    pub most: fn(u64) -> u64,
    /// Decodes data that must hold so many Gaussians, in the axes of a PLY file. An error is what is wrong with
    /// the data, in words.
    pub decode: fn(&[u8], usize) -> Result<Scene, String>,
}

impl PartialEq for Codec {
    fn eq(&self, other: &Self) -> bool {
        self.extension == other.extension
    }
}

impl fmt::Debug for Codec {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.extension)
    }
}

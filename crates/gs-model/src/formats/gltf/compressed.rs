//! [`CompressedGltf`]: files whose Gaussians another crate has compressed.

use std::io::Write;
use std::path::Path;

use serde_json::json;

use super::document::{Document, bound};
use super::json::F32;
use super::{attribute, container, sh_attribute};
use crate::axes::ABOUT_Z;
use crate::error::{Error, Result};
use crate::scene::sh_len;

/// Gaussians that an extension of `KHR_gaussian_splatting` compresses, for a `.glb` file.
///
/// The file has one primitive. Its accessors say how many Gaussians there are and which attributes; they have no
/// data. So the file requires both extensions.
#[derive(Clone, Copy, Debug)]
pub struct CompressedGltf<'a> {
    /// Name of the extension that compresses.
    pub extension: &'a str,
    /// What its `bufferView` holds.
    pub data: &'a [u8],
    /// Number of Gaussians, at least 1.
    pub count: usize,
    /// Their SH degree, 0 to 3.
    pub sh_degree: u8,
    /// Least and greatest coordinates of their means, with the axes of a PLY file.
    pub bounds: [[f32; 3]; 2],
}

impl CompressedGltf<'_> {
    /// Writes the file; `name` is the file in errors.
    ///
    /// # Errors
    /// [`Error::Unwritable`] if there is no Gaussian or the data are too long for glTF, [`Error::SceneDegree`],
    /// [`Error::Io`].
    pub fn write_to(&self, name: impl AsRef<Path>, mut out: impl Write) -> Result<()> {
        let file = name.as_ref();
        if self.count == 0 {
            return Err(empty(file));
        }
        if self.sh_degree > 3 {
            return Err(Error::SceneDegree { degree: self.sh_degree });
        }
        let mut document = Document::new(self.count);
        bound(document.attribute("POSITION".into(), F32, "VEC3", None), self.bounds, &ABOUT_Z);
        for (name, kind) in [("ROTATION", "VEC4"), ("SCALE", "VEC3"), ("OPACITY", "SCALAR")] {
            document.attribute(attribute(name), F32, kind, None);
        }
        for k in 0..sh_len(self.sh_degree) {
            document.attribute(sh_attribute(k), F32, "VEC3", None);
        }
        finish(file, &mut out, document, (self.extension, self.data), [0.0; 3])
    }
}

/// Writes a file whose only data are those that an extension decodes to the attributes of `document`. Its node has the
/// translation `shift`.
pub(super) fn finish(
    file: &Path,
    out: &mut dyn Write,
    mut document: Document,
    (extension, data): (&str, &[u8]),
    shift: [f64; 3],
) -> Result<()> {
    let view = document.view(data.len() as u64, None);
    let length = document.length();
    let json = document.json(Some((extension, json!({ "bufferView": view }))), shift);
    let head = container::head(&json, length).ok_or_else(|| {
        Error::unwritable(file, "it takes more than 4 GiB, which glTF cannot hold")
    })?;
    let padding = data.len().next_multiple_of(4) - data.len();
    let mut put = |bytes: &[u8]| out.write_all(bytes).map_err(|e| Error::io(file, "write", e));
    put(&head)?;
    put(data)?;
    put(&[0; 4][..padding])
}

pub(super) fn empty(file: &Path) -> Error {
    Error::unwritable(file, "the model is empty, and glTF has no empty meshes")
}

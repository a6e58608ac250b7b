//! Output folders of the Inria trainer: `cameras.json` and `cfg_args`.
//!
//! `cameras.json` holds the pose as the camera's centre and its camera-to-world rotation
//! (camera axes as in [`Camera`]), the focal lengths in pixels, the size of the original
//! photo, and the photo's name, in older versions without extension. It holds no principal
//! point: the trainer renders as if it were the image's centre, and so does this reader.

use std::path::{Path, PathBuf};

use glam::{DMat3, DVec3};
use serde::Deserialize;

use crate::camera::{Camera, NEAR, View, checked_size};
use crate::error::{Error, Result};
use crate::fs;
use crate::photos::Finder;

#[derive(Deserialize)]
struct Entry {
    img_name: String,
    width: u64,
    height: u64,
    /// Camera centre, world units.
    position: [f64; 3],
    /// Camera to world, row by row.
    rotation: [[f64; 3]; 3],
    fx: f64,
    fy: f64,
}

/// Reads a `cameras.json` from its bytes, in file order; `file` is its name in errors.
///
/// # Errors
/// [`Error::Json`], [`Error::BadCamera`].
pub fn cameras_from_bytes(file: impl AsRef<Path>, bytes: &[u8]) -> Result<Vec<Camera>> {
    let file = file.as_ref();
    let entries: Vec<Entry> =
        serde_json::from_slice(bytes).map_err(|e| Error::json(file, "a camera file", e))?;
    entries.into_iter().map(|entry| camera(file, entry)).collect()
}

fn camera(file: &Path, entry: Entry) -> Result<Camera> {
    let (width, height) = checked_size(file, &entry.img_name, entry.width, entry.height)?;
    // The rows become columns: the transpose, which is world to camera.
    let rotation = DMat3::from_cols_array_2d(&entry.rotation);
    Camera {
        name: entry.img_name,
        width,
        height,
        fx: entry.fx,
        fy: entry.fy,
        cx: f64::from(width) / 2.0,
        cy: f64::from(height) / 2.0,
        rotation,
        translation: -(rotation * DVec3::from_array(entry.position)),
        lens: None,
        near: NEAR,
    }
    .checked(file)
}

/// Reads the views of an output folder, in the order of its `cameras.json`.
///
/// Photos are searched in the images folder of the data set that the trainer was given
/// (`source_path` and `images` in `cfg_args`, if that folder still exists) and in `images/` in
/// the output folder. A photo that is in neither place is expected in `images/`.
pub(crate) fn views(dir: &Path) -> Result<Vec<View>> {
    let file = dir.join("cameras.json");
    let cameras = cameras_from_bytes(&file, &fs::read(&file)?)?;
    let folders: Vec<PathBuf> =
        source_images(dir).into_iter().chain([dir.join("images")]).collect();
    let mut finder = Finder::default();
    let with_photo = |camera: Camera| {
        let mut image_path = dir.join("images").join(&camera.name);
        for folder in &folders {
            let (Some(parent), Some(name)) = (folder.parent(), folder.file_name()) else {
                continue;
            };
            if let Some(found) = finder.find(parent, &Path::new(name).join(&camera.name))? {
                image_path = found;
                break;
            }
        }
        Ok(View { camera, image_path })
    };
    cameras.into_iter().map(with_photo).collect()
}

/// The images folder that `cfg_args` names: absolute, or relative to the output folder.
fn source_images(dir: &Path) -> Option<PathBuf> {
    let text = std::fs::read_to_string(dir.join("cfg_args")).ok()?;
    let source = python_string(&text, "source_path")?;
    let images = python_string(&text, "images").unwrap_or_else(|| "images".to_owned());
    Some(dir.join(source).join(images))
}

/// The value of `key='...'` or `key="..."` in Python's notation of a `Namespace`.
fn python_string(text: &str, key: &str) -> Option<String> {
    let start = text.match_indices(key).find_map(|(at, _)| {
        let before = text[..at].chars().next_back();
        let is_whole = !before.is_some_and(|c| c.is_alphanumeric() || c == '_');
        let value = text[at + key.len()..].strip_prefix('=')?;
        is_whole.then_some(value)
    })?;
    let mut chars = start.chars();
    let quote = chars.next().filter(|c| matches!(c, '\'' | '"'))?;
    let mut value = String::new();
    while let Some(c) = chars.next() {
        match c {
            // Only the escapes that paths have: backslashes (Windows) and quotes.
            '\\' => value.push(chars.next()?),
            c if c == quote => return Some(value),
            c => value.push(c),
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::python_string;

    #[test]
    fn cfg_args_are_read_as_python_writes_them() {
        let text = r#"Namespace(data_device='cuda', eval=True, images='images_4', model_path='/o',
            resolution=-1, sh_degree=3, source_path="/d/it's", x_source_path='no', w='c:\\d')"#;
        assert_eq!(python_string(text, "images").as_deref(), Some("images_4"));
        assert_eq!(python_string(text, "source_path").as_deref(), Some("/d/it's"));
        assert_eq!(python_string(text, "w").as_deref(), Some(r"c:\d"));
        assert_eq!(python_string(text, "eval"), None);
        assert_eq!(python_string("images='unterminated", "images"), None);
        assert_eq!(python_string("images='x\\", "images"), None);
    }
}

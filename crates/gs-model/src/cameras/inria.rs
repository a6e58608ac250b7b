//! Output folders of the Inria trainer: `cameras.json` and `cfg_args`.
//!
//! `cameras.json` holds the pose as the camera's centre and its camera-to-world rotation
//! (camera axes as in [`Camera`]), the focal lengths in pixels, the size of the original
//! photo, and the photo's name, in older versions without extension. It holds no principal
//! point: the trainer renders as if it were the image's centre, and so does this reader.

use std::path::{Path, PathBuf};

use glam::{DMat3, DVec3};
use serde_json::Value;

use crate::cameras::camera::{self, Camera, NEAR, View, pose_of, whole_size};
use crate::cameras::json::{self, number, numbers, text};
use crate::cameras::photos::Finder;
use crate::error::{Error, Result};

/// Reads a `cameras.json` from its bytes, in file order; `file` is its name in errors.
///
/// # Errors
/// [`Error::Malformed`], [`Error::BadCamera`].
pub fn cameras_from_bytes(file: impl AsRef<Path>, bytes: &[u8]) -> Result<Vec<Camera>> {
    let file = file.as_ref();
    let Value::Array(entries) = json::parse(file, bytes)? else {
        return Err(Error::malformed(file, "the file", "a list of cameras expected"));
    };
    cameras(file, &entries, &mut Vec::new())
}

fn cameras(file: &Path, entries: &[Value], notes: &mut Vec<String>) -> Result<Vec<Camera>> {
    let numbered = entries.iter().enumerate();
    numbered.map(|(i, entry)| camera(file, i, entry, notes)).collect()
}

fn camera(file: &Path, index: usize, entry: &Value, notes: &mut Vec<String>) -> Result<Camera> {
    let missing = |what: &str| {
        let place = format!("camera {index}");
        Error::malformed(
            file,
            &place,
            format!("{what}; Inria's trainer writes such a list of cameras"),
        )
    };
    let name = entry.get("img_name").and_then(text).ok_or_else(|| missing("it has no img_name"))?;
    let bad = |reason: String| camera::bad(file, &name, reason);
    let get = |key: &str| entry.get(key).and_then(number);
    let needed = |key: &str| get(key).ok_or_else(|| bad(format!("{key} is missing, or no number")));
    let many = |key: &str, n: usize| {
        let found = entry.get(key).and_then(|value| numbers(value, n)).filter(|v| v.len() == n);
        found.ok_or_else(|| bad(format!("{key} is missing, or not {n} numbers")))
    };
    let (width, height) = whole_size(file, &name, ["width", "height"], needed)?;
    let position = many("position", 3)?;
    let rows = many("rotation", 9)?;
    // Camera to world, row by row. The rows become columns: the transpose, which is world to camera.
    let matrix = DMat3::from_cols(
        DVec3::from_slice(&rows),
        DVec3::from_slice(&rows[3..]),
        DVec3::from_slice(&rows[6..]),
    );
    let (rotation, translation) =
        pose_of(file, &name, matrix, DVec3::from_slice(&position), notes)?;
    Camera {
        width,
        height,
        fx: needed("fx")?,
        fy: needed("fy")?,
        cx: f64::from(width) / 2.0,
        cy: f64::from(height) / 2.0,
        rotation,
        translation,
        lens: None,
        near: NEAR,
        name,
    }
    .checked(file)
}

/// The views of the entries of a `cameras.json`, in file order.
///
/// Photos are searched in the images folder of the data set that the trainer was given
/// (`source_path` and `images` in `cfg_args`, if that folder still exists) and in `images/` beside the file. A photo that
/// is in neither place is expected in `images/`.
pub(crate) fn views(file: &Path, entries: &[Value], notes: &mut Vec<String>) -> Result<Vec<View>> {
    let dir = file.parent().unwrap_or(Path::new(""));
    let cameras = cameras(file, entries, notes)?;
    let folders: Vec<PathBuf> =
        source_images(dir).into_iter().chain([dir.join("images")]).collect();
    let mut finder = Finder::default();
    let with_photo = |camera: Camera| {
        let mut found = folders.iter().map(|folder| finder.find_in(folder, &camera.name));
        let found = found.find_map(Result::transpose).transpose()?;
        let image_path = found.unwrap_or_else(|| dir.join("images").join(&camera.name));
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

//! [`Error`]: everything that can be wrong with a file or a scene.

use std::path::{Path, PathBuf};

use crate::scene::Field;

/// The result of this crate's functions.
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// What is wrong, where, and with which value.
///
/// `file` is the path given to the reader. It is `<bytes>` for data in memory and `scene` for
/// a [`crate::Scene`] in memory. Text taken from a file is cut and quoted, so every message is one line. A
/// cause is not in the message: it is the [`std::error::Error::source`], and [`crate::chain`] puts
/// both on one line.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The operating system refused.
    #[error("{}: cannot {action}", file.display())]
    Io {
        /// The file or folder.
        file: PathBuf,
        /// What was tried: `read`, `open`, `create`, `write`, `rename` or `list`.
        action: &'static str,
        /// The operating system's reason.
        source: std::io::Error,
    },
    /// The file is empty, or of another format than expected.
    #[error("{}: {reason}", file.display())]
    OtherFormat {
        /// The file.
        file: PathBuf,
        /// What it should be, and what it is.
        reason: String,
    },
    /// The file is whole and is something else than a model.
    #[error("{}: is no model: it is {what}", file.display())]
    NoModel {
        /// The file.
        file: PathBuf,
        /// What it is, and what to do about it.
        what: String,
    },
    /// The file ends before what it promises.
    #[error("{}: truncated at byte {len}: {missing}", file.display())]
    Truncated {
        /// The file.
        file: PathBuf,
        /// Its length, bytes; where it is compressed, that of what was decompressed.
        len: usize,
        /// What is promised and not there.
        missing: String,
    },
    /// A part of the file is not as its format has it, or its version is not read.
    #[error("{}: {place}: {reason}", file.display())]
    Malformed {
        /// The file.
        file: PathBuf,
        /// Which part: `header line 3`, say.
        place: String,
        /// What is wrong with it, and what to do about it where that is known.
        reason: String,
    },
    /// Gaussians with a value that is not finite, or whose quaternion has no direction.
    #[error(
        "{}: Gaussian {index}: {field} is {} ({count} invalid {} in all)",
        file.display(),
        of_invalid(*field, *value),
        if *count == 1 { "Gaussian" } else { "Gaussians" }
    )]
    InvalidGaussian {
        /// The file.
        file: PathBuf,
        /// Index of the first invalid Gaussian.
        index: usize,
        /// Its first invalid field.
        field: Field,
        /// The offending value (of a quaternion without direction: its w).
        value: f32,
        /// Invalid Gaussians in all.
        count: usize,
    },
    /// The system has no memory for the Gaussians of a file.
    #[error("{}: no memory for its {gaussians} Gaussians", file.display())]
    Memory {
        /// The file.
        file: PathBuf,
        /// How many there are.
        gaussians: usize,
    },
    /// The arrays of a [`crate::Scene`] do not have the lengths they must have.
    #[error("scene: {field} has {len} entries, expected {expected}")]
    SceneShape {
        /// The array.
        field: Field,
        /// Its length.
        len: usize,
        /// The length that goes with the number of means.
        expected: usize,
    },
    /// SH degree above 3.
    #[error("scene: SH degree {degree}; 0 to 3 are supported")]
    SceneDegree {
        /// The degree.
        degree: u8,
    },
    /// A scene that the format cannot hold.
    #[error("{}: cannot be written: {reason}", file.display())]
    Unwritable {
        /// The file to be written.
        file: PathBuf,
        /// Why not.
        reason: String,
    },
    /// An impossible camera: size zero or too large, focal length not positive, or a pose that is not a
    /// rotation.
    #[error("{}: view {view:?}: {reason}", file.display())]
    BadCamera {
        /// The file.
        file: PathBuf,
        /// Image name or camera id.
        view: String,
        /// What is wrong.
        reason: String,
    },
    /// A folder without cameras, without a model, or with several models, none of them called `point_cloud.ply`.
    #[error("{}: {reason}", dir.display())]
    NotADataset {
        /// The folder.
        dir: PathBuf,
        /// What it lacks, or which models it has.
        reason: String,
    },
}

/// What is wrong with a value.
fn of_invalid(field: Field, value: f32) -> String {
    match field {
        Field::Rotation if value.is_finite() => "of no length, which is no direction".into(),
        _ => value.to_string(),
    }
}

impl Error {
    pub(crate) fn io(file: &Path, action: &'static str, source: std::io::Error) -> Self {
        Self::Io { file: file.to_owned(), action, source }
    }

    pub(crate) fn malformed(file: &Path, place: &str, reason: impl AsRef<str>) -> Self {
        let [place, reason] = [place, reason.as_ref()].map(|text| excerpt(text.as_bytes()));
        Self::Malformed { file: file.to_owned(), place, reason }
    }

    pub(crate) fn truncated(file: &Path, len: usize, missing: impl Into<String>) -> Self {
        Self::Truncated { file: file.to_owned(), len, missing: missing.into() }
    }

    /// The file with these bytes is not what it should be.
    pub(crate) fn other_format(file: &Path, expected: &str, bytes: &[u8]) -> Self {
        let reason = match &bytes[..bytes.len().min(32)] {
            [] => "is empty".into(),
            start => {
                format!("not {expected}: it starts with {:?}", String::from_utf8_lossy(start))
            }
        };
        Self::OtherFormat { file: file.to_owned(), reason }
    }

    /// A version of a format that is not read; `read` says which are.
    #[cfg(feature = "formats")]
    pub(crate) fn version(
        file: &Path,
        format: &str,
        found: impl std::fmt::Display,
        read: &str,
    ) -> Self {
        let place = format!("{format} version {found}");
        Self::malformed(file, &place, format!("not read ({read}); convert it to PLY first"))
    }

    #[cfg(feature = "cameras")]
    pub(crate) fn not_a_dataset(dir: &Path, reason: impl Into<String>) -> Self {
        Self::NotADataset { dir: dir.to_owned(), reason: reason.into() }
    }

    pub(crate) fn unwritable(file: &Path, reason: impl Into<String>) -> Self {
        Self::Unwritable { file: file.to_owned(), reason: reason.into() }
    }

    /// JSON that is broken, or says something else than that of `what`: `a glTF file`, say.
    #[cfg(any(feature = "formats", feature = "cameras"))]
    pub(crate) fn json(file: &Path, what: &str, error: &serde_json::Error) -> Self {
        use serde_json::error::Category;
        let said = error.to_string();
        let why = said.split(" at line ").next().unwrap_or_default();
        let reason = match error.classify() {
            Category::Eof => "the JSON ends too early; copy or export the file again".into(),
            Category::Data => {
                let unlike =
                    why.strip_prefix("invalid type: ").and_then(|w| w.split_once(", expected "));
                let why = match (unlike, why.strip_prefix("missing field ")) {
                    (Some((found, wanted)), _) => {
                        format!("it has {found} where {wanted} is expected")
                    }
                    (_, Some(name)) => format!("{name} is missing"),
                    _ => why.into(),
                };
                format!("not the JSON of {what}: {why}; export the file again")
            }
            _ => format!("broken JSON ({why}); correct it there, or export the file again"),
        };
        let place = format!("line {}, column {}", error.line(), error.column());
        Self::malformed(file, &place, reason)
    }
}

/// Text from a file, fit for an error message: at most 160 characters, none of them a control character.
pub(crate) fn excerpt(bytes: &[u8]) -> String {
    let text = String::from_utf8_lossy(&bytes[..bytes.len().min(640)]);
    text.chars().map(|c| if c.is_control() { ' ' } else { c }).take(160).collect()
}

/// Names separated by commas, the first few of many; `None` if there is none.
pub(crate) fn list(names: impl IntoIterator<Item = String>) -> Option<String> {
    list_of(12, names)
}

/// As [`list`], at most so many.
pub(crate) fn list_of(most: usize, names: impl IntoIterator<Item = String>) -> Option<String> {
    let names: Vec<String> = names.into_iter().map(|name| excerpt(name.as_bytes())).collect();
    let more = names.len().saturating_sub(most);
    let shown = names[..names.len() - more].join(", ");
    match (names.len(), more) {
        (0, _) => None,
        (_, 0) => Some(shown),
        _ => Some(format!("{shown} and {more} more")),
    }
}

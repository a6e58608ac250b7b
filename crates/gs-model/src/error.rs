//! [`Error`]: everything that can be wrong with a file or a scene.

use std::path::{Path, PathBuf};

use crate::field::Field;

/// The result of this crate's functions.
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// What is wrong, where, and with which value.
///
/// `file` is the path given to the reader. It is `<bytes>` for data in memory and `<scene>` for
/// a [`crate::Scene`] in memory. Text taken from a file is cut to 80 characters and quoted, so
/// every message is one line.
///
/// A message contains its cause. [`std::error::Error::source`] is therefore always `None`:
/// whoever prints the chain of causes prints each of them once.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The operating system refused.
    #[error("{}: cannot {action}: {cause}", file.display())]
    Io {
        /// The file or folder.
        file: PathBuf,
        /// What was tried: `read`, `open`, `create`, `write`, `rename` or `list`.
        action: &'static str,
        /// The operating system's reason.
        cause: std::io::Error,
    },

    /// The first line is not `ply`.
    #[error("{}: not a PLY file: the first line is {found:?}, not \"ply\"", file.display())]
    PlyMagic {
        /// The file.
        file: PathBuf,
        /// Start of the file.
        found: String,
    },
    /// A header line that is not PLY.
    #[error("{}: header line {line}: {reason}: {text:?}", file.display())]
    PlyHeader {
        /// The file.
        file: PathBuf,
        /// Line number, from 1.
        line: usize,
        /// What is wrong with it.
        reason: &'static str,
        /// The line.
        text: String,
    },
    /// No `end_header` within the first [`crate::ply::MAX_HEADER_BYTES`] bytes.
    #[error("{}: no end_header in the first {limit} bytes", file.display())]
    PlyHeaderTooLong {
        /// The file.
        file: PathBuf,
        /// The limit, bytes.
        limit: usize,
    },
    /// The file ends inside its header.
    #[error("{}: truncated at byte {len}, inside the header (no end_header)", file.display())]
    PlyHeaderTruncated {
        /// The file.
        file: PathBuf,
        /// File length, bytes.
        len: usize,
    },
    /// An element or a property of an element is declared twice.
    #[error("{}: header line {line}: {what} {name:?} is declared twice", file.display())]
    PlyDuplicate {
        /// The file.
        file: PathBuf,
        /// Line number of the second declaration, from 1.
        line: usize,
        /// `element` or `property`.
        what: &'static str,
        /// Its name.
        name: String,
    },
    /// The file has no `vertex` element.
    #[error("{}: no element \"vertex\" in the header", file.display())]
    PlyNoVertex {
        /// The file.
        file: PathBuf,
    },
    /// PlayCanvas' `compressed.ply`, another format under the same file extension:
    /// [`crate::ply::compressed`] and [`crate::model`] read it.
    #[error(
        "{}: a PlayCanvas compressed PLY (packed_position, packed_rotation, ...), not a PLY of floats",
        file.display()
    )]
    PlyCompressed {
        /// The file.
        file: PathBuf,
    },
    /// Properties of a 3DGS model are missing.
    #[error(
        "{}: element \"vertex\" has no property {properties}: not a 3DGS model in the Inria layout",
        file.display()
    )]
    PlyMissingProperty {
        /// The file.
        file: PathBuf,
        /// The missing properties, in Inria order, separated by commas.
        properties: String,
    },
    /// A property that holds one number per Gaussian is declared as a list.
    #[error("{}: property {property:?} of \"vertex\" is a list, not a number", file.display())]
    PlyListProperty {
        /// The file.
        file: PathBuf,
        /// The property.
        property: String,
    },
    /// The number of `f_rest_*` properties belongs to no SH degree from 0 to 3.
    #[error("{}: {count} f_rest properties; SH degrees 0, 1, 2, 3 have 0, 9, 24, 45", file.display())]
    PlyRestCount {
        /// The file.
        file: PathBuf,
        /// How many the header declares.
        count: usize,
    },
    /// The file ends before the rows that its header promises.
    #[error(
        "{}: truncated at byte {len}: the header promises {promised} rows of element {element:?}, \
         row {row} is not whole",
        file.display()
    )]
    PlyTruncated {
        /// The file.
        file: PathBuf,
        /// File length, bytes.
        len: usize,
        /// The element.
        element: String,
        /// Rows that the header promises.
        promised: u64,
        /// First row that is missing or not whole, from 0. Rows of varying length (ASCII, lists)
        /// are not counted before they are known to fit; then it is the number of the row that
        /// cannot fit even at the least size.
        row: u64,
    },
    /// A list with a negative length.
    #[error("{}: byte {offset}: negative list length in element {element:?}", file.display())]
    PlyListLength {
        /// The file.
        file: PathBuf,
        /// Byte offset of the length.
        offset: usize,
        /// The element.
        element: String,
    },
    /// A row of an ASCII file with too few or too many numbers.
    #[error("{}: line {line}: {found} numbers, expected {expected}", file.display())]
    PlyRow {
        /// The file.
        file: PathBuf,
        /// Line number, from 1.
        line: usize,
        /// Numbers on the line.
        found: usize,
        /// Properties of the element.
        expected: usize,
    },
    /// A word of an ASCII file that is not a number.
    #[error("{}: line {line}: property {property:?}: {text:?} is not a number", file.display())]
    PlyNumber {
        /// The file.
        file: PathBuf,
        /// Line number, from 1.
        line: usize,
        /// The property.
        property: String,
        /// The word.
        text: String,
    },

    /// Not an SPZ file.
    #[error("{}: not an SPZ file: {reason}", file.display())]
    SpzHeader {
        /// The file.
        file: PathBuf,
        /// What is wrong with its header.
        reason: &'static str,
    },
    /// An SPZ version that is not read.
    #[error("{}: SPZ version {version} is not read (2 to 4 are): convert it to PLY first", file.display())]
    SpzVersion {
        /// The file.
        file: PathBuf,
        /// The version.
        version: u32,
    },
    /// An SPZ file that holds less than its header promises.
    #[error(
        "{}: truncated: the header promises {promised} Gaussians, {needed} bytes after decompression, \
         there are {len}",
        file.display()
    )]
    SpzTruncated {
        /// The file.
        file: PathBuf,
        /// Gaussians that the header promises.
        promised: u32,
        /// Bytes that they take, header included.
        needed: u64,
        /// Bytes that there are.
        len: usize,
    },
    /// Compressed data of an SPZ file that cannot be decompressed.
    #[error("{}: the {compression} data is {reason}", file.display())]
    SpzCompressedData {
        /// The file.
        file: PathBuf,
        /// `gzip` or `Zstandard`.
        compression: &'static str,
        /// `cut short` or `broken`.
        reason: &'static str,
    },
    /// A coordinate that SPZ cannot hold.
    #[error(
        "{}: Gaussian {index}: coordinate {value} is outside the range of SPZ, -{limit} to {limit}",
        file.display()
    )]
    SpzRange {
        /// The file to be written.
        file: PathBuf,
        /// Index of the Gaussian.
        index: usize,
        /// The coordinate.
        value: f32,
        /// The largest magnitude that is written: [`crate::spz::MAX_COORDINATE`].
        limit: f32,
    },
    /// A `.splat` file that is not made of whole rows.
    #[error("{}: {len} bytes are not a whole number of 32-byte rows of a .splat file", file.display())]
    SplatLength {
        /// The file.
        file: PathBuf,
        /// Its length, bytes.
        len: usize,
    },

    /// A file of another format than PLY, SPZ and `.splat` that is not as it must be.
    #[error("{}: {format}: {place} {reason}", file.display())]
    Malformed {
        /// The file.
        file: PathBuf,
        /// `compressed.ply`, `.ksplat`, `SOG` or `glTF`.
        format: &'static str,
        /// Which part of the file.
        place: String,
        /// What is wrong with it, and what to do about it where that is known.
        reason: String,
    },

    /// Gaussians with a value that is not finite, or whose quaternion has no direction.
    #[error(
        "{}: Gaussian {index}: {field} is {value} ({count} invalid {} in all); \
         what is invalid can be dropped on request",
        file.display(),
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

    /// A COLMAP binary file ends too early.
    #[error(
        "{}: truncated at byte {len}: the header promises {promised} entries, but {what} at byte \
         {offset} is missing",
        file.display()
    )]
    ColmapTruncated {
        /// The file.
        file: PathBuf,
        /// File length, bytes.
        len: usize,
        /// Where the missing value should start.
        offset: usize,
        /// What was being read.
        what: &'static str,
        /// Entries that the file promises.
        promised: u64,
    },
    /// A line of a COLMAP text file that does not have the form it must have.
    #[error("{}: line {line}: bad {what}: {text:?}", file.display())]
    ColmapLine {
        /// The file.
        file: PathBuf,
        /// Line number, from 1.
        line: usize,
        /// What was expected there.
        what: &'static str,
        /// The line.
        text: String,
    },
    /// A camera with lens distortion, under [`crate::camera::LensDistortion::Refuse`].
    #[error(
        "{}: camera {camera} has the distorted model {model}: undistort the images first with \
         `colmap image_undistorter`",
        file.display()
    )]
    DistortedCamera {
        /// The file.
        file: PathBuf,
        /// Camera id, or the frame's image.
        camera: String,
        /// COLMAP's name of the model, or the distortion coefficient that is not zero.
        model: String,
    },
    /// A camera model that is not in the list of [`crate::colmap`].
    #[error(
        "{}: camera {camera}: unknown camera model {model}: undistort the images first with \
         `colmap image_undistorter`",
        file.display()
    )]
    UnknownCameraModel {
        /// The file.
        file: PathBuf,
        /// Camera id.
        camera: u32,
        /// The model's id or name.
        model: String,
    },
    /// An image that names a camera that does not exist.
    #[error("{}: image {image:?} names camera {camera}, which is not in the cameras file", file.display())]
    UnknownCamera {
        /// The images file.
        file: PathBuf,
        /// Image name.
        image: String,
        /// Camera id.
        camera: u32,
    },
    /// Two entries with one id or one name.
    #[error("{}: two entries for {what} {name:?}", file.display())]
    DuplicateView {
        /// The file.
        file: PathBuf,
        /// `camera` or `image`.
        what: &'static str,
        /// The id or name.
        name: String,
    },
    /// An impossible camera: size zero, focal length not positive, or a pose that is not a
    /// rotation.
    #[error("{}: view {view:?}: {reason}", file.display())]
    BadCamera {
        /// The file.
        file: PathBuf,
        /// Image name or camera id.
        view: String,
        /// What is wrong.
        reason: &'static str,
    },
    /// An image size beyond [`crate::camera::MAX_IMAGE_EDGE`] or
    /// [`crate::camera::MAX_IMAGE_PIXELS`].
    #[error(
        "{}: view {view:?}: an image of {width} x {height} pixels is too large: at most {} along an \
         edge and {} in all",
        file.display(),
        crate::image_limits::MAX_IMAGE_EDGE,
        crate::image_limits::MAX_IMAGE_PIXELS
    )]
    ImageTooLarge {
        /// The file.
        file: PathBuf,
        /// Image name or camera id.
        view: String,
        /// Width that the file states.
        width: u64,
        /// Height that the file states.
        height: u64,
    },
    /// Not the JSON that was expected.
    #[error("{}: not the JSON of a camera file: {cause}", file.display())]
    Json {
        /// The file.
        file: PathBuf,
        /// The message of the JSON reader, with line and column.
        cause: serde_json::Error,
    },

    /// A folder that is none of the known kinds of data set.
    #[error(
        "{}: no cameras: expected sparse/0/images.bin or .txt (COLMAP), cameras.json (Inria output) \
         or transforms.json (NeRF)",
        dir.display()
    )]
    NoCameras {
        /// The folder.
        dir: PathBuf,
    },
    /// A folder without a model.
    #[error(
        "{}: no model: expected point_cloud.ply, point_cloud/iteration_N/point_cloud.ply or a single \
         .ply file",
        dir.display()
    )]
    NoModel {
        /// The folder.
        dir: PathBuf,
    },
    /// A folder with several models, none of them called `point_cloud.ply`.
    #[error("{}: several models: {names}; rename one to point_cloud.ply", dir.display())]
    ManyModels {
        /// The folder.
        dir: PathBuf,
        /// The files, separated by commas.
        names: String,
    },
    /// The size of a photo is not known: not in the camera file, and not a readable PNG or JPEG.
    #[error("{}: cannot tell the image's size: {reason}", file.display())]
    ImageSize {
        /// The image.
        file: PathBuf,
        /// Why not.
        reason: &'static str,
    },
}

impl Error {
    pub(crate) fn io(file: &Path, action: &'static str, cause: std::io::Error) -> Self {
        Self::Io { file: file.to_owned(), action, cause }
    }

    pub(crate) fn malformed(file: &Path, format: &'static str, place: &str, reason: &str) -> Self {
        let (place, reason) = (excerpt(place.as_bytes()), excerpt(reason.as_bytes()));
        Self::Malformed { file: file.to_owned(), format, place, reason }
    }
}

/// Text from a file, fit for an error message: at most 80 characters.
pub(crate) fn excerpt(bytes: &[u8]) -> String {
    String::from_utf8_lossy(&bytes[..bytes.len().min(320)]).chars().take(80).collect()
}

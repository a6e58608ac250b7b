//! The crate's one error type.

/// Everything that can go wrong while encoding or decoding a stream.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The input does not start with the gsvx signature.
    #[error("not a gsvx stream: the first 8 bytes are not the gsvx signature")]
    NotGsvx,
    /// The stream has another version.
    #[error(
        "stream version {version} is not readable by this build (reads {ours}); decode it with the gsvx that wrote it"
    )]
    Version {
        /// Version of the stream.
        version: u8,
        /// The version that this build reads.
        ours: u8,
    },
    /// The stream is a sequence: see [`crate::sequence`].
    #[error("a sequence of frames, not a static stream")]
    IsSequence,
    /// The stream is no sequence: see [`crate::decode`].
    #[error("a static stream, not a sequence of frames")]
    IsStatic,
    /// A frame does not fit those before it.
    #[cfg(feature = "encode")]
    #[error("a frame of SH degree {found}, where those before it have {expected}")]
    FrameDegree {
        /// Its SH degree.
        found: u8,
        /// Theirs.
        expected: u8,
    },
    /// The stream ends before a promised byte.
    #[error("stream truncated in {what}: {have} of {need} bytes at offset {offset}")]
    Truncated {
        /// Which part was being read.
        what: &'static str,
        /// Offset from the start of the stream or section.
        offset: u64,
        /// Bytes wanted.
        need: u64,
        /// Bytes available.
        have: u64,
    },
    /// A field holds a value that no encoder writes.
    #[error("corrupt stream: {what} is {value}")]
    Corrupt {
        /// The field.
        what: &'static str,
        /// Its value.
        value: u64,
    },
    /// A layer's checksum does not match its bytes.
    #[error(
        "chunk {chunk}, layer {layer} (at offset {offset}) is damaged: CRC-32C is {found:08x}, the index says {expected:08x}"
    )]
    Checksum {
        /// Number of the chunk.
        chunk: usize,
        /// Number of the layer.
        layer: usize,
        /// Its first byte in the stream.
        offset: u64,
        /// Checksum in the index.
        expected: u32,
        /// Checksum of the bytes.
        found: u32,
    },
    /// The head's checksum does not match.
    #[error("the head is damaged: CRC-32C is {found:08x}, the head says {expected:08x}")]
    HeadChecksum {
        /// Checksum in the head.
        expected: u32,
        /// Checksum of the bytes.
        found: u32,
    },
    /// The checksum of a group of frames does not match.
    #[error(
        "group {group} of the sequence is damaged: CRC-32C is {found:08x}, the head says {expected:08x}"
    )]
    GroupChecksum {
        /// Number of the group.
        group: usize,
        /// Checksum in the head.
        expected: u32,
        /// Checksum of the bytes.
        found: u32,
    },
    /// A stream that is not in memory cannot be read.
    #[error("cannot be read")]
    Read(#[source] std::io::Error),
    /// A chunk cannot be decoded.
    #[error("chunk {chunk}")]
    Chunk {
        /// Number of the chunk.
        chunk: usize,
        /// The cause.
        source: Box<Error>,
    },
    /// The stream would need more memory than the caller allows.
    #[error("{points} Gaussians, more than the limit of {limit}")]
    Limit {
        /// Gaussians claimed.
        points: u64,
        /// Greatest number allowed.
        limit: u64,
    },
    /// The system has no memory for what the stream holds.
    #[error("no memory for {points} Gaussians")]
    Memory {
        /// Gaussians that were to be held.
        points: u64,
    },
    /// Lengths that belong together differ.
    #[cfg(feature = "encode")]
    #[error("{found} {what} given, {expected} needed")]
    Length {
        /// Of what: `Gaussians of the leaves`, say.
        what: &'static str,
        /// How many there are.
        found: usize,
        /// How many there must be.
        expected: usize,
    },
    /// A Gaussian's mean is not its leaf's centre.
    #[cfg(feature = "encode")]
    #[error("Gaussian {index} is not at the centre of its voxel; merge the scene first")]
    OffCentre {
        /// Index of the first such Gaussian.
        index: usize,
    },
    /// A value is NaN or infinite.
    #[cfg(feature = "encode")]
    #[error("Gaussian {index} has a non-finite {field}; drop invalid Gaussians before encoding")]
    NonFinite {
        /// Index of the first such Gaussian.
        index: usize,
        /// The attribute.
        field: &'static str,
    },
    /// A rotation is a quaternion of zeros.
    #[cfg(feature = "encode")]
    #[error(
        "Gaussian {index} has a rotation of zero, which is no direction; drop invalid Gaussians before encoding"
    )]
    ZeroRotation {
        /// Index of the first such Gaussian.
        index: usize,
    },
    /// A value is finite, but beyond what lossy coding can hold.
    #[cfg(feature = "encode")]
    #[error(
        "Gaussian {index} has a value of {value:e} ({field}), and lossy coding holds +-{limit}; lossless coding keeps it"
    )]
    TooLarge {
        /// Index of the first such Gaussian.
        index: usize,
        /// The attribute.
        field: &'static str,
        /// Its value.
        value: f32,
        /// Greatest magnitude accepted.
        limit: f32,
    },
    /// An outlier holds a number that no Gaussian has.
    #[cfg(feature = "encode")]
    #[error("outlier {index} has an invalid {field}; drop invalid Gaussians before encoding")]
    InvalidOutlier {
        /// Index of the first such outlier.
        index: usize,
        /// The attribute.
        field: gs_model::scene::Field,
    },
    /// Gaussians lie so far apart that some should be outliers, which a plan for parts does not have.
    #[cfg(feature = "encode")]
    #[error(
        "the scene is {side:e} units wide, too wide for Gaussians of its size; leave out what lies far away, or encode it in memory"
    )]
    TooWide {
        /// Side of the cube around all means.
        side: f64,
    },
    /// An option needs the whole scene in memory, which a plan for parts does without.
    #[cfg(feature = "encode")]
    #[error("{option} needs the whole scene in memory at once")]
    NotAtScale {
        /// What was asked for.
        option: &'static str,
    },
    /// An aim at likeness lacks the function that measures it: see [`crate::Encoder::measure_by`].
    #[cfg(feature = "encode")]
    #[error("an aim at PSNR or SSIMULACRA2 needs a function that measures it")]
    NotMeasured,
    /// The caller's progress function ended the work.
    #[cfg(feature = "encode")]
    #[error("cancelled")]
    Cancelled,
    /// Streams are not parts of one scene.
    #[cfg(feature = "encode")]
    #[error("streams {first} and {second} (counted from 0) are not parts of one scene: {why}")]
    NotOneScene {
        /// A stream.
        first: usize,
        /// Another.
        second: usize,
        /// What contradicts it.
        why: &'static str,
    },
    /// An option is out of its range.
    #[cfg(feature = "encode")]
    #[error("{option} is {value}, must be {range}")]
    Option {
        /// The option's name.
        option: &'static str,
        /// The value given.
        value: f64,
        /// The accepted range.
        range: &'static str,
    },
    /// Geometry or attribute coding failed.
    #[error("{what}")]
    Coding {
        /// Which part.
        what: &'static str,
        /// The cause.
        source: gpcc_lite::Error,
    },
    /// Voxelization failed.
    #[cfg(feature = "encode")]
    #[error("voxelization")]
    Voxel(#[from] voxel::Error),
}

/// Result with [`Error`].
pub type Result<T> = std::result::Result<T, Error>;

impl Error {
    /// [`Error::Memory`] of so many Gaussians.
    pub(crate) fn memory(points: usize) -> Self {
        Self::Memory { points: points as u64 }
    }
}

/// Wraps an error of the coder with the part in which it happened.
pub(crate) fn coding(what: &'static str) -> impl Fn(gpcc_lite::Error) -> Error + Copy {
    move |source| Error::Coding { what, source }
}

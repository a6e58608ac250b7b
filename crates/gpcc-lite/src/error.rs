//! [`Error`]: everything that can be wrong with an input or a stream.

/// What this crate reports instead of panicking.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A depth above what a Morton code holds, or a leaf below its tree.
    #[error("depth {depth} is above the greatest allowed depth {max}")]
    Depth {
        /// Depth found.
        depth: u8,
        /// Greatest depth allowed here.
        max: u8,
    },
    /// Leaves must be strictly ascending by Morton code and disjoint.
    #[error("leaf {index} is not after the leaf before it in Morton order, or overlaps it")]
    LeafOrder {
        /// Index of the later leaf.
        index: usize,
    },
    /// A leaf's Morton code has bits below its own depth, or above the root.
    #[error("leaf {index}: Morton code {morton:#x} is not the corner of a cell of depth {depth}")]
    LeafAlign {
        /// Index of the leaf.
        index: usize,
        /// Its code.
        morton: u64,
        /// Its depth.
        depth: u8,
    },
    /// More points than [`crate::Limits`] allows.
    #[error("{points} points, the limit is {limit}")]
    TooManyPoints {
        /// Points claimed by the stream or found in the input.
        points: u64,
        /// The caller's limit.
        limit: usize,
    },
    /// The stream ends inside `what`.
    #[error("stream ends at byte {offset} inside {what}")]
    Truncated {
        /// Byte offset of the end.
        offset: usize,
        /// What was being read.
        what: &'static str,
    },
    /// A value that no encoder writes.
    #[error("corrupt stream: {what} at byte {offset}")]
    Corrupt {
        /// What is wrong.
        what: &'static str,
        /// Byte offset where it was noticed.
        offset: usize,
    },
    /// A quantiser step that is not a positive normal number.
    #[error("the step of channel {channel} is not a positive normal number")]
    Step {
        /// Index of the channel.
        channel: usize,
    },
    /// A channel whose length is not the number of points.
    #[error("channel {channel} has {got} values for {want} points")]
    ChannelLength {
        /// Index of the channel.
        channel: usize,
        /// Its length.
        got: usize,
        /// Number of points.
        want: usize,
    },
    /// Two lists that belong together differ in length.
    #[error("{what}: {got} given, {want} needed")]
    Count {
        /// What was counted.
        what: &'static str,
        /// Number given.
        got: usize,
        /// Number needed.
        want: usize,
    },
    /// A leaf weight of zero, or weights whose sum is not exact in double precision.
    #[error("weight {weight} of leaf {index}: weights must be 1 or more and sum below 2^50")]
    Weight {
        /// Index of the leaf.
        index: usize,
        /// Its weight.
        weight: u64,
    },
}

/// `Result` with this crate's [`Error`].
pub type Result<T, E = Error> = std::result::Result<T, E>;

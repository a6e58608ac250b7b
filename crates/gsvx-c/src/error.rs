//! What can go wrong, and the status that C gets for it.

use crate::plain::Status;

/// Everything that a call can fail with.
#[derive(Debug, thiserror::Error)]
pub(crate) enum Error {
    #[error(transparent)]
    Codec(#[from] gsvx::Error),
    #[error("{0} is a null pointer")]
    Null(&'static str),
    #[error("{what} is {value}, must be {range}")]
    Argument { what: &'static str, value: u64, range: &'static str },
    #[error("the index has not arrived: give the bytes that gsvx_needs asks for")]
    NoIndex,
    #[error("nothing is decoded: call gsvx_decode or gsvx_decode_frame first")]
    NothingDecoded,
    #[error("the buffer has {have} bytes, {need} are needed")]
    Buffer { have: usize, need: usize },
    #[cfg(feature = "encode")]
    #[error("{0}")]
    Missed(gsvx::MissedAim),
    #[cfg(feature = "encode")]
    #[error("the arrays of {0} Gaussians do not fit the memory")]
    TooMany(u64),
    #[error("a mistake in gsvx: {0}")]
    Internal(String),
}

pub(crate) type Result<T> = std::result::Result<T, Error>;

impl Error {
    pub(crate) fn status(&self) -> Status {
        match self {
            Self::Codec(error) => of_codec(error),
            Self::Null(_) | Self::Argument { .. } | Self::NothingDecoded => Status::Argument,
            Self::NoIndex => Status::Truncated,
            Self::Buffer { .. } => Status::Buffer,
            #[cfg(feature = "encode")]
            Self::Missed(_) | Self::TooMany(_) => Status::Argument,
            Self::Internal(_) => Status::Internal,
        }
    }
}

fn of_codec(error: &gsvx::Error) -> Status {
    use gsvx::Error as E;
    match error {
        E::NotGsvx => Status::NotGsvx,
        E::Version { .. } | E::IsSequence | E::IsStatic => Status::Version,
        E::Truncated { .. } => Status::Truncated,
        E::Limit { .. } => Status::Limit,
        #[cfg(feature = "encode")]
        E::Option { .. } => Status::Argument,
        #[cfg(feature = "encode")]
        E::NonFinite { .. }
        | E::ZeroRotation { .. }
        | E::TooLarge { .. }
        | E::InvalidOutlier { .. }
        | E::TooWide { .. }
        | E::Voxel(_) => Status::Model,
        _ => Status::Damaged,
    }
}

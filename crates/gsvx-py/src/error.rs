//! Errors of the library crates as Python exceptions: wrong use is a `ValueError`, a file that cannot be
//! read or written an `OSError`, all else `gsvx.Error`. The sentences are those of the library crates.

use pyo3::exceptions::{PyException, PyRuntimeError, PyValueError};
use pyo3::{PyErr, create_exception};
use std::error::Error as StdError;
use std::io;

create_exception!(
    gsvx,
    Error,
    PyException,
    "A model, a stream, cameras or photos that cannot be used; the message says why."
);

/// Why work failed. It becomes an exception on the thread that waits for it.
#[derive(Debug)]
pub(crate) enum Fault {
    /// An argument that makes no sense.
    Usage(String),
    /// A model, a stream, cameras or photos that cannot be used.
    Failed(String),
    Io(io::Error),
    /// What a function of Python raised.
    Raised(PyErr),
    /// A mistake in the program.
    Internal(String),
    /// The caller has stopped waiting: nobody hears of this.
    Stopped,
}

pub(crate) type Result<T> = std::result::Result<T, Fault>;

impl Fault {
    /// The same with the name of a file or an argument in front.
    pub(crate) fn named(self, name: &str) -> Self {
        match self {
            Self::Failed(text) if !name.is_empty() => Self::Failed(format!("{name}: {text}")),
            other => other,
        }
    }
}

impl From<Fault> for PyErr {
    fn from(fault: Fault) -> Self {
        match fault {
            Fault::Usage(text) => PyValueError::new_err(text),
            Fault::Failed(text) => Error::new_err(text),
            Fault::Io(error) => error.into(),
            Fault::Raised(error) => error,
            Fault::Internal(text) => PyRuntimeError::new_err(text),
            Fault::Stopped => PyRuntimeError::new_err("stopped"),
        }
    }
}

impl From<gsvx::Error> for Fault {
    fn from(error: gsvx::Error) -> Self {
        match error {
            gsvx::Error::Option { .. } => Self::Usage(line(&error)),
            gsvx::Error::Cancelled => Self::Stopped,
            _ => Self::Failed(line(&error)),
        }
    }
}

impl From<gs_model::Error> for Fault {
    fn from(error: gs_model::Error) -> Self {
        let text = line(&error);
        match error {
            gs_model::Error::Io { source, .. } => Self::Io(io::Error::new(source.kind(), text)),
            _ => Self::Failed(text),
        }
    }
}

impl From<finetune::Error> for Fault {
    fn from(error: finetune::Error) -> Self {
        Self::Failed(line(&error))
    }
}

impl From<tune::Error> for Fault {
    fn from(error: tune::Error) -> Self {
        match error {
            tune::Error::Option { .. } => Self::Usage(line(&error)),
            tune::Error::Codec(error) => error.into(),
            tune::Error::Scene(error) => error.into(),
            tune::Error::Interrupted => Self::Stopped,
            _ => Self::Failed(line(&error)),
        }
    }
}

/// An error and its causes on one line, and what an argument does about it.
fn line(error: &(dyn StdError + 'static)) -> String {
    let text = gs_model::chain(error);
    match std::iter::successors(Some(error), |&e| e.source()).find_map(remedy) {
        Some(remedy) => format!("{text}; {remedy}"),
        None => text,
    }
}

fn remedy(error: &(dyn StdError + 'static)) -> Option<String> {
    if let Some(gs_model::Error::InvalidGaussian { .. }) = error.downcast_ref() {
        return Some("pass drop_invalid=True to leave them out".into());
    }
    if let Some(tune::Error::NoPhotos { .. }) = error.downcast_ref() {
        return Some("distil=True tunes to renders instead".into());
    }
    if let Some(tune::Error::OtherPhotos { .. }) = error.downcast_ref() {
        return Some("force_photos=True uses them".into());
    }
    match error.downcast_ref()? {
        gsvx::Error::Limit { points, .. } => {
            Some(format!("pass max_gaussians={points} if you trust it"))
        }
        gsvx::Error::IsSequence => Some("gsvx.frames iterates its frames".into()),
        gsvx::Error::TooLarge { .. } => {
            Some("drop_invalid=True leaves it out, lossless=True keeps it".into())
        }
        gsvx::Error::IsStatic => Some("gsvx.decompress decodes it".into()),
        gsvx::Error::Truncated { what: "a group of frames", .. } => None,
        gsvx::Error::Truncated { what, .. } if *what != "head" => {
            Some("pass salvage=True to decode what is there".into())
        }
        _ => None,
    }
}

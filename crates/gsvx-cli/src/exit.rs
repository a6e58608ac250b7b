//! How the command ends: its exit codes, and the one line that says what went wrong.

use crate::ledger::Ledger;
use std::fmt::Display;
use std::io::{ErrorKind, Write};
use std::path::Path;

/// What a person calls standard input.
pub(crate) const STDIN: &str = "standard input";

/// Shown after the help.
pub(crate) const CODES: &str = "\
Exit codes:
    0  the output is complete
    1  failed: one line on standard error says why; an output appears whole or not at all
    2  wrong usage
    3  the output is complete, but misses the target that was asked for
  130  interrupted: a line on standard error says which outputs are complete
  141  the reader of standard output went away before it had the data";

const FAILED: u8 = 1;
const USAGE: u8 = 2;
const MISSED: u8 = 3;
/// What a shell reports for a process that a person interrupted.
pub(crate) const INTERRUPTED: u8 = 130;
/// What a shell reports for a process that SIGPIPE ended.
const READER_GONE: u8 = 141;

/// An error with an exit code of its own.
#[derive(Debug, thiserror::Error)]
#[error("{text}")]
struct ExitCode {
    code: u8,
    text: String,
}

/// An error that ends the command with the exit code of wrong usage.
pub(crate) fn usage(text: impl Into<String>) -> anyhow::Error {
    anyhow::Error::new(ExitCode { code: USAGE, text: text.into() })
}

/// An error that says that the output was written, but misses its target.
pub(crate) fn missed(text: impl Into<String>) -> anyhow::Error {
    anyhow::Error::new(ExitCode { code: MISSED, text: text.into() })
}

/// The chain of causes on one line, outermost first, and what the flags of this command do about it.
pub(crate) fn line(error: &anyhow::Error) -> String {
    let text = gs_model::chain(error.as_ref());
    match error.chain().find_map(remedy) {
        Some(remedy) => format!("{text}; {remedy}"),
        None => text,
    }
}

/// What a flag does about an error of the library crates.
fn remedy(cause: &(dyn std::error::Error + 'static)) -> Option<String> {
    use gs_model::Error as Model;
    use gsvx::Error as Stream;
    use tune::Error as Tuning;
    if let Some(error) = cause.downcast_ref::<Model>() {
        return match error {
            Model::InvalidGaussian { .. } => Some("pass --drop-invalid to leave them out".into()),
            Model::Memory { .. } => {
                Some("gsvx encode --memory takes a PLY piece by piece, in less of it".into())
            }
            Model::OtherFormat { file, .. } if file == Path::new(STDIN) => Some(
                "for a .splat or .ksplat from a pipe pass --from splat or --from ksplat".into(),
            ),
            _ => None,
        };
    }
    match cause.downcast_ref() {
        Some(Tuning::NoPhotos { .. } | Tuning::UnreadPhotos { .. } | Tuning::Photos { .. }) => {
            return Some("--distil tunes to renders instead".into());
        }
        Some(Tuning::GreyPhotos { .. }) => {
            return Some(
                "--distil tunes to renders instead, --force-photos to the grey photos".into(),
            );
        }
        _ => {}
    }
    if let Some(tune::Error::OtherPhotos { turned, .. }) = cause.downcast_ref() {
        let keep = if *turned { "an SPZ needs --axes keep; " } else { "" };
        return Some(format!("{keep}--force-photos uses them"));
    }
    let drawing = match cause.downcast_ref() {
        Some(tune::Error::Finetune(error)) => Some(error),
        _ => cause.downcast_ref(),
    };
    if let Some(finetune::Error::Gpu { .. } | finetune::Error::NoAdapter { .. }) = drawing {
        let how = "--backend auto or cpu goes on without it, from the checkpoint if there is one";
        return Some(how.into());
    }
    let stream = match cause.downcast_ref() {
        Some(tune::Error::Codec(error)) => Some(error),
        _ => cause.downcast_ref(),
    };
    match stream? {
        Stream::Limit { points, .. } => {
            Some(format!("pass --max-gaussians {points} if you trust it"))
        }
        Stream::FrameDegree { found, expected } => {
            Some(format!("--max-sh-degree {} makes all alike", found.min(expected)))
        }
        Stream::IsSequence => Some("gsvx decode --frame writes a frame of it".into()),
        Stream::TooLarge { .. } => {
            Some("pass --lossless, or --drop-invalid to leave it out".into())
        }
        Stream::Truncated { what, .. } if *what != "head" => {
            Some("gsvx decode --salvage writes what is there".into())
        }
        _ => None,
    }
}

/// Writes the error's line to standard error. Returns the exit code.
pub(crate) fn code(error: &anyhow::Error) -> u8 {
    let closed = |c: &(dyn std::error::Error + 'static)| {
        c.downcast_ref::<std::io::Error>().is_some_and(|e| e.kind() == ErrorKind::BrokenPipe)
    };
    if error.chain().any(closed) {
        return READER_GONE;
    }
    let interrupted = |c: &(dyn std::error::Error + 'static)| {
        matches!(c.downcast_ref(), Some(tune::Error::Interrupted))
    };
    if error.chain().any(interrupted) {
        let (_ledger, there) = Ledger::close();
        note(format_args!("error: {}; {there}", line(error)));
        return INTERRUPTED;
    }
    note(format_args!("error: {}", line(error)));
    error.chain().find_map(|c| c.downcast_ref()).map_or(FAILED, |coded: &ExitCode| coded.code)
}

/// Writes a line to standard error. Nobody can be told if that fails.
pub(crate) fn note(text: impl Display) {
    let text = gs_model::printable(&text.to_string());
    let _ = writeln!(std::io::stderr(), "{text}");
}

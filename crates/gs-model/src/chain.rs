//! [`chain`]: an error with its causes, on one line.

use std::error::Error;

/// An error and its causes, outermost first: `a: b: c`, always one line.
///
/// No error of this project repeats its cause in its own text.
#[must_use]
pub fn chain(error: &(dyn Error + 'static)) -> String {
    let causes = std::iter::successors(Some(error), |&e| e.source());
    let texts: Vec<String> = causes.map(ToString::to_string).collect();
    texts.join(": ").replace(['\n', '\r'], " ")
}

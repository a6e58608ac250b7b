//! What came of one run.

/// The result of one run.
#[derive(Debug)]
pub(crate) enum ChainOutcome {
    /// Which part refused, and its message.
    Refused(String),
    /// Per attribute: the worst error over its bound.
    Accepted(Vec<(&'static str, f64)>),
}

/// Names the part that refused a scene.
pub(super) fn by<E: std::fmt::Display>(part: &'static str) -> impl Fn(E) -> String {
    move |error| format!("{part}: {error}")
}

//! What came of one run.

/// Per attribute the worst error over its bound; or which part refused the scene, and its message.
pub(crate) type ChainOutcome = Result<Vec<(&'static str, f64)>, String>;

/// Names the part that refused a scene.
pub(super) fn by<E: std::fmt::Display>(part: &'static str) -> impl Fn(E) -> String {
    move |error| format!("{part}: {error}")
}

//! The same work on many items: on all threads where the crate is built with `encode`, otherwise on one. Results are in the order of the items either way.

/// Maps every item.
#[cfg(feature = "encode")]
pub(crate) fn map<I: Send, T: Send>(items: Vec<I>, f: impl Fn(I) -> T + Sync + Send) -> Vec<T> {
    use rayon::prelude::*;
    items.into_par_iter().with_max_len(1).map(f).collect()
}

/// Maps every item.
#[cfg(not(feature = "encode"))]
pub(crate) fn map<I, T>(items: Vec<I>, f: impl Fn(I) -> T) -> Vec<T> {
    items.into_iter().map(f).collect()
}

/// Threads that [`map`] uses.
#[cfg(feature = "encode")]
pub(crate) fn threads() -> usize {
    rayon::current_num_threads()
}

/// Threads that [`map`] uses.
#[cfg(not(feature = "encode"))]
pub(crate) fn threads() -> usize {
    1
}

//! [`CHUNK`]: how loops over Gaussians are divided among threads.

/// Gaussians per parallel work item. Fixed, so that no result depends on the number of threads.
pub(crate) const CHUNK: usize = 4096;

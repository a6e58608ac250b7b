//! The choice of the executor.

use crate::error::{Error, Result};

/// Choice of executor.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Backend {
    /// The Rust executor, on all threads of the rayon pool.
    Cpu,
    /// The WGSL executor, on a graphics adapter. With the feature `gpu`.
    Gpu,
    /// The GPU if there is a real one, else the CPU. A software adapter is refused: it is slower
    /// than the Rust executor.
    #[default]
    Auto,
}

/// The chosen executor, and the reason.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BackendReport {
    /// [`Backend::Cpu`] or [`Backend::Gpu`].
    pub used: Backend,
    /// One line for the user.
    pub reason: String,
}

/// In plain words, for messages: `CPU`, `GPU` or `automatic`.
impl std::fmt::Display for Backend {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Cpu => "CPU",
            Self::Gpu => "GPU",
            Self::Auto => "automatic",
        })
    }
}

impl std::str::FromStr for Backend {
    type Err = String;

    fn from_str(s: &str) -> std::result::Result<Self, String> {
        match s {
            "cpu" => Ok(Self::Cpu),
            "gpu" => Ok(Self::Gpu),
            "auto" => Ok(Self::Auto),
            _ => Err(format!("unknown backend {s:?}: cpu, gpu or auto")),
        }
    }
}

/// Chooses the executor.
///
/// # Errors
/// [`Error::NoAdapter`] for [`Backend::Gpu`] without one.
pub fn choose(wanted: Backend) -> Result<BackendReport> {
    let cpu = |reason: String| Ok(BackendReport { used: Backend::Cpu, reason });
    match wanted {
        Backend::Cpu => cpu(format!("cpu: asked for; {} threads", rayon::current_num_threads())),
        Backend::Gpu => match hardware_name() {
            Ok(name) => Ok(BackendReport { used: Backend::Gpu, reason: format!("gpu: {name}") }),
            Err(reason) => Err(Error::NoAdapter { reason }),
        },
        Backend::Auto => match hardware_name() {
            Ok(name) => Ok(BackendReport { used: Backend::Gpu, reason: format!("gpu: {name}") }),
            Err(reason) => cpu(format!("cpu: {reason}; {} threads", rayon::current_num_threads())),
        },
    }
}

#[cfg(feature = "gpu")]
use crate::gpu::adapter::hardware_name;

/// Name of the hardware adapter that would be used, or why there is none.
#[cfg(not(feature = "gpu"))]
fn hardware_name() -> std::result::Result<String, String> {
    Err("built without the feature `gpu`".into())
}

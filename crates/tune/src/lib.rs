#![doc = include_str!("../README.md")]

mod checkpoint;
mod clock;
mod codec_loop;
#[cfg(feature = "gpu")]
mod device;
mod error;
mod options;
mod plan;
mod progress;
mod prune;
mod rows;
mod run;
mod stage;
mod steering;
mod views;

pub use error::{Error, Result};
pub use options::{DEFAULT_QUALITY, Options, Target};
pub use plan::{Effort, Plan};
pub use progress::{Outcome, Progress, StageName};
pub use run::Tune;

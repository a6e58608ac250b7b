#![doc = include_str!("../README.md")]

mod checkpoint;
mod codec_loop;
mod course;
mod decimate;
#[cfg(feature = "gpu")]
mod device;
mod encode;
mod epochs;
mod error;
mod forecast;
mod options;
mod pace;
mod photos;
mod plan;
mod probe;
#[cfg(feature = "gpu")]
mod program;
mod progress;
mod runs;
mod scene_loop;
mod stage;
mod steering;
mod summed;
mod targets;
mod trainer;
mod undistort;
mod views;

pub use decimate::{DecimateOutcome, decimate};
pub use encode::{
    CameraDoubt, EncodeEvent, EncodeInput, EncodeOutcome, EncodeRecipe, VisibilityCount, encode,
    misfit,
};
pub use error::{Error, Result};
pub use options::{DEFAULT_QUALITY, Layout, Target, TuneOptions};
pub use photos::{Photos, at_camera, check_photos, photo, photos};
pub use plan::{TuneEffort, TunePlan};
pub use progress::{Progress, StageName, StopReason, TuneOutcome};
pub use runs::fine_tune::{FineTune, FineTuneOptions, FineTuneOutcome};
pub use runs::train::{Train, TrainOptions, TrainOutcome};
pub use runs::tune::Tune;
pub use targets::Targets;
pub use views::AgainstInput;

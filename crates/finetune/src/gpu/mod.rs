//! The WGSL executor, on wgpu: the stages of [`crate::stages`] with everything on the device.
//!
//! No kernel adds floats with atomics or across subgroups, so the result does not depend on the
//! scheduling. Nothing is read back during a run but the losses, every few steps.

mod device;
mod executor;
mod loops;
mod passes;
#[cfg(test)]
mod tests;
mod uniform;
mod workspace;

pub(crate) use device::{Context, find};
pub(crate) use executor::GpuExecutor;
pub(crate) use passes::{STEP, Stage};
pub(crate) use uniform::StepUniform;
pub(crate) use workspace::{Sizes, Workspace};

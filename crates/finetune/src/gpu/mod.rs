//! The WGSL executor, on wgpu: the stages of [`crate::stages`] with everything on the device.
//!
//! No kernel adds floats with atomics or across subgroups, so the result does not depend on the
//! scheduling. During a run only the losses are read back, every few steps.

pub(crate) mod adapter;
mod device;
mod executor;
pub(crate) mod kernels;
mod loops;
mod passes;
mod pipelines;
pub(crate) mod program;
mod removal;
pub(crate) mod sizes;
mod start;
mod steps;
#[cfg(test)]
mod tests;
mod transfer;
mod uniform;
mod workspace;

pub use executor::DeviceOptimiser;
pub use start::Adapter;

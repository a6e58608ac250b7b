//! Kernels of another crate among the stages of a step, on a graphics adapter.
//!
//! A step of a [`KernelLoop`] has the scene made by kernels of the caller, renders a view of it, and hands the
//! derivatives of the loss to other kernels of the caller. All of it stays on the device; only losses are read back.
//! The crate tune brings the kernels of the codec.
//!
//! No buffer passes 128 MiB: WebGPU promises no more. So the Gaussians of a large scene are bound in pages, and a kernel
//! works on one. It can read what belongs to its page alone.
//!
//! A kernel is WGSL text after [`STEP`] and, as far as it needs them, the other texts of this module. It adds no
//! floats with atomics or across subgroups, so that the result does not depend on the scheduling.

pub use crate::gpu::kernels::{KernelLoop, KernelStep};
pub use crate::gpu::program::{Call, Program, ProgramPage};
pub use crate::gpu::sizes::PAGE_GAUSSIANS;
pub use crate::shaders::{GAUSSIAN, PAGE, PROJECT_ADJOINT, STEP, Shader};

//! [`Executor`]: the interface of the Rust and the WGSL executor.

use gs_model::Scene;

use crate::error::Result;
use crate::stages::adam::{AdamStep, Moments};
use crate::stages::loss::LossValue;

/// An executor of the steps of a fine-tune, in Rust or in WGSL.
pub(crate) trait Executor: Send {
    /// Renders view `view`, adds its loss to the queue, updates the parameters. `step` counts
    /// from 1.
    fn step(&mut self, view: usize, step: u64, adam: &AdamStep) -> Result<()>;
    /// Moves the losses of the steps since the last call to the end of `out`, in order.
    fn drain_losses(&mut self, out: &mut Vec<LossValue>) -> Result<()>;
    /// The parameters and the optimiser's moments. They are three times the size of the model, so the
    /// Rust executor moves them out instead of copying them: before another step they must be given
    /// back with [`Self::restore`].
    fn take_state(&mut self) -> Result<(Scene, Moments)>;
    /// Takes back the result of [`Self::take_state`].
    fn restore(&mut self, scene: Scene, moments: Moments);
}

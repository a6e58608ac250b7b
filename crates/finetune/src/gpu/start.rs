//! [`Adapter`], and what starts on one for prepared views.

use gs_model::Scene;

use super::adapter::{hardware_name, software_name};
use super::device::Context;
use super::executor::DeviceOptimiser;
use super::kernels::KernelLoop;
use super::program::Program;
use crate::error::{Error, Result};
use crate::optimiser::SceneOptimiser;
use crate::view_gradients::ViewGradients;

/// Which graphics adapter to use.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Adapter {
    /// A hardware one.
    Hardware,
    /// One in software if there is one, else any: for tests.
    Software,
}

impl Adapter {
    /// Its name, kind and graphics API, for messages.
    ///
    /// # Errors
    /// [`NoAdapter`](crate::Error::NoAdapter).
    pub fn name(self) -> Result<String> {
        match self {
            Self::Hardware => hardware_name().map_err(|reason| Error::NoAdapter { reason }),
            Self::Software => software_name(),
        }
    }

    pub(super) fn context(self) -> Result<Context> {
        match self {
            Self::Hardware => Context::hardware(),
            Self::Software => Context::software(),
        }
    }
}

impl ViewGradients {
    /// Steps with kernels of the caller on a graphics adapter, for the same views and
    /// loss. Of `scene`, the kernels overwrite what they like.
    ///
    /// # Errors
    /// [`NoAdapter`](crate::Error::NoAdapter), [`Gpu`](crate::Error::Gpu).
    pub fn with_kernels(
        &self,
        adapter: Adapter,
        scene: &Scene,
        program: &Program,
    ) -> Result<KernelLoop> {
        KernelLoop::new(adapter.context()?, scene, program, (&self.views, self.loss))
    }

    /// An optimiser that goes on from `from` on a graphics adapter, for the same views and loss. It has no shrinkage
    /// and learns all SH degrees.
    ///
    /// # Errors
    /// [`NoAdapter`](crate::Error::NoAdapter), [`Gpu`](crate::Error::Gpu).
    pub fn scene_on_device(
        &self,
        adapter: Adapter,
        from: &SceneOptimiser,
    ) -> Result<DeviceOptimiser> {
        DeviceOptimiser::new(adapter.context()?, from, &self.views, self.loss)
    }
}

//! Removal effects and blending weights, summed over views by the processor or on a graphics adapter.

#[cfg(feature = "gpu")]
use finetune::Adapter;
use finetune::{Backend, Image, Removal, Visibility, backend, removal};
use gs_model::{Camera, Scene};

use crate::error::Result;

/// Where the sums are made: by the processor, unless there is an adapter.
#[derive(Default)]
pub(crate) struct DeviceSums {
    #[cfg(feature = "gpu")]
    pub(crate) adapter: Option<Adapter>,
    /// The processor goes on if the adapter fails.
    #[cfg(feature = "gpu")]
    may_fall_back: bool,
    /// Why the adapter failed, after which the processor goes on.
    #[cfg(feature = "gpu")]
    failed: Option<String>,
}

#[cfg(not(feature = "gpu"))]
impl DeviceSums {
    /// By the processor, as the backend says.
    pub(crate) fn on(wanted: Backend) -> Result<Self> {
        backend::choose(wanted)?;
        Ok(Self::default())
    }
}

#[cfg(feature = "gpu")]
impl DeviceSums {
    /// Where the backend says.
    pub(crate) fn on(wanted: Backend) -> Result<Self> {
        let on_gpu = backend::choose(wanted)?.used == Backend::Gpu;
        let adapter = on_gpu.then_some(Adapter::Hardware);
        Ok(Self { adapter, may_fall_back: wanted == Backend::Auto, failed: None })
    }

    /// The adapter, for the steps.
    ///
    /// # Errors
    /// Why it failed.
    pub(crate) fn adapter(&self) -> Result<Adapter> {
        let reason = || self.failed.clone().unwrap_or_else(|| "no adapter".into());
        Ok(self.adapter.ok_or_else(|| finetune::Error::Gpu { reason: reason() })?)
    }

    /// What the adapter finds, if there is one and it works.
    fn on_adapter<T>(
        &mut self,
        sum: impl FnOnce(Adapter) -> finetune::Result<T>,
    ) -> Result<Option<T>> {
        let found = self.adapter.map(sum).transpose();
        match found {
            Err(finetune::Error::Gpu { reason }) if self.may_fall_back => {
                (self.adapter, self.failed) = (None, Some(reason));
                Ok(None)
            }
            sums => Ok(sums?),
        }
    }
}

impl DeviceSums {
    /// Removal effects in the views of these cameras. `seen` gets the number and the render of each; after a failure of
    /// an adapter it gets them again from the first on.
    pub(crate) fn removal(
        &mut self,
        scene: &Scene,
        cameras: &[Camera],
        mut seen: Option<&mut dyn FnMut(usize, Image)>,
    ) -> Result<Removal> {
        #[cfg(feature = "gpu")]
        if let Some(sums) = self.on_adapter(|adapter| {
            let Some(seen) = &mut seen else { return adapter.removal(scene, cameras, None) };
            let mut numbered = numbered(seen);
            adapter.removal(scene, cameras, Some(&mut numbered))
        })? {
            return Ok(sums);
        }
        Ok(match &mut seen {
            Some(seen) => removal(scene, cameras, numbered(seen)),
            None => removal(scene, cameras, drop),
        })
    }

    /// The sums of squared blending weights in the views of these cameras.
    pub(crate) fn squared_weights(
        &mut self,
        scene: &Scene,
        cameras: &[Camera],
    ) -> Result<Vec<f32>> {
        #[cfg(feature = "gpu")]
        if let Some(sums) = self.on_adapter(|adapter| adapter.squared_weights(scene, cameras))? {
            return Ok(sums);
        }
        Ok(Visibility::of_all(scene, cameras).squared)
    }
}

/// Counts the images.
fn numbered<'a>(seen: &'a mut dyn FnMut(usize, Image)) -> impl FnMut(Image) + 'a {
    let mut next = 0;
    move |image| {
        seen(next, image);
        next += 1;
    }
}

#[cfg(all(test, feature = "gpu"))]
mod tests {
    use super::*;

    #[test]
    fn the_processor_goes_on_where_it_may() {
        let fails = |_| Err::<u8, _>(finetune::Error::Gpu { reason: "lost".into() });
        let on = |may_fall_back| DeviceSums {
            adapter: Some(Adapter::Software),
            may_fall_back,
            failed: None,
        };
        assert_eq!(on(true).on_adapter(|_| Ok(3)).unwrap(), Some(3));
        let mut auto = on(true);
        assert_eq!(auto.on_adapter(fails).unwrap(), None);
        let error = auto.adapter().unwrap_err();
        assert!(error.to_string().contains("lost"), "{error}");
        assert_eq!(auto.on_adapter(|_| Ok(3)).unwrap(), None);
        assert!(on(false).on_adapter(fails).is_err());
    }
}

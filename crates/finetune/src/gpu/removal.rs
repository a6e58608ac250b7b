//! What leaving out each Gaussian changes, and blending weights, summed over views on a graphics adapter.

use gs_model::{Camera, Scene};

use super::device::Context;
use super::passes::REMOVAL;
use super::start::Adapter;
use super::steps::{DeviceSteps, Mover};
use crate::error::Result;
use crate::forward::image_of;
use crate::image::Image;
use crate::optimiser::rows_of;
use crate::options::{Loss, RenderOptions};
use crate::stages::blend::TilePixels;
use crate::stages::project::RenderView;
use crate::stages::removal::Removal;
use crate::visibility::sampled;

impl Adapter {
    /// [`crate::removal`] on this adapter. The scene is uploaded; the sums and, if `seen` is there, the renders are read.
    ///
    /// # Errors
    /// [`NoAdapter`](crate::Error::NoAdapter), [`Gpu`](crate::Error::Gpu).
    pub fn removal(
        self,
        scene: &Scene,
        cameras: &[Camera],
        seen: Option<&mut dyn FnMut(Image)>,
    ) -> Result<Removal> {
        if cameras.is_empty() {
            return Ok(crate::removal(scene, cameras, drop));
        }
        steps_of(self.context()?, scene)?.removal(cameras.iter().map(whole), seen)
    }

    /// [`Visibility::squared`](crate::Visibility::squared) of every camera on this adapter.
    ///
    /// # Errors
    /// As [`Adapter::removal`].
    pub fn squared_weights(self, scene: &Scene, cameras: &[Camera]) -> Result<Vec<f32>> {
        if cameras.is_empty() {
            return Ok(vec![0.0; scene.len()]);
        }
        let views = (0..).zip(cameras).map(|(n, camera)| sampled(camera, n));
        Ok(steps_of(self.context()?, scene)?.removal(views, None)?.squared)
    }
}

/// A scene without training views.
pub(super) fn steps_of(context: Context, scene: &Scene) -> Result<DeviceSteps> {
    let steps = DeviceSteps::new(context, scene, (&[], Loss::MSE), Mover::Nothing)?;
    steps.workspace.upload(&[&rows_of(scene)]);
    Ok(steps)
}

/// A whole view, which counts once.
pub(super) fn whole(camera: &Camera) -> (RenderView, f32) {
    (RenderView::new(camera, &RenderOptions::default()), 1.0)
}

impl DeviceSteps {
    /// Sums over views, each of which counts so many times. `seen` gets the render of each.
    pub(super) fn removal(
        &mut self,
        views: impl Iterator<Item = (RenderView, f32)>,
        mut seen: Option<&mut dyn FnMut(Image)>,
    ) -> Result<Removal> {
        for (number, (view, weight)) in (0..).zip(views) {
            let at = self.add_view(&view)?;
            let mut u = self.uniform(at, number + 1);
            u.view_weight = weight;
            self.step(at, u, &REMOVAL)?;
            if let Some(seen) = &mut seen {
                self.settle()?;
                let tiles: Vec<TilePixels> = self.workspace.read("pixels", 0, view.tiles())?;
                seen(image_of(&tiles, &view));
            }
        }
        self.settle()?;
        let mut out = Removal::default();
        for (page, &n) in self.workspace.sizes.pages.iter().enumerate() {
            for [effect, squared] in self.workspace.read::<[f32; 2]>("totals", page, n)? {
                out.effects.push(effect);
                out.squared.push(squared);
            }
        }
        Ok(out)
    }
}

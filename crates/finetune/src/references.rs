//! Renders of a scene, to measure the loss of its stream.

use gs_model::{Camera, Scene};

use crate::train_view::TrainView;

/// Views of [`References`]; more only take longer.
const REFERENCES: usize = 12;

/// Renders of a scene, to measure its stream against.
#[derive(Clone, Debug)]
pub struct References {
    views: Vec<TrainView>,
}

impl References {
    /// Renders `scene` from at most 12 of the cameras, evenly spread. `step` is called after each render with the
    /// numbers of renders that are done and that there will be. An error from it ends the work.
    ///
    /// # Errors
    /// Those of `step`.
    pub fn new<E>(
        scene: &Scene,
        cameras: &[Camera],
        mut step: impl FnMut(usize, usize) -> Result<(), E>,
    ) -> Result<Self, E> {
        let every = cameras.len().div_ceil(REFERENCES).max(1);
        let chosen: Vec<&Camera> = cameras.iter().step_by(every).collect();
        let mut views = Vec::with_capacity(chosen.len());
        for camera in &chosen {
            views.push(TrainView::rendered(scene, (*camera).clone()));
            step(views.len(), chosen.len())?;
        }
        Ok(Self { views })
    }

    /// Mean over the views of the PSNR of `scene`'s render, dB.
    #[must_use]
    pub fn psnr(&self, scene: &Scene) -> f64 {
        self.mean(|view| view.psnr(scene))
    }

    /// Mean over the views of the SSIMULACRA2 of `scene`'s render.
    #[must_use]
    pub fn ssimulacra2(&self, scene: &Scene) -> f64 {
        self.mean(|view| view.ssimulacra2(scene))
    }

    fn mean(&self, score: impl Fn(&TrainView) -> f64) -> f64 {
        self.views.iter().map(score).sum::<f64>() / self.views.len() as f64
    }
}

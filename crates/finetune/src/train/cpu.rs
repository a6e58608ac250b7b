//! The Rust executor.

use gs_model::Scene;

use super::executor::Executor;
use super::options::FineTuneOptions;
use super::view::TrainView;
use crate::error::Result;
use crate::gradients::{Backward, planes_of};
use crate::options::{Loss, RenderOptions};
use crate::quantization::Quantization;
use crate::stages::adam::{AdamStep, Moments, adam};
use crate::stages::blend_adjoint::FROZEN;
use crate::stages::loss::LossValue;
use crate::stages::project::View;

pub(crate) struct CpuExecutor {
    scene: Scene,
    moments: Moments,
    /// Views with their photos as planes.
    views: Vec<(View, Vec<f32>)>,
    loss: Loss,
    seed: u64,
    quantization: Option<Quantization>,
    quantized: Scene,
    pass: Backward<FROZEN>,
    losses: Vec<LossValue>,
}

impl CpuExecutor {
    pub(crate) fn new(
        scene: Scene,
        moments: Moments,
        views: Vec<TrainView>,
        options: &FineTuneOptions,
    ) -> Self {
        let render = RenderOptions { background: options.background, ..Default::default() };
        Self {
            scene,
            moments,
            views: views
                .into_iter()
                .map(|v| (View::new(&v.camera, &render), planes_of(&v.photo)))
                .collect(),
            loss: options.loss,
            seed: options.seed,
            quantization: options.quantization.filter(|q| !q.is_idle()),
            quantized: Scene::default(),
            pass: Backward::default(),
            losses: Vec::new(),
        }
    }
}

impl Executor for CpuExecutor {
    fn step(&mut self, view: usize, step: u64, rates: &AdamStep) -> Result<()> {
        let (view, photo) = &self.views[view];
        let rendered = match &self.quantization {
            Some(q) => {
                q.apply(&self.scene, self.seed, step, &mut self.quantized);
                Some(&self.quantized)
            }
            None => None,
        };
        let loss = self.pass.run(rendered.unwrap_or(&self.scene), view, photo, self.loss);
        let sums = &self.pass.sums;
        adam(view, rates, sums, rendered, &mut self.scene, &mut self.moments);
        self.losses.push(loss);
        Ok(())
    }

    fn drain_losses(&mut self, out: &mut Vec<LossValue>) -> Result<()> {
        out.append(&mut self.losses);
        Ok(())
    }

    fn take_state(&mut self) -> Result<(Scene, Moments)> {
        Ok((std::mem::take(&mut self.scene), std::mem::take(&mut self.moments)))
    }

    fn restore(&mut self, scene: Scene, moments: Moments) {
        (self.scene, self.moments) = (scene, moments);
    }
}

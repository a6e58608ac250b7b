//! [`LatentExecutor`]: steps on the values of a codec.

use gs_model::Scene;

use super::device::Context;
use super::executor::{on_device, sizes};
use super::passes::LATENT_STEP;
use super::sizes::CodecSizes;
use super::steps::DeviceSteps;
use super::uniform::StepUniform;
use super::workspace::Workspace;
use crate::error::{Error, Result};
use crate::latents::{Codec, LatentState, LatentStep};
use crate::optimiser::{Adam, SceneOptimiser, rows_of};
use crate::options::LearningRates;
use crate::view_gradients::{PreparedView, ViewLoss};

/// See [`crate::latents`].
pub struct LatentExecutor {
    steps: DeviceSteps,
    values: usize,
    base: StepUniform,
    weights: Vec<f32>,
}

impl std::fmt::Debug for LatentExecutor {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("LatentExecutor").field("values", &self.values).finish()
    }
}

impl LatentExecutor {
    /// `scene` holds the leaves in their order, then Gaussians that do not move. Only the means of the leaves
    /// count: the rest follows from the values.
    pub(crate) fn new(
        context: Context,
        scene: &Scene,
        codec: &Codec,
        views: &[PreparedView],
    ) -> Result<Self> {
        let mut sizes = sizes(scene, views.iter().map(|v| &v.view));
        sizes.codec = CodecSizes {
            leaves: codec.leaves.len(),
            channels: codec.channels(),
            merges: codec.merges.len(),
            chunks: codec.chunks.len(),
        };
        let mut workspace = Workspace::new(context, sizes)?;
        let rows = rows_of(scene);
        let still = vec![0.0; rows.len()];
        workspace.upload([&rows, &still, &still]);
        workspace.set_codec(codec);
        let base = StepUniform {
            count: scene.len() as u32,
            sh_len: scene.sh_len() as u32,
            ..StepUniform::default()
        };
        let on_device = on_device(&workspace, views)?;
        let values = codec.leaves.len() * codec.channels();
        let steps = DeviceSteps::new(workspace, on_device)?;
        Ok(Self { steps, values, base, weights: views.iter().map(|v| v.weight).collect() })
    }

    /// Uploads values and moments.
    ///
    /// # Errors
    /// [`Error::Gpu`] if there are not as many as the codec has.
    pub fn set_state(&mut self, state: &LatentState) -> Result<()> {
        let [first, second] = &state.moments;
        for found in [state.values.len(), first.len(), second.len()] {
            if found != self.values {
                let reason = format!("{found} values, where the codec has {}", self.values);
                return Err(Error::Gpu { reason });
            }
        }
        self.steps.settle()?;
        self.steps.workspace.write("latents", &state.values);
        self.steps.workspace.write("latent_moments", &[first.as_slice(), second].concat());
        Ok(())
    }

    /// Fetches values and moments.
    ///
    /// # Errors
    /// [`Error::Gpu`].
    pub fn state(&mut self) -> Result<LatentState> {
        self.steps.settle()?;
        let workspace = &self.steps.workspace;
        let mut first: Vec<f32> = workspace.read("latent_moments", 2 * self.values)?;
        let second = first.split_off(self.values);
        let values = workspace.read("latents", self.values)?;
        Ok(LatentState { values, moments: [first, second] })
    }

    /// Steps and predictions from now on; the rest of `codec` must be as before.
    ///
    /// # Errors
    /// [`Error::Gpu`].
    pub fn update(&mut self, codec: &Codec) -> Result<()> {
        self.steps.settle()?;
        self.steps.workspace.update_codec(codec);
        Ok(())
    }

    /// Submits a step. It does not wait for the device.
    ///
    /// # Errors
    /// [`Error::Gpu`].
    pub fn step(&mut self, step: &LatentStep) -> Result<()> {
        let view = step.view % self.steps.views.len();
        let (inverse_bias1, inv_sqrt_bias2) = Adam::new(step.number).corrections();
        let mut u = self.steps.views[view].view.merge(&self.base);
        u.rates = step.rates.map(|r| r * inverse_bias1);
        u.inv_sqrt_bias2 = inv_sqrt_bias2;
        u.view_weight = self.weights[view];
        u.bit_price = if step.coded { step.bit_price } else { 0.0 };
        u.step = step.number as u32;
        self.steps.step(view, u, if step.coded { &LATENT_STEP } else { &LATENT_STEP[1..] })
    }

    /// The losses of the steps since the last call, in order. Waits for the device.
    ///
    /// # Errors
    /// [`Error::Gpu`].
    pub fn losses(&mut self) -> Result<Vec<ViewLoss>> {
        self.steps.losses()
    }

    /// The scene that the codec made last, for tests: means and Gaussians that do not move are those of
    /// `scene`.
    ///
    /// # Errors
    /// [`Error::Gpu`].
    #[doc(hidden)]
    pub fn scene(&mut self, scene: &mut Scene) -> Result<()> {
        self.steps.settle()?;
        let mut out = SceneOptimiser::new(scene.clone(), LearningRates::default(), 0.0);
        out.set_state(self.steps.workspace.download()?);
        *scene = out.take_scene();
        Ok(())
    }

    /// The derivatives of the bits by the values when the codec ran last, for tests.
    ///
    /// # Errors
    /// [`Error::Gpu`].
    #[doc(hidden)]
    pub fn bit_prices(&mut self, codec: &Codec) -> Result<Vec<f32>> {
        self.steps.settle()?;
        let mut prices: Vec<f32> = self.steps.workspace.read("bit_prices", self.values)?;
        for (row, leaf) in prices.chunks_exact_mut(codec.channels()).zip(&codec.leaves) {
            row.iter_mut().for_each(|p| *p *= leaf.weight);
        }
        Ok(prices)
    }
}

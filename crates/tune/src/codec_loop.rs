//! The second stage: the codec in the loop.
//!
//! A step renders one view of what a decoder would return, and takes the gradient back to the values
//! that the codec transforms, as if quantisation were the identity (straight-through). Every few steps the
//! codec makes a new scene of the values, and the bits have a gradient too, from what the coder expects of
//! each coefficient. The steps between render the same scene, which costs little more than a plain step.

use finetune::optimiser::{Adam, AdamMoments, Flat};
#[cfg(feature = "gpu")]
use finetune::{Adapter, kernels::KernelStep};
use finetune::{ViewGradients, ViewLoss};
use gpcc_lite::Octree;
use gs_model::Scene;
use gsvx::latents::{Attribute, GaussianGradient, Latents};

#[cfg(feature = "gpu")]
use crate::device::Device;
use crate::error::Result;
use crate::plan::{self, DC_BASIS, TunePlan};
use crate::scene_loop::decay;

/// Adam's rates of the channels at the first step, divided by the quantisation step of the DC values: ln(alpha), DC,
/// the other SH coefficients, covariance. So a value moves by the same part of its quantisation step at each quality.
const RATES: [f32; 4] = [0.105, 0.032, 0.0042, 0.053];
/// Rates keep their value in this first part of the loop, then they fall to a fraction: see `plan`.
const HELD: f64 = 0.7;
const FINAL_RATE: f64 = 0.05;
/// The codec runs, and the bits have a gradient, once in this many steps.
const CODED: u64 = 4;
/// The predictions are fitted once in this many steps. A checkpoint is possible only where they are.
pub(crate) const FITTED: u64 = 48;
const _: () = assert!(FITTED.is_multiple_of(CODED), "a fit runs the codec");
/// Price of a bit over that of a uniform quantiser at high rates. The latter is the derivative of
/// `step^2 / 12` by the bits, `ln 2 / 6 step^2`.
const PRICE: f64 = 16.0;

/// The latents, and what the codec made of them last.
pub(crate) struct CodecLoop {
    pub(crate) latents: Latents,
    pub(crate) leaves: LoopLeaves,
    /// What a decoder would return when the codec last ran, then the outliers.
    pub(crate) scene: Scene,
    pub(crate) moments: AdamMoments,
    /// The derivatives of the bits when the codec last ran here.
    pub(crate) prices: Vec<f32>,
    pub(crate) quality: f32,
    /// Loss per bit for a DC step of 1.
    price: f64,
    pub(crate) steps: u64,
    pub(crate) done: u64,
    /// Bytes when they were last counted.
    pub(crate) bytes: u64,
    /// Scene, prices, predictions and bytes are those of the values and steps as they are.
    settled: bool,
    /// Runs the steps on a GPU, if there is one.
    #[cfg(feature = "gpu")]
    pub(crate) device: Option<Device>,
}

/// Values and quality that a loop can come back to.
pub(crate) struct Snapshot {
    pub(crate) values: Vec<f32>,
    pub(crate) quality: f32,
}

/// The leaves and what does not change of them.
pub(crate) struct LoopLeaves {
    pub(crate) octree: Octree,
    /// Importance of each leaf.
    pub(crate) importance: Vec<f32>,
    pub(crate) outliers: Option<Scene>,
}

impl CodecLoop {
    /// Begins at the plan's quality. `pixels` are those of all cameras.
    pub(crate) fn new(plan: &TunePlan, pixels: f64, leaves: LoopLeaves, latents: Latents) -> Self {
        let LoopLeaves { octree, importance, outliers } = &leaves;
        let n = latents.values().len();
        let mut scene = latents.empty_scene();
        if let Some(outliers) = outliers {
            // The leaves come before the outliers; their values are filled in by the first step.
            let blank = vec![0; octree.len()];
            scene.append(&outliers.select(&blank));
            scene.append(outliers);
        }
        // An error e of the DC value of a Gaussian changes the mean over pixels and channels of the
        // squared error by e^2 DC_BASIS^2 w / (3 pixels), w its importance. Steps are those of a
        // Gaussian of mean importance.
        let sum: f64 = importance.iter().map(|&v| f64::from(v)).sum();
        let weight = sum / importance.len().max(1) as f64 / (3.0 * pixels.max(1.0));
        let price = PRICE * std::f64::consts::LN_2 / 6.0 * DC_BASIS * DC_BASIS * weight;
        Self {
            latents,
            leaves,
            scene,
            moments: AdamMoments::zeros(n),
            prices: vec![0.0; n],
            quality: plan.quality,
            price,
            steps: plan.loop_steps,
            done: 0,
            bytes: 0,
            settled: false,
            #[cfg(feature = "gpu")]
            device: None,
        }
    }

    /// MSE per bit.
    pub(crate) fn lambda(&self) -> f64 {
        let dc = f64::from(self.latents.steps().dc);
        self.price * dc * dc
    }

    /// Goes to another quality: other steps, and another price of bits.
    pub(crate) fn set_quality(&mut self, quality: f32) -> Result<()> {
        self.quality = quality.clamp(0.0, 100.0);
        self.settled = false;
        Ok(self.latents.set_steps(plan::steps(self.quality)?)?)
    }

    /// Whether the next step fits the predictions. Before such a step a checkpoint does not need them.
    pub(crate) fn at_fit(&self) -> bool {
        self.done.is_multiple_of(FITTED)
    }

    /// Moves the steps to a graphics adapter, in pages of at most so many leaves, unless they are there.
    #[cfg(feature = "gpu")]
    pub(crate) fn place(&mut self, on: (Adapter, usize), views: &mut ViewGradients) -> Result<()> {
        if self.device.is_some() {
            return Ok(());
        }
        // Fills in the means and fits the predictions.
        self.settle()?;
        let loss = views.run(&self.scene, 0);
        let Self { latents, scene, moments, .. } = self;
        self.device = Some(Device::new(on, views, scene, latents, moments, loss)?);
        Ok(())
    }

    /// Fetches what a device has made of the values since the last time.
    pub(crate) fn fetch(&mut self) -> Result<()> {
        #[cfg(feature = "gpu")]
        if let Some(device) = &mut self.device {
            device.fetch(&mut self.latents, &mut self.moments)?;
        }
        Ok(())
    }

    /// Moves the following steps back to the processor.
    pub(crate) fn leave_device(&mut self) -> Result<()> {
        self.fetch()?;
        #[cfg(feature = "gpu")]
        drop(self.device.take());
        Ok(())
    }

    /// One step at a view. On a device the loss is that of an earlier step.
    pub(crate) fn step(&mut self, views: &mut ViewGradients, view: usize) -> Result<ViewLoss> {
        let (coded, fit) = (self.done.is_multiple_of(CODED), self.at_fit());
        // The price of a bit, where the codec runs.
        let lambda = if coded { self.lambda() as f32 } else { 0.0 };
        let held = (HELD * self.steps as f64) as u64;
        let scale = self.latents.steps().dc * decay(FINAL_RATE, held, self.done, self.steps);
        let rates = RATES.map(|rate| rate * scale);
        #[cfg(feature = "gpu")]
        if self.device.is_some() && fit && !self.settled {
            self.settle()?;
        }
        #[cfg(feature = "gpu")]
        if let Some(device) = &mut self.device {
            if fit {
                device.update(&self.latents)?;
            }
            let number = self.done + 1;
            let step = KernelStep { view, number, rates, made: coded, extra: lambda };
            let loss = device.step(&step)?;
            (self.done, self.settled) = (number, false);
            return Ok(loss);
        }
        if coded && !self.settled {
            self.code(fit)?;
        }
        self.settled = false;
        let loss = views.run(&self.scene, view);
        self.done += 1;
        let rates = self.rates_of_channels(rates);
        let mut values = std::mem::take(self.latents.values_mut());
        let (latents, scene, views, prices) = (&self.latents, &self.scene, &*views, &self.prices);
        let gradient = |i: usize, _: &[f32], row: &mut [f32]| {
            if let Some(g) = views.of(scene, i) {
                let given = GaussianGradient {
                    opacity_logit: g.opacity_logit,
                    sh: &g.sh,
                    log_scale: g.log_scale,
                    rotation: g.rotation,
                };
                latents.gradient(scene, i, &given, row);
            }
            if lambda != 0.0 {
                let first = i * row.len();
                row.iter_mut().zip(&prices[first..]).for_each(|(g, p)| *g += lambda * p);
            }
        };
        // An opacity is at most 1.
        let after = |row: &mut [f32]| row[0] = row[0].min(0.0);
        let rows = Flat::chunks(&mut values, rates.len());
        self.moments.step(Adam::new(self.done), &rates, rows, |_| true, gradient, after);
        *self.latents.values_mut() = values;
        Ok(loss)
    }

    /// The rate of each value of a leaf.
    fn rates_of_channels(&self, [opacity, dc, ac, covariance]: [f32; 4]) -> Vec<f32> {
        let mut rates = vec![0.0; self.latents.channels()];
        for group in self.latents.groups() {
            let values = group.among(rates.len());
            rates[values].fill(match group.attribute {
                Attribute::Opacity => opacity,
                Attribute::Colour { degree: 0 } => dc,
                Attribute::Colour { .. } => ac,
                Attribute::Covariance | Attribute::Position => covariance,
            });
        }
        rates
    }

    /// Fits predictions to the values as they are, and makes scene, prices and bytes of them.
    pub(crate) fn settle(&mut self) -> Result<()> {
        self.fetch()?;
        self.code(true)?;
        self.settled = true;
        Ok(())
    }

    /// Runs the codec: scene and prices of the values as they are; with a fit, predictions and bytes too.
    fn code(&mut self, fit: bool) -> Result<()> {
        let Self { latents, scene, prices, .. } = self;
        self.bytes = latents.reconstruct(fit, Some(prices), scene)?.unwrap_or(self.bytes);
        Ok(())
    }

    pub(crate) fn snapshot(&self) -> Snapshot {
        Snapshot { values: self.latents.values().to_vec(), quality: self.quality }
    }

    /// Comes back to a snapshot.
    pub(crate) fn restore(&mut self, snapshot: Snapshot) -> Result<()> {
        *self.latents.values_mut() = snapshot.values;
        self.set_quality(snapshot.quality)?;
        self.settle()
    }
}

//! [`FineTuneOptions`].

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use crate::backend::Backend;
use crate::error::{Error, Result};
use crate::options::{LearningRates, Loss};
use crate::quantization::Quantization;

/// How to fine-tune.
#[derive(Clone, Debug)]
pub struct FineTuneOptions {
    /// Largest number of steps; one view each. The paper uses 8000.
    pub steps: u64,
    /// What is minimised.
    pub loss: Loss,
    /// Adam's learning rates at the first step.
    pub rates: LearningRates,
    /// The rates decay exponentially to this fraction at the last step; 1 keeps them.
    pub final_rate: f64,
    /// Seed of the order of the views and of the quantisation noise.
    pub seed: u64,
    /// Stop when the mean PSNR over the views of an epoch, as rendered during it, reaches this
    /// many dB: usually what the model had before voxelization.
    pub target_psnr: Option<f64>,
    /// Stop when the PSNR of the epochs has not grown by [`FineTuneOptions::min_gain_db`] for this
    /// many epochs.
    pub patience: Option<u32>,
    /// The gain in dB that [`FineTuneOptions::patience`] waits for.
    pub min_gain_db: f64,
    /// Quantisation in the loop.
    pub quantization: Option<Quantization>,
    /// Background colour of the renders.
    pub background: [f32; 3],
    /// Where to keep a checkpoint. An existing one is continued.
    pub checkpoint: Option<PathBuf>,
    /// Steps between checkpoints, at least 1.
    pub checkpoint_every: u64,
    /// Steps between progress reports, at least 1.
    pub report_every: u64,
    /// Setting it, for example in a Ctrl-C handler, ends the run after the current step.
    pub cancel: Option<Arc<AtomicBool>>,
    /// Which executor runs.
    pub backend: Backend,
}

impl Default for FineTuneOptions {
    fn default() -> Self {
        Self {
            steps: 8000,
            loss: Loss::default(),
            rates: LearningRates::default(),
            final_rate: 0.1,
            seed: 0,
            target_psnr: None,
            patience: None,
            min_gain_db: 0.01,
            quantization: None,
            background: [0.0; 3],
            checkpoint: None,
            checkpoint_every: 1000,
            report_every: 10,
            cancel: None,
            backend: Backend::Cpu,
        }
    }
}

impl FineTuneOptions {
    pub(crate) fn validate(&self) -> Result<()> {
        let positive = |option, value: f64| {
            let ok = value.is_finite() && value > 0.0;
            let expected = "a positive number";
            if ok { Ok(()) } else { Err(Error::Option { option, value, expected }) }
        };
        let at_least_zero = |option, value: f32| {
            let (ok, value) = (value.is_finite() && value >= 0.0, f64::from(value));
            let expected = "zero or a positive number";
            if ok { Ok(()) } else { Err(Error::Option { option, value, expected }) }
        };
        positive("final_rate", self.final_rate)?;
        positive("checkpoint_every", self.checkpoint_every as f64)?;
        positive("report_every", self.report_every as f64)?;
        let r = &self.rates;
        at_least_zero("rates.sh_dc", r.sh_dc)?;
        at_least_zero("rates.sh_rest", r.sh_rest)?;
        at_least_zero("rates.opacity", r.opacity)?;
        at_least_zero("rates.log_scale", r.log_scale)?;
        at_least_zero("rates.rotation", r.rotation)?;
        if let Loss::L1Ssim { ssim_weight } = self.loss
            && !(0.0..=1.0).contains(&ssim_weight)
        {
            let value = f64::from(ssim_weight);
            return Err(Error::Option { option: "ssim_weight", value, expected: "in 0..=1" });
        }
        if let Some(q) = &self.quantization {
            at_least_zero("quantization.sh_dc", q.sh_dc)?;
            at_least_zero("quantization.sh_rest", q.sh_rest)?;
            at_least_zero("quantization.opacity_logit", q.opacity_logit)?;
            at_least_zero("quantization.log_scale", q.log_scale)?;
            at_least_zero("quantization.rotation", q.rotation)?;
        }
        for value in self.background {
            at_least_zero("background", value)?;
        }
        Ok(())
    }

    /// Factor of the learning rates at `step`, counted from 1.
    pub(crate) fn decay_at(&self, step: u64) -> f64 {
        let last = self.steps.saturating_sub(1).max(1) as f64;
        libm::pow(self.final_rate, (step - 1) as f64 / last)
    }
}

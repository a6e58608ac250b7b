//! [`PlanFile`]: what `gsvx plan` writes.

use super::cameras::CameraFile;
use super::inputs::SceneFile;
use crate::exit::note;
use crate::input::{self, Reading, name};
use anyhow::{Context, Result, bail};
use gsvx::Plan;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// A plan, and the inputs that it is for.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct PlanFile {
    /// The version of gsvx. Another may cut and code differently.
    pub(crate) gsvx: String,
    pub(crate) reading: Reading,
    pub(crate) inputs: Vec<SceneFile>,
    pub(crate) cameras: Option<CameraFile>,
    pub(crate) plan: Plan,
}

impl PlanFile {
    /// Reads a plan.
    pub(crate) fn read(path: &Path) -> Result<Self> {
        let bytes = input::bytes(path)?;
        Self::parse(&bytes)
            .with_context(|| format!("{}: is no plan; gsvx plan makes one", name(path)))
    }

    /// A plan from its text.
    pub(crate) fn parse(bytes: &[u8]) -> Result<Self> {
        let plan: Self = serde_json::from_slice(bytes)?;
        if plan.gsvx != super::VERSION {
            bail!("made by gsvx {}, this is {}; make the plan anew", plan.gsvx, super::VERSION);
        }
        Ok(plan)
    }

    pub(crate) fn text(&self) -> Result<String> {
        Ok(serde_json::to_string(self)? + "\n")
    }

    /// Warns if cells are coarse beside the Gaussians.
    pub(crate) fn warn_of_coarse_cells(&self) {
        if let Some(warning) = self.plan.warning() {
            note(format_args!("warning: {warning}"));
        }
    }

    /// Tells this plan from others.
    pub(crate) fn id(&self) -> Result<u32> {
        Ok(crc32c::crc32c(self.text()?.as_bytes()))
    }
}

//! [`ReadOptions`] and [`Report`]: how a model is read, and what its file held.

use std::path::Path;

use crate::codec::Codec;
use crate::doubts::Doubts;
use crate::error::{Error, Result};
use crate::limits::Limits;
use crate::scene::Scene;

/// What to do with Gaussians that are invalid (see [`crate::validate::InvalidGaussians`]).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Invalid {
    /// Fail with [`crate::Error::InvalidGaussian`], which names the first one and their number.
    #[default]
    Error,
    /// Leave them out, and those whose values no model has (see [`Scene::drop_invalid`]); the report counts them.
    Drop,
    /// Keep every value as it is, infinite opacities and scales of 0 too: for coding bit for bit.
    Keep,
}

/// What is done about the axes of a format whose files do not agree on them: SPZ.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum FileAxes {
    /// The model is turned from the axes that the file declares, or else from those of the specification.
    #[default]
    Turn,
    /// The numbers stay as they are, as Niantic's own command-line tools leave them.
    Keep,
}

/// How to read a model. The default is strict: any invalid Gaussian is an error.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ReadOptions {
    /// What to do with invalid Gaussians.
    pub invalid: Invalid,
    /// What to do about the axes of SPZ files.
    pub axes: FileAxes,
    /// Decodes primitives of glTF that are compressed. Without it they are an error.
    pub codec: Option<&'static Codec>,
    /// Accept so many Gaussians that are compressed, even if [`Codec::most`] is less.
    pub max_gaussians: Option<u64>,
}

/// The note about a file of SH degree 4.
pub(crate) const DEGREE_4: &str =
    "SH coefficients of degree 4 are not kept; degrees 0 to 3 are read";

/// What a model file held.
#[derive(Clone, Debug, Default)]
#[non_exhaustive]
pub struct Report {
    /// The [`crate::Format::name`] of the format.
    pub format: &'static str,
    /// The form of the file in words: `SPZ, version 4`.
    pub form: String,
    /// Bytes of the files beside it that belong to the model: the images of a SOG.
    pub bytes_beside: u64,
    /// Gaussians in the file.
    pub gaussians_in_file: usize,
    /// Invalid Gaussians that were left out.
    pub dropped: usize,
    /// What the file holds that the scene does not have, and what was read as something else: a sentence each,
    /// without the name of the file.
    pub notes: Vec<String>,
    /// Why the model may not be what it seems ([`Doubts`]): a sentence each.
    pub warnings: Vec<String>,
}

impl Report {
    /// All that is to be said of the file: warnings, then notes.
    #[must_use]
    pub fn sentences(&self) -> Vec<String> {
        [&self.warnings[..], &self.notes].concat()
    }

    /// Of a file of this form that holds nothing but Gaussians.
    pub(crate) fn of(format: &'static str, form: impl Into<String>) -> Self {
        Self { format, form: form.into(), ..Self::default() }
    }
}

/// What became of the Gaussians of a file after they were read.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct CleaningReport {
    read: usize,
    dropped: usize,
    kept: usize,
    limits: Limits,
    doubts: Doubts,
}

impl CleaningReport {
    /// Adds it to the report.
    pub(crate) fn report(self, report: &mut Report) {
        (report.gaussians_in_file, report.dropped) = (self.read, self.dropped);
        report.notes.extend(self.limits.sentences());
        report.warnings.extend(self.doubts.sentences());
        if self.dropped > 0 {
            let (n, all) = (self.dropped, self.read);
            let what = if n == 1 { "Gaussian is" } else { "Gaussians are" };
            report.notes.push(format!("{n} invalid {what} left out, of {all}"));
        }
        if self.kept > 0 {
            let (n, all) = (self.kept, self.read);
            let what = if n == 1 { "Gaussian has" } else { "Gaussians have" };
            let values = "values that are not finite, or no direction";
            report.notes.push(format!("{n} {what} {values}, of {all}; they are kept as they are"));
        }
    }
}

impl ReadOptions {
    /// Cleans a scene just read and reports it. `file` is for the message.
    pub(crate) fn apply(&self, file: &Path, scene: &mut Scene, report: &mut Report) -> Result<()> {
        let mut cleaned = CleaningReport::default();
        self.clean(file, scene, &mut cleaned)?;
        cleaned.report(report);
        Ok(())
    }

    /// Clamps the values at their limits and looks for invalid Gaussians. This is the one place that does, for all
    /// formats. The index in an error is that of the file whose Gaussians `cleaned` counts.
    pub(crate) fn clean(
        &self,
        file: &Path,
        scene: &mut Scene,
        cleaned: &mut CleaningReport,
    ) -> Result<()> {
        let first = cleaned.read;
        cleaned.read += scene.len();
        if self.invalid != Invalid::Keep {
            cleaned.limits = cleaned.limits.plus(scene.clamp_limits());
        }
        match self.invalid {
            Invalid::Keep => cleaned.kept += scene.invalid().map_or(0, |invalid| invalid.count),
            Invalid::Drop => cleaned.dropped += scene.drop_invalid(),
            Invalid::Error => scene.refuse_invalid(file).map_err(|error| match error {
                Error::InvalidGaussian { file, index, field, value, count } => {
                    Error::InvalidGaussian { file, index: first + index, field, value, count }
                }
                other => other,
            })?,
        }
        cleaned.doubts.add(scene);
        Ok(())
    }
}

//! Arrays to streams: the choices of `gsvx encode`, in its order, so that the bytes are the same.

use crate::arrays::SplatArrays;
use crate::background::{Event, Line, run};
use crate::cameras::{CameraArrays, Cameras};
use crate::error::{Fault, Result};
use gs_model::{Doubts, Limits, Scene};
use gsvx::{
    Aim, CodeOptions, EncodeOptions, EncodeProgress, EncodedStream, LEFT_OUT, Leaves, MaxError,
    Measure, PrepareOptions,
};
use numpy::PyArray1;
use pyo3::prelude::*;
use pyo3::types::{IntoPyDict, PyBytes, PyDict};
use std::ops::ControlFlow;
use std::time::Instant;
use tune::{EncodeEvent, EncodeOutcome, EncodeRecipe, Layout};

/// CompressOptions as Python has them.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct CompressOptions {
    quality: Option<f32>,
    target_bytes: Option<u64>,
    target_psnr: Option<f64>,
    target_ssimulacra2: Option<f64>,
    lossless: bool,
    /// Bounds on mean, opacity, shape and SH.
    max_error: Option<(f32, f32, f32, f32)>,
    drop_unseen: bool,
    drop_invalid: bool,
    lod: bool,
    /// What a web page wants.
    web: bool,
    max_sh_degree: u8,
    prune: f64,
    depth: Option<u8>,
    j_low: Option<u8>,
    /// In which row each Gaussian of the input comes back.
    rows: bool,
    /// Estimate how much less the stream shows.
    estimate: bool,
}

impl CompressOptions {
    /// What the stream aims for.
    fn aim(&self) -> Aim {
        let alike =
            |measure, target: Option<f64>| target.map(|target| Aim::Alike { measure, target });
        let psnr = alike(Measure::Psnr, self.target_psnr);
        let alike = psnr.or(alike(Measure::Ssimulacra2, self.target_ssimulacra2));
        let bounds =
            |(mean, opacity, shape, sh)| Aim::MaxError(MaxError { mean, opacity, shape, sh });
        let other = self.max_error.map(bounds).or(self.target_bytes.map(Aim::Bytes)).or(alike);
        match self.lossless {
            true => Aim::Lossless,
            false => other.unwrap_or(Aim::Quality(self.quality.unwrap_or(gsvx::DEFAULT_QUALITY))),
        }
    }

    /// What is kept, and the layout of the stream.
    fn options(&self) -> EncodeOptions {
        let leaves = Leaves::of_depths(self.depth, self.j_low);
        let prepare = PrepareOptions { leaves, prune: self.prune, drop_unseen: self.drop_unseen };
        let code = CodeOptions {
            max_sh_degree: self.max_sh_degree,
            ..Layout::of(self.web, self.lod).code()
        };
        EncodeOptions { prepare, code }
    }
}

/// The stream, and what is to be said of it.
struct CompressResult {
    outcome: EncodeOutcome,
    rows: Option<Vec<i64>>,
    invalid: usize,
    warnings: Vec<String>,
    seconds: f64,
}

/// Encodes splats. Returns the stream and the fields of a report.
#[pyfunction]
pub(crate) fn compress<'py>(
    py: Python<'py>,
    splats: SplatArrays<'py>,
    options: CompressOptions,
    cameras: Option<CameraArrays<'py>>,
    progress: Option<Bound<'py, PyAny>>,
) -> PyResult<(Bound<'py, PyBytes>, Bound<'py, PyDict>)> {
    let (pool, scene) = splats.take()?;
    let mut cameras = cameras.map(|c| c.cameras()).transpose()?;
    if let Some(cameras) = &mut cameras {
        cameras.list = cameras.pinholes()?;
    }
    let input = scene.len();
    let done = run(py, pool, progress.as_ref(), move |line| {
        encode(scene, &options, cameras.as_ref(), line)
    })?;
    let report = report(py, &done, input)?;
    Ok((PyBytes::new(py, &done.outcome.output.encoded.bytes), report))
}

fn encode(
    mut scene: Scene,
    options: &CompressOptions,
    cameras: Option<&Cameras>,
    line: &Line,
) -> Result<CompressResult> {
    let (start, input) = (Instant::now(), scene.len());
    // Coded without loss, infinite opacities stay as they are.
    let exact = options.lossless && !options.drop_invalid;
    let limits = if exact { Limits::default() } else { scene.clamp_limits() };
    let valid = options.drop_invalid.then(|| scene.sound_indices());
    let valid = valid.filter(|valid| valid.len() < input);
    if let Some(valid) = &valid {
        scene = scene.select(valid);
    }
    let invalid = input - scene.len();
    let mut warnings = limits.sentences();
    if !options.lossless {
        scene.validate()?;
        warnings.extend(Doubts::of(&scene).sentences());
    }
    let recipe = EncodeRecipe {
        aim: options.aim(),
        options: options.options(),
        cameras: cameras.map(|c| &c.list[..]),
        photos: &[],
        estimate: options.estimate,
    };
    let name = cameras.map_or("", |c| &c.name);
    let mut encodes = 0;
    let outcome = tune::encode(scene, &recipe, |event| {
        let line = match event {
            EncodeEvent::Visibility(done, all) => line.step("importance", done, all),
            EncodeEvent::References(done, all) => line.step("renders of the input", done, all),
            EncodeEvent::Encoder(EncodeProgress::Begins(_)) => line.check(),
            EncodeEvent::Encoder(EncodeProgress::Made(quality, encoded)) => {
                encodes += 1;
                line.tell(made(encodes, quality, encoded));
                line.check()
            }
        };
        if line.is_ok() { ControlFlow::Continue(()) } else { ControlFlow::Break(()) }
    });
    let mut outcome = outcome.map_err(|error| match error {
        tune::Error::NothingSeen => Fault::from(error).named(name),
        other => other.into(),
    })?;
    warnings.extend(outcome.doubts.iter().map(|doubt| match doubt.is_decisive() {
        true => format!(
            "{name}: {doubt}; their importances are not used, but with drop_unseen they are"
        ),
        false => format!("{name}: {doubt}"),
    }));
    warnings.extend(outcome.output.warnings.iter().map(ToString::to_string));
    let rows = std::mem::take(&mut outcome.output.encoded.rows);
    let rows = options.rows.then(|| rows_of_input(&rows, valid.as_deref(), input));
    Ok(CompressResult { outcome, rows, invalid, warnings, seconds: start.elapsed().as_secs_f64() })
}

fn made(encodes: u64, quality: f32, encoded: &EncodedStream) -> Event {
    let values = vec![
        ("quality", quality.into()),
        ("bytes", encoded.bytes.len() as f64),
        ("gaussians", encoded.index.header.count as f64),
    ];
    Event { stage: "encode".into(), done: encodes, total: 0, values }
}

/// The rows of all Gaussians of the input, from those of the valid ones; -1 for what is left out.
fn rows_of_input(rows: &[u32], valid: Option<&[usize]>, input: usize) -> Vec<i64> {
    let number = |&row: &u32| if row == LEFT_OUT { -1 } else { i64::from(row) };
    let Some(valid) = valid else { return rows.iter().map(number).collect() };
    let mut all = vec![-1; input];
    valid.iter().zip(rows).for_each(|(&i, row)| all[i] = number(row));
    all
}

fn report<'py>(
    py: Python<'py>,
    done: &CompressResult,
    input: usize,
) -> PyResult<Bound<'py, PyDict>> {
    let out = PyDict::new(py);
    let EncodeOutcome { output, seen, loss, .. } = &done.outcome;
    let encoded = &output.encoded;
    out.set_item("bytes", encoded.bytes.len())?;
    out.set_item("gaussians", encoded.index.header.count)?;
    out.set_item("input_gaussians", input)?;
    out.set_item("sh_degree", encoded.index.header.sh_degree)?;
    out.set_item("quality", output.quality)?;
    for measure in [Measure::Psnr, Measure::Ssimulacra2] {
        let value = output.measured.filter(|m| m.0 == measure).map(|m| m.1);
        out.set_item(measure.key(), value)?;
    }
    let estimate = loss.and_then(|loss| {
        let psnr = |l: Option<finetune::Likeness>| l.map(|l| l.psnr);
        let [at_cameras, around] = [loss.at_cameras, loss.around].map(psnr);
        loss.worse()
            .map(|l| (l.psnr, l.ssim, l.ssimulacra2, l.views, l.meaning(), at_cameras, around))
    });
    out.set_item("estimate", estimate)?;
    out.set_item("encodes", output.encodes)?;
    out.set_item("invalid", done.invalid)?;
    out.set_item("transparent", encoded.transparent)?;
    out.set_item("pruned", encoded.pruned)?;
    out.set_item("outliers", encoded.outliers())?;
    out.set_item("left_out", encoded.left_out)?;
    out.set_item("seen_opacity_share", seen.map(|s| s.share))?;
    out.set_item("unseen", seen.map(|s| s.unseen))?;
    out.set_item("missed", output.missed.map(|missed| missed.to_string()))?;
    out.set_item("warnings", &done.warnings)?;
    out.set_item("seconds", done.seconds)?;
    out.set_item("parts", encoded.parts().into_py_dict(py)?)?;
    let rows = done.rows.as_ref().map(|rows| PyArray1::from_slice(py, rows));
    out.set_item("rows", rows)?;
    let errors = encoded
        .max_error
        .map(|e| [("mean", e.mean), ("opacity", e.opacity), ("shape", e.shape), ("sh", e.sh)]);
    out.set_item("max_error", errors.map(|e| e.into_py_dict(py)).transpose()?)?;
    Ok(out)
}

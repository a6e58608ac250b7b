//! Arrays to streams: the choices of `gsvx encode`, in its order, so that the bytes are the same.

use crate::arrays::SplatArrays;
use crate::background::{Event, Line, run};
use crate::cameras::{CameraArrays, Cameras};
use crate::error::{Fault, Result};
use finetune::{LossEstimate, References, Visibility};
use gs_model::{Doubts, Limits, Scene};
use gsvx::{Aim, EncodeProgress, Encoder, LEFT_OUT, Leaves, Made, MaxError, Measure};
use numpy::PyArray1;
use pyo3::prelude::*;
use pyo3::types::{IntoPyDict, PyBytes, PyDict};
use std::ops::ControlFlow;
use std::time::Instant;

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
    /// What renders are measured by, and the value that they shall reach.
    fn likeness(&self) -> Option<(Measure, f64)> {
        let psnr = self.target_psnr.map(|target| (Measure::Psnr, target));
        psnr.or(self.target_ssimulacra2.map(|target| (Measure::Ssimulacra2, target)))
    }

    /// An encoder that does what the options ask for; `alike` is [`Self::likeness`] as an aim.
    fn encoder<'a>(&self, alike: Option<Aim<'a>>) -> Encoder<'a> {
        let aim = match (self.max_error, self.target_bytes, alike) {
            _ if self.lossless => Aim::Lossless,
            (Some((mean, opacity, shape, sh)), ..) => {
                Aim::MaxError(MaxError { mean, opacity, shape, sh })
            }
            (_, Some(bytes), _) => Aim::Bytes(bytes),
            (.., Some(alike)) => alike,
            _ => Aim::Quality(self.quality.unwrap_or(gsvx::DEFAULT_QUALITY)),
        };
        let mut encoder = Encoder::new(aim);
        if self.web {
            encoder.options.for_web();
        }
        let options = &mut encoder.options;
        options.leaves = match (self.depth, self.j_low) {
            (Some(depth), Some(j_low)) => Leaves::Paper { j_low: j_low.min(depth), j_high: depth },
            (Some(depth), None) => Leaves::Uniform { depth },
            _ => Leaves::RateDistortion,
        };
        options.max_sh_degree = self.max_sh_degree;
        options.prune = self.prune;
        options.drop_unseen = self.drop_unseen;
        options.lod |= self.lod;
        options.rows = self.rows;
        encoder
    }
}

/// The stream, and what is to be said of it.
#[derive(Default)]
struct Done {
    made: Made,
    rows: Option<Vec<i64>>,
    loss: Option<LossEstimate>,
    invalid: usize,
    share_and_unseen: Option<(f64, usize)>,
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
    Ok((PyBytes::new(py, &done.made.encoded.bytes), report))
}

fn encode(
    mut scene: Scene,
    options: &CompressOptions,
    cameras: Option<&Cameras>,
    line: &Line,
) -> Result<Done> {
    let (start, input) = (Instant::now(), scene.len());
    // Coded without loss, infinite opacities stay as they are.
    let exact = options.lossless && !options.drop_invalid;
    let limits = if exact { Limits::default() } else { scene.clamp_limits() };
    let valid = options.drop_invalid.then(|| scene.sound_indices());
    let valid = valid.filter(|valid| valid.len() < input);
    if let Some(valid) = &valid {
        scene = scene.select(valid);
    }
    let mut done = Done { invalid: input - scene.len(), ..Done::default() };
    let estimated = options.estimate && !options.lossless;
    done.warnings.extend(limits.sentences());
    if !options.lossless {
        scene.validate()?;
        done.warnings.extend(Doubts::of(&scene).sentences());
    }
    let seen = cameras.map(|cameras| seen(&scene, cameras, &mut done, line)).transpose()?;
    // The likeness is to the input before pruning.
    let references = options.likeness().zip(cameras).map(|(wanted, cameras)| {
        let step = |done, all| line.step("renders of the input", done, all);
        References::new(&scene, &cameras.list, step).map(|references| (references, wanted))
    });
    let references = references.transpose()?;
    let alike = references.as_ref().map(|(r, (measure, target))| tune::alike(r, *measure, *target));
    let mut encoder = options.encoder(alike);
    encoder.options.importance = seen;
    let mut encodes = 0;
    encoder.on_progress(move |event| {
        if line.check().is_err() {
            return ControlFlow::Break(());
        }
        if let EncodeProgress::Made(quality, encoded) = event {
            encodes += 1;
            let values = vec![
                ("quality", quality.into()),
                ("bytes", encoded.bytes.len() as f64),
                ("gaussians", encoded.index.header.count as f64),
            ];
            line.tell(Event { stage: "encode".into(), done: encodes, total: 0, values });
        }
        ControlFlow::Continue(())
    });
    let judged =
        tune::encode_judged(&mut encoder, &scene, cameras.map(|c| &c.list[..]), estimated)?;
    if let (Some(doubt), Some(Cameras { name, .. })) = (judged.doubt(), cameras) {
        done.warnings.push(format!(
            "{name}: {doubt}; their importances are not used, but with drop_unseen they are"
        ));
    }
    (done.made, done.loss) = (judged.made, judged.loss);
    done.warnings.extend(done.made.warnings.iter().map(ToString::to_string));
    let rows = done.made.encoded.rows.take().filter(|_| options.rows);
    done.rows = rows.map(|rows| rows_of_input(&rows, valid.as_deref(), input));
    done.seconds = start.elapsed().as_secs_f64();
    Ok(done)
}

/// What cameras see of each Gaussian.
fn seen(scene: &Scene, cameras: &Cameras, done: &mut Done, line: &Line) -> Result<Vec<f32>> {
    let Cameras { name, list, .. } = cameras;
    let seen = Visibility::of(scene, list, |done| line.step("importance", done, list.len()))?;
    match seen.doubt() {
        Some(doubt) if seen.share == 0.0 => {
            return Err(Fault::Failed(format!("{name}: {doubt}")));
        }
        doubt => done.warnings.extend(doubt.map(|doubt| format!("{name}: {doubt}"))),
    }
    done.share_and_unseen = Some((seen.share, seen.unseen()));
    Ok(seen.weights)
}

/// The rows of all Gaussians of the input, from those of the valid ones; -1 for what is left out.
fn rows_of_input(rows: &[u32], valid: Option<&[usize]>, input: usize) -> Vec<i64> {
    let number = |&row: &u32| if row == LEFT_OUT { -1 } else { i64::from(row) };
    let Some(valid) = valid else { return rows.iter().map(number).collect() };
    let mut all = vec![-1; input];
    valid.iter().zip(rows).for_each(|(&i, row)| all[i] = number(row));
    all
}

fn report<'py>(py: Python<'py>, done: &Done, input: usize) -> PyResult<Bound<'py, PyDict>> {
    let out = PyDict::new(py);
    let Done { made, .. } = done;
    let encoded = &made.encoded;
    out.set_item("bytes", encoded.bytes.len())?;
    out.set_item("gaussians", encoded.index.header.count)?;
    out.set_item("input_gaussians", input)?;
    out.set_item("sh_degree", encoded.index.header.sh_degree)?;
    out.set_item("quality", made.quality)?;
    for measure in [Measure::Psnr, Measure::Ssimulacra2] {
        let value = made.measured.filter(|m| m.0 == measure).map(|m| m.1);
        out.set_item(measure.key(), value)?;
    }
    let estimate = done.loss.and_then(|loss| {
        let psnr = |l: Option<finetune::Likeness>| l.map(|l| l.psnr);
        let [at_cameras, around] = [loss.at_cameras, loss.around].map(psnr);
        loss.worse()
            .map(|l| (l.psnr, l.ssim, l.ssimulacra2, l.views, l.meaning(), at_cameras, around))
    });
    out.set_item("estimate", estimate)?;
    out.set_item("encodes", made.encodes)?;
    out.set_item("invalid", done.invalid)?;
    out.set_item("transparent", encoded.transparent)?;
    out.set_item("pruned", encoded.pruned)?;
    out.set_item("outliers", encoded.outliers())?;
    out.set_item("left_out", encoded.left_out)?;
    out.set_item("seen_opacity_share", done.share_and_unseen.map(|s| s.0))?;
    out.set_item("unseen", done.share_and_unseen.map(|s| s.1))?;
    out.set_item("missed", made.missed.map(|missed| missed.to_string()))?;
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

//! Arrays to streams: the choices of `gsvx encode`, in its order, so that the bytes are the same.

use crate::arrays::Splats;
use crate::background::{Event, Line, pool, run};
use crate::cameras::{CameraArrays, Cameras};
use crate::error::{Fault, Result};
use finetune::{Likeness, Pictures, References, Seen};
use gs_model::Scene;
use gsvx::{EncodeOptions, Encoded, LEFT_OUT, Leaves, MaxError, rate};
use numpy::PyArray1;
use pyo3::prelude::*;
use pyo3::types::{IntoPyDict, PyBytes, PyDict};
use std::num::NonZeroUsize;
use std::time::Instant;

/// What the stream aims for.
#[derive(Clone, Copy, Debug)]
enum Aim {
    Lossless,
    Quality,
    Bytes(u64),
    Psnr(f64),
    Within(MaxError),
}

/// Options as Python has them.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct Options {
    quality: Option<f32>,
    target_bytes: Option<u64>,
    target_psnr: Option<f64>,
    lossless: bool,
    /// Bounds on mean, opacity, shape and SH.
    max_error: Option<(f32, f32, f32, f32)>,
    drop_unseen: bool,
    drop_invalid: bool,
    lod: bool,
    chunk_leaves: Option<NonZeroUsize>,
    max_sh_degree: u8,
    prune: f64,
    depth: Option<u8>,
    j_low: Option<u8>,
    /// Name and bits.
    rows: bool,
    /// Estimate how much less the stream shows.
    estimate: bool,
}

impl Options {
    fn aim(&self) -> Aim {
        if let Some((mean, opacity, shape, sh)) = self.max_error {
            return Aim::Within(MaxError { mean, opacity, shape, sh });
        }
        match (self.lossless, self.target_bytes, self.target_psnr) {
            (true, ..) => Aim::Lossless,
            (_, Some(bytes), _) => Aim::Bytes(bytes),
            (_, _, Some(db)) => Aim::Psnr(db),
            _ => Aim::Quality,
        }
    }

    /// The coding choices, without what cameras see.
    fn choices(&self) -> gsvx::Result<EncodeOptions> {
        let quality = self.quality.unwrap_or(gsvx::DEFAULT_QUALITY);
        let mut options = EncodeOptions::from_quality(quality)?;
        if let Aim::Within(bounds) = self.aim() {
            options.max_error = Some(bounds);
        }
        options.leaves = match (self.depth, self.j_low) {
            (Some(depth), Some(j_low)) => Leaves::Paper { j_low: j_low.min(depth), j_high: depth },
            (Some(depth), None) => Leaves::Uniform { depth },
            _ => Leaves::RateDistortion,
        };
        options.max_sh_degree = self.max_sh_degree;
        options.prune = self.prune;
        options.drop_unseen = self.drop_unseen;
        options.lod = self.lod;
        options.chunk_leaves = self.chunk_leaves.unwrap_or(options.chunk_leaves);
        options.rows = self.rows;
        Ok(options)
    }
}

/// The stream, and what is to be said of it.
#[derive(Default)]
struct Made {
    encoded: Encoded,
    rows: Option<Vec<i64>>,
    quality: Option<f32>,
    psnr: Option<f64>,
    likeness: Option<Likeness>,
    encodes: usize,
    invalid: usize,
    share_and_unseen: Option<(f64, usize)>,
    missed: Option<String>,
    warnings: Vec<String>,
    seconds: f64,
}

/// Encodes splats. Returns the stream and the fields of a report.
#[pyfunction]
pub(crate) fn compress<'py>(
    py: Python<'py>,
    splats: Splats<'py>,
    options: Options,
    cameras: Option<CameraArrays<'py>>,
    progress: Option<Bound<'py, PyAny>>,
) -> PyResult<(Bound<'py, PyBytes>, Bound<'py, PyDict>)> {
    let pool = pool()?;
    let scene = splats.scene(&pool)?;
    drop(splats);
    let cameras = cameras.map(|c| c.cameras()).transpose()?;
    let input = scene.len();
    let made = run(py, pool, progress.as_ref(), move |line| {
        let start = Instant::now();
        let made = encode(scene, &options, cameras.as_ref(), line)?;
        Ok(Made { seconds: start.elapsed().as_secs_f64(), ..made })
    })?;
    let report = report(py, &made, input)?;
    Ok((PyBytes::new(py, &made.encoded.bytes), report))
}

fn encode(
    mut scene: Scene,
    options: &Options,
    cameras: Option<&Cameras>,
    line: &Line,
) -> Result<Made> {
    let (input, aim) = (scene.len(), options.aim());
    let valid = options.drop_invalid.then(|| scene.valid_indices());
    let valid = valid.filter(|valid| valid.len() < input);
    if let Some(valid) = &valid {
        scene = scene.select(valid);
    }
    let mut made = match aim {
        Aim::Lossless => {
            let encoded = gsvx::encode_lossless(&scene, false)?;
            Made { encoded, ..Made::default() }
        }
        _ => {
            scene.validate()?;
            let views = cameras.map(|c| &c.list[..]);
            let pictures = options.estimate.then(|| Pictures::of(&scene, views));
            line.check()?;
            let made = lossy(&scene, options, cameras, line)?;
            let likeness = pictures.map(|p| likeness(&p, &made.encoded)).transpose()?.flatten();
            Made { likeness, ..made }
        }
    };
    made.invalid = input - scene.len();
    made.warnings.extend(made.encoded.coarse_cells.map(|coarse| {
        format!(
            "its parts lie so far apart, or differ so much in size, that positions come in steps of {:.1} times \
             the size of its {} Gaussians, which shows at any quality; compress each part apart, or use \
             max_error or lossless",
            coarse.cells,
            coarse.which()
        )
    }));
    let rows = made.encoded.rows.take().filter(|_| options.rows);
    made.rows = rows.map(|rows| rows_of_input(&rows, valid.as_deref(), input));
    Ok(made)
}

/// The rows of all Gaussians of the input, from those of the valid ones; -1 for what is left out.
fn rows_of_input(rows: &[u32], valid: Option<&[usize]>, input: usize) -> Vec<i64> {
    let number = |&row: &u32| if row == LEFT_OUT { -1 } else { i64::from(row) };
    let Some(valid) = valid else { return rows.iter().map(number).collect() };
    let mut all = vec![-1; input];
    valid.iter().zip(rows).for_each(|(&i, row)| all[i] = number(row));
    all
}

/// Any stream but a lossless one.
fn lossy(scene: &Scene, options: &Options, cameras: Option<&Cameras>, line: &Line) -> Result<Made> {
    let mut choices = options.choices()?;
    let mut made = Made::default();
    if let Some(Cameras { name, list }) = cameras {
        let seen = Seen::of(scene, list, |done| line.step("importance", done, list.len()))?;
        match seen.doubt() {
            Some(doubt) if seen.share == 0.0 => {
                return Err(Fault::Failed(format!("{name}: {doubt}")));
            }
            doubt => made.warnings.extend(doubt.map(|doubt| format!("{name}: {doubt}"))),
        }
        made.share_and_unseen = Some((seen.share, seen.unseen()));
        choices.importance = Some(seen.weights);
    }
    let mut encodes = 0;
    let mut at = |quality: f32| {
        if line.check().is_err() {
            // It ends the search. Nobody waits for what it returns.
            return Err(gsvx::Error::Corrupt { what: "interrupted", value: 0 });
        }
        encodes += 1;
        let encoded = gsvx::encode(scene, &choices.at_quality(quality)?)?;
        line.tell(encoded_event(encodes, quality, &encoded));
        Ok(encoded)
    };
    match options.aim() {
        Aim::Bytes(most) => {
            let found = rate::to_bytes(most, at)?;
            let smallest = found.encoded.bytes.len();
            let too_small = format!(
                "the target of {most} bytes is below the smallest stream of this scene, {smallest} bytes; \
                 prune or max_sh_degree=0 makes smaller ones"
            );
            made.missed = (!found.reached).then_some(too_small);
            Ok(made.with(found))
        }
        Aim::Psnr(target) => {
            let Some(cameras) = cameras else {
                return Err(Fault::Usage("target_psnr needs cameras".into()));
            };
            // The PSNR is measured against the input before pruning.
            let step = |done, all| line.step("renders of the input", done, all);
            let references = References::new(scene, &cameras.list, step)?;
            let found = rate::to_measure(target, at, |encoded| psnr(&references, encoded))?;
            let too_low = format!(
                "its renders reach {:.2} dB, not {target:.2}: quality {} is the best there is; \
                 lossless=True keeps every float",
                found.measured.unwrap_or(f64::NAN),
                found.quality
            );
            made.missed = (!found.reached).then_some(too_low);
            Ok(made.with(found))
        }
        Aim::Within(_) => Ok(Made { encoded: at(choices.quality)?, encodes: 1, ..made }),
        _ => {
            let quality = Some(choices.quality);
            Ok(Made { encoded: at(choices.quality)?, quality, encodes: 1, ..made })
        }
    }
}

/// Mean PSNR of a stream's renders, dB.
fn psnr(references: &References, encoded: &Encoded) -> gsvx::Result<f64> {
    Ok(references.psnr(&decoded(encoded)?))
}

fn decoded(encoded: &Encoded) -> gsvx::Result<Scene> {
    let mut options = gsvx::DecodeOptions::default();
    options.max_gaussians = Some(u64::MAX);
    Ok(gsvx::decode_with(&encoded.bytes, &options)?.scene)
}

/// How alike the pictures of the input and those of a stream are.
fn likeness(pictures: &Pictures, encoded: &Encoded) -> Result<Option<Likeness>> {
    Ok(if pictures.is_empty() { None } else { pictures.likeness(&decoded(encoded)?) })
}

fn encoded_event(encodes: u64, quality: f32, encoded: &Encoded) -> Event {
    Event {
        stage: "encode".into(),
        done: encodes,
        total: 0,
        values: vec![
            ("quality", quality.into()),
            ("bytes", encoded.bytes.len() as f64),
            ("gaussians", encoded.index.header.count as f64),
        ],
    }
}

impl Made {
    /// With the result of a search.
    fn with(self, found: rate::Found<Encoded>) -> Self {
        let rate::Found { encoded, quality, encodes, measured, .. } = found;
        Self { encoded, quality: Some(quality), encodes, psnr: measured, ..self }
    }
}

fn report<'py>(py: Python<'py>, made: &Made, input: usize) -> PyResult<Bound<'py, PyDict>> {
    let out = PyDict::new(py);
    let Made { encoded, .. } = made;
    out.set_item("bytes", encoded.bytes.len())?;
    out.set_item("gaussians", encoded.index.header.count)?;
    out.set_item("input_gaussians", input)?;
    out.set_item("sh_degree", encoded.index.header.sh_degree)?;
    out.set_item("quality", made.quality)?;
    out.set_item("psnr", made.psnr)?;
    let estimate = made.likeness.map(|l| (l.psnr, l.ssim, l.views, l.meaning()));
    out.set_item("estimate", estimate)?;
    out.set_item("encodes", made.encodes)?;
    out.set_item("invalid", made.invalid)?;
    out.set_item("pruned", encoded.pruned)?;
    let exact = encoded.exact();
    let outliers = if exact as u64 == encoded.index.header.count { 0 } else { exact };
    out.set_item("outliers", outliers)?;
    out.set_item("left_out", encoded.left_out)?;
    out.set_item("seen_opacity_share", made.share_and_unseen.map(|s| s.0))?;
    out.set_item("unseen", made.share_and_unseen.map(|s| s.1))?;
    out.set_item("missed", &made.missed)?;
    out.set_item("warnings", &made.warnings)?;
    out.set_item("seconds", made.seconds)?;
    out.set_item("parts", parts(py, encoded)?)?;
    let rows = made.rows.as_ref().map(|rows| PyArray1::from_slice(py, rows));
    out.set_item("index_map", rows)?;
    let errors = encoded
        .max_error
        .map(|e| [("mean", e.mean), ("opacity", e.opacity), ("shape", e.shape), ("sh", e.sh)]);
    out.set_item("max_error", errors.map(|e| e.into_py_dict(py)).transpose()?)?;
    Ok(out)
}

/// The bytes of each part of a stream.
pub(crate) fn parts<'py>(py: Python<'py>, encoded: &Encoded) -> PyResult<Bound<'py, PyDict>> {
    let parts = PyDict::new(py);
    for (part, bytes) in encoded.parts() {
        parts.set_item(part, bytes)?;
    }
    Ok(parts)
}

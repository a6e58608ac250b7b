//! `gsvx tune` for arrays.

use crate::arrays::SplatArrays;
use crate::background::{Event, Line, run};
use crate::cameras::{CameraArrays, Cameras};
use crate::error::{Fault, Result};
use ::finetune::metrics::Scores;
use ::finetune::{Photo, TrainView};
use ::tune::{Layout, Photos, Progress, Target, Targets, Tune, TuneEffort, TuneOutcome};
use gs_model::{Camera, Scene, chain};
use numpy::PyReadonlyArray3;
use pyo3::prelude::*;
use pyo3::types::{IntoPyDict, PyBytes, PyDict};
use std::cell::RefCell;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Options as Python has them.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct TuneDict {
    /// Those of all streams, the highest first; none for the default.
    qualities: Vec<f32>,
    target_bytes: Option<u64>,
    target_psnr: Option<f64>,
    effort: String,
    seed: u64,
    checkpoint: Option<PathBuf>,
    distil: bool,
    force_photos: bool,
    drop_unseen: bool,
    lod: bool,
    /// What a web page wants.
    web: bool,
    drop_invalid: bool,
}

impl TuneDict {
    fn target(&self) -> Target {
        match (self.target_bytes, self.target_psnr) {
            (Some(bytes), _) => Target::Bytes(bytes),
            (_, Some(db)) => Target::Psnr(db),
            _ => Target::Quality(*self.qualities.first().unwrap_or(&::tune::DEFAULT_QUALITY)),
        }
    }

    fn layout(&self) -> Layout {
        Layout::of(self.web, self.lod)
    }
}

/// A photo: an array (height, width, 3) or a file.
#[derive(FromPyObject)]
pub(crate) enum PhotoArg<'py> {
    Bytes(PyReadonlyArray3<'py, u8>),
    Floats(PyReadonlyArray3<'py, f32>),
    File(PathBuf),
}

/// A photo that is no Python object.
enum PhotoSource {
    Pixels(Photo),
    File(PathBuf),
}

/// Tunes splats to photos, or to renders of themselves if there are none. `made` gets each stream, and the fields of
/// a report, on the thread that works.
#[pyfunction]
pub(crate) fn tune<'py>(
    py: Python<'py>,
    splats: SplatArrays<'py>,
    cameras: CameraArrays<'py>,
    photos: Option<Vec<PhotoArg<'py>>>,
    options: TuneDict,
    made: Py<PyAny>,
    progress: Option<Bound<'py, PyAny>>,
) -> PyResult<()> {
    let (pool, scene) = splats.take()?;
    let cameras = cameras.cameras()?;
    let photo =
        |photos: Vec<_>| photos.into_iter().map(PhotoSource::of).collect::<Result<Vec<_>>>();
    let photos = photos.map(photo).transpose()?;
    run(py, pool, progress.as_ref(), move |line| {
        tune_scene(scene, cameras, photos, &options, &made, line)
    })
}

/// The fields of a report.
fn report<'py>(
    py: Python<'py>,
    outcome: &TuneOutcome,
    target: Target,
    distilled: bool,
    warnings: Vec<String>,
) -> PyResult<Bound<'py, PyDict>> {
    let TuneOutcome { encoded, outliers, scores, input_scores, quality, steps, seconds, .. } =
        outcome;
    let bytes = encoded.bytes.len();
    let missed = match target {
        _ if outcome.reached => None,
        Target::Psnr(db) => Some(format!("{:.2} dB are below the target of {db} dB", scores.psnr)),
        Target::Bytes(most) => Some(format!("{bytes} bytes are above the target of {most}")),
        Target::Quality(_) => None,
    };
    let out = PyDict::new(py);
    out.set_item("bytes", bytes)?;
    out.set_item("gaussians", encoded.index.header.count)?;
    out.set_item("sh_degree", encoded.index.header.sh_degree)?;
    out.set_item("outliers", outliers)?;
    for (of, Scores { psnr, ssim, ssimulacra2 }) in [("", scores), ("input_", input_scores)] {
        out.set_item(format!("{of}psnr"), psnr)?;
        out.set_item(format!("{of}ssim"), ssim)?;
        out.set_item(format!("{of}ssimulacra2"), ssimulacra2)?;
    }
    out.set_item("elsewhere_psnr", outcome.against_input.map(|shown| shown.elsewhere()))?;
    out.set_item("quality", quality)?;
    out.set_item("steps", steps)?;
    out.set_item("seconds", seconds)?;
    out.set_item("distilled", distilled)?;
    out.set_item("missed", missed)?;
    out.set_item("warnings", warnings)?;
    out.set_item("parts", encoded.parts().into_py_dict(py)?)?;
    Ok(out)
}

impl PhotoSource {
    fn of(photo: PhotoArg<'_>) -> Result<Self> {
        let (shape, rgb) = match photo {
            PhotoArg::File(path) => return Ok(Self::File(path)),
            PhotoArg::Bytes(array) => {
                let array = array.as_array();
                (array.raw_dim(), array.iter().copied().collect())
            }
            PhotoArg::Floats(array) => {
                let array = array.as_array();
                if array.iter().any(|v| !v.is_finite()) {
                    return Err(Fault::Usage("photos: a value is not finite".into()));
                }
                let eight = |v: &f32| (v.clamp(0.0, 1.0) * 255.0 + 0.5) as u8;
                (array.raw_dim(), array.iter().map(eight).collect())
            }
        };
        let size = [shape[1], shape[0]].map(|v| u32::try_from(v).unwrap_or(0));
        if shape[2] != 3 || size.contains(&0) {
            let (h, w, c) = (shape[0], shape[1], shape[2]);
            return Err(Fault::Usage(format!(
                "photos: arrays (height, width, 3) expected, not ({h}, {w}, {c})"
            )));
        }
        Ok(Self::Pixels(Photo { width: size[0], height: size[1], rgb }))
    }

    /// The photo at its camera.
    fn at(self, camera: &Camera) -> Result<TrainView> {
        let photo = match self {
            Self::Pixels(photo) => photo,
            Self::File(path) => return Ok(::tune::photo(camera, &path)?),
        };
        let named = |reason: String| Fault::Failed(format!("photo of {}: {reason}", camera.name));
        ::tune::at_camera(camera, photo).map_err(named)
    }
}

fn tune_scene(
    mut scene: Scene,
    cameras: Cameras,
    photos: Option<Vec<PhotoSource>>,
    options: &TuneDict,
    made: &Py<PyAny>,
    line: &Line,
) -> Result<()> {
    let limits = scene.clamp_limits();
    if options.drop_invalid {
        scene.drop_invalid();
    }
    let mut found = match photos {
        Some(photos) => Photos { views: given(&cameras.list, photos)?, warnings: Vec::new() },
        None if options.distil || cameras.photos.is_empty() => Photos::default(),
        None => ::tune::photos(Path::new(&cameras.name), &cameras.views())?,
    };
    found.check(&scene, options.force_photos)?;
    let Photos { views: training, mut warnings } = found;
    warnings.extend(limits.sentences());
    let distilled = training.is_empty();
    let targets =
        if distilled { Targets::Renders(cameras.pinholes()?) } else { Targets::Photos(training) };
    let target = options.target();
    let mut choices = ::tune::TuneOptions::new(target);
    choices.further = options.qualities.iter().skip(1).copied().collect();
    choices.layout = options.layout();
    choices.effort = TuneEffort::named(&options.effort).unwrap_or_default();
    choices.seed = options.seed;
    choices.drop_unseen = options.drop_unseen;
    choices.checkpoint.clone_from(&options.checkpoint);
    choices.cancel = Some(Arc::clone(&line.cancel));
    let run = Tune::with_progress(scene, targets, choices, |done, all| {
        let _ = line.step("input model", done, all);
    })?;
    let warnings = RefCell::new(warnings);
    let follow = |p: &Progress<'_>| {
        if let Some(error) = p.checkpoint_failed {
            let text = format!("{}; the run goes on without checkpoints", chain(error));
            warnings.borrow_mut().push(text);
        }
        line.tell(event(p));
    };
    let mut end = Ok(());
    run.run_all(follow, |outcome| {
        let hand_over = |py: Python<'_>| {
            let report = report(py, &outcome, target, distilled, warnings.take())?;
            made.call1(py, (PyBytes::new(py, &outcome.encoded.bytes), report))
        };
        // Nothing is written after an interruption.
        end = line.check().and_then(|()| match Python::attach(hand_over) {
            Ok(_) => Ok(()),
            Err(error) => Err(Fault::Raised(error)),
        });
        if end.is_ok() { ControlFlow::Continue(()) } else { ControlFlow::Break(()) }
    })?;
    end.and_then(|()| line.check())
}

/// Photos that Python gives, at their cameras.
fn given(cameras: &[Camera], photos: Vec<PhotoSource>) -> Result<Vec<TrainView>> {
    let (p, c) = (photos.len(), cameras.len());
    if p != c {
        return Err(Fault::Usage(format!("photos: {p} of them for {c} cameras")));
    }
    cameras.iter().zip(photos).map(|(camera, photo)| photo.at(camera)).collect()
}

fn event(p: &Progress<'_>) -> Event {
    let mut values = vec![
        ("gaussians", p.gaussians as f64),
        ("psnr", p.psnr),
        ("seconds", p.seconds),
        ("eta_seconds", p.eta_seconds),
    ];
    values.extend(p.aside_psnr.map(|db| ("aside_psnr", db)));
    values.extend(p.bytes.map(|bytes| ("bytes", bytes as f64)));
    Event { stage: p.stage.to_string(), done: p.step, total: p.steps, values }
}

//! `gsvx tune` for arrays.

use crate::arrays::Splats;
use crate::background::{Event, Line, pool, run};
use crate::cameras::{CameraArrays, Cameras};
use crate::encode::parts;
use crate::error::{Fault, Result};
use ::finetune::{Image, RenderOptions, TrainView, render};
use ::tune::{Progress, Target, Tune, TuneEffort, TuneOutcome};
use gs_model::{Camera, Scene};
use numpy::PyReadonlyArray3;
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict};
use std::path::PathBuf;
use std::sync::Arc;

/// Options as Python has them.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct Options {
    quality: Option<f32>,
    target_bytes: Option<u64>,
    target_psnr: Option<f64>,
    effort: String,
    seed: u64,
    checkpoint: Option<PathBuf>,
    drop_invalid: bool,
}

/// A photo: an array (height, width, 3) or a file.
#[derive(FromPyObject)]
pub(crate) enum PhotoArg<'py> {
    Bytes(PyReadonlyArray3<'py, u8>),
    Floats(PyReadonlyArray3<'py, f32>),
    File(PathBuf),
}

/// A photo that is no Python object.
enum Photo {
    Image(Image),
    File(PathBuf),
}

/// What a tune returns.
struct Tuned {
    outcome: TuneOutcome,
    missed: Option<String>,
    warnings: Vec<String>,
}

/// Tunes splats to photos, or to renders of themselves if there are none. Returns the stream and the fields of
/// a report.
#[pyfunction]
pub(crate) fn tune<'py>(
    py: Python<'py>,
    splats: Splats<'py>,
    cameras: CameraArrays<'py>,
    photos: Option<Vec<PhotoArg<'py>>>,
    options: Options,
    progress: Option<Bound<'py, PyAny>>,
) -> PyResult<(Bound<'py, PyBytes>, Bound<'py, PyDict>)> {
    let pool = pool()?;
    let scene = splats.scene(&pool)?;
    drop(splats);
    let cameras = cameras.cameras()?;
    let photos = photos.map(|photos| photos.into_iter().map(Photo::of).collect::<Result<Vec<_>>>());
    let photos = photos.transpose()?;
    let tuned = run(py, pool, progress.as_ref(), move |line| {
        tune_scene(scene, cameras, photos, &options, line)
    })?;
    let out = PyDict::new(py);
    let TuneOutcome { encoded, outliers, psnr, input_psnr, quality, steps, seconds, .. } =
        &tuned.outcome;
    out.set_item("bytes", encoded.bytes.len())?;
    out.set_item("gaussians", encoded.index.header.count)?;
    out.set_item("sh_degree", encoded.index.header.sh_degree)?;
    out.set_item("outliers", outliers)?;
    out.set_item("psnr", psnr)?;
    out.set_item("input_psnr", input_psnr)?;
    out.set_item("quality", quality)?;
    out.set_item("steps", steps)?;
    out.set_item("seconds", seconds)?;
    out.set_item("missed", &tuned.missed)?;
    out.set_item("warnings", &tuned.warnings)?;
    out.set_item("parts", parts(py, encoded)?)?;
    Ok((PyBytes::new(py, &encoded.bytes), out))
}

impl Photo {
    fn of(photo: PhotoArg<'_>) -> Result<Self> {
        let (shape, rgb) = match photo {
            PhotoArg::File(path) => return Ok(Self::File(path)),
            PhotoArg::Bytes(array) => {
                let array = array.as_array();
                let values = array.iter().map(|&v| f32::from(v) / 255.0).collect();
                (array.raw_dim(), values)
            }
            PhotoArg::Floats(array) => {
                let array = array.as_array();
                (array.raw_dim(), array.iter().copied().collect())
            }
        };
        let size = [shape[1], shape[0]].map(|v| u32::try_from(v).unwrap_or(0));
        if shape[2] != 3 || size.contains(&0) {
            let (h, w, c) = (shape[0], shape[1], shape[2]);
            return Err(Fault::Usage(format!(
                "photos: arrays (height, width, 3) expected, not ({h}, {w}, {c})"
            )));
        }
        Ok(Self::Image(Image { width: size[0], height: size[1], rgb }))
    }

    fn read(self) -> Result<(String, Image)> {
        let path = match self {
            Self::Image(image) => return Ok(("photo".into(), image)),
            Self::File(path) => path,
        };
        let name = format!("photo {}", path.display());
        let photo = image::ImageReader::open(&path)
            .and_then(image::ImageReader::with_guessed_format)
            .map_err(|e| Fault::Io(std::io::Error::new(e.kind(), format!("{name}: {e}"))))?
            .decode()
            .map_err(|e| Fault::Failed(format!("{name}: PNG or JPEG expected: {e}")))?
            .to_rgb8();
        let (width, height) = photo.dimensions();
        let empty = || Fault::Failed(format!("{name} is empty"));
        Ok((name.clone(), Image::from_rgb8(width, height, photo.as_raw()).ok_or_else(empty)?))
    }
}

/// A photo at its camera.
fn view(camera: &Camera, photo: Photo) -> Result<TrainView> {
    let (name, photo) = photo.read()?;
    let Some(camera) = camera.scaled_to(photo.width, photo.height) else {
        let (width, height) = (photo.width, photo.height);
        return Err(Fault::Failed(format!(
            "{name} is {width}x{height}, which is not its camera's aspect ratio"
        )));
    };
    Ok(TrainView { camera, photo })
}

/// Renders of the model at the cameras.
fn renders(scene: &Scene, cameras: Vec<Camera>, line: &Line) -> Result<Vec<TrainView>> {
    let n = cameras.len();
    let one = |(i, mut camera): (usize, Camera)| {
        // A render has no lens.
        camera.ignored_distortion = None;
        let mut photo = render(scene, &camera, &RenderOptions::default());
        // What a screen shows is clamped; differences beyond it do not count.
        photo.rgb.iter_mut().for_each(|v| *v = v.clamp(0.0, 1.0));
        line.step("renders", i + 1, n)?;
        Ok(TrainView { camera, photo })
    };
    cameras.into_iter().enumerate().map(one).collect()
}

fn tune_scene(
    mut scene: Scene,
    cameras: Cameras,
    photos: Option<Vec<Photo>>,
    options: &Options,
    line: &Line,
) -> Result<Tuned> {
    if options.drop_invalid {
        scene.drop_invalid();
    }
    let list = cameras.list;
    let training = match photos {
        Some(photos) if photos.len() == list.len() => list
            .iter()
            .zip(photos)
            .map(|(camera, photo)| view(camera, photo))
            .collect::<Result<_>>()?,
        Some(photos) => {
            let (p, c) = (photos.len(), list.len());
            return Err(Fault::Usage(format!("photos: {p} of them for {c} cameras")));
        }
        None => renders(&scene, list, line)?,
    };
    run_tune(scene, training, options, line)
}

fn run_tune(
    scene: Scene,
    training: Vec<TrainView>,
    options: &Options,
    line: &Line,
) -> Result<Tuned> {
    let target = match (options.target_bytes, options.target_psnr) {
        (Some(bytes), _) => Target::Bytes(bytes),
        (_, Some(db)) => Target::Psnr(db),
        _ => Target::Quality(options.quality.unwrap_or(::tune::DEFAULT_QUALITY)),
    };
    let mut choices = ::tune::TuneOptions::new(target);
    choices.effort = match &options.effort[..] {
        "quick" => TuneEffort::Quick,
        "long" => TuneEffort::Long,
        _ => TuneEffort::Normal,
    };
    choices.seed = options.seed;
    choices.checkpoint.clone_from(&options.checkpoint);
    choices.cancel = Some(Arc::clone(&line.cancel));
    let mut warnings = Vec::new();
    let outcome = Tune::new(scene, training, choices)?.run(|p| {
        if let Some(error) = p.checkpoint_failed {
            let text = gs_model::chain(error);
            warnings.push(format!("{text}; the run goes on without checkpoints"));
        }
        line.tell(event(p));
    })?;
    line.check()?;
    let bytes = outcome.encoded.bytes.len();
    let missed = match target {
        _ if outcome.reached => None,
        Target::Psnr(db) => Some(format!("{:.2} dB are below the target of {db} dB", outcome.psnr)),
        Target::Bytes(most) => Some(format!("{bytes} bytes are above the target of {most}")),
        Target::Quality(_) => None,
    };
    Ok(Tuned { outcome, missed, warnings })
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

//! Arrays to streams: the choices of `gsvx encode`, in its order, so that the bytes are the same.

use crate::arrays::Splats;
use crate::background::{Event, Line, pool, run};
use crate::cameras::{CameraArrays, Cameras};
use crate::error::{Fault, Result};
use crate::views::{Reference, Seen};
use gs_model::{Camera, Scene};
use gsvx::{CovarianceMode, EncodeOptions, Encoded, LEFT_OUT, MaxError, Prepared, rate};
use numpy::PyArray1;
use pyo3::prelude::*;
use pyo3::types::{IntoPyDict, PyBytes, PyDict};
use std::num::NonZeroUsize;
use std::time::Instant;
use voxel::{Strategy, Trimmed};

/// What the stream aims for.
#[derive(Clone, Copy, Debug)]
enum Aim {
    Lossless,
    Quality(f32),
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
    trim: bool,
    depth: Option<u8>,
    j_low: Option<u8>,
    /// Name and bits.
    covariance: (String, u8),
    rows: bool,
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
            _ => Aim::Quality(self.quality.unwrap_or(gsvx::DEFAULT_QUALITY)),
        }
    }

    /// The coding choices at a quality.
    fn at(&self, quality: f32) -> gsvx::Result<EncodeOptions> {
        let mut options = EncodeOptions::from_quality(quality)?;
        options.covariance = match (&self.covariance.0[..], self.covariance.1) {
            ("vq", bits) => CovarianceMode::Vq { bits },
            ("lossless", bits) => CovarianceMode::Lossless { bits },
            _ => CovarianceMode::Transform,
        };
        options.max_sh_degree = self.max_sh_degree;
        options.lod = self.lod;
        options.chunk_leaves = self.chunk_leaves.unwrap_or(options.chunk_leaves);
        options.rows = self.rows;
        Ok(options)
    }

    fn strategy(&self, q: f32, importance: &[f32], seen: gsvx::Seen) -> gsvx::Result<Strategy> {
        match (self.depth, self.j_low) {
            (Some(depth), Some(j_low)) => Ok(Strategy::paper(j_low.min(depth), depth)),
            (Some(depth), None) => Ok(Strategy::Uniform { depth }),
            (None, _) if self.drop_unseen => {
                gsvx::default_strategy(q, importance, gsvx::Seen::ByCamerasOnly)
            }
            (None, _) => gsvx::default_strategy(q, importance, seen),
        }
    }
}

/// A model about to be encoded.
struct Job {
    options: Options,
    /// Without outliers.
    scene: Scene,
    outliers: Option<Scene>,
    trimmed: Option<Trimmed>,
    cameras: Option<Cameras>,
    /// Importances, one per Gaussian of `scene`.
    importance: Option<Vec<f32>>,
    /// Gaussians of the input, and which of them are left, before outliers are split off; None for all.
    input: usize,
    kept: Option<Vec<usize>>,
    made: Made,
}

/// The stream, and what is to be said of it.
#[derive(Default)]
struct Made {
    encoded: Encoded,
    rows: Option<Vec<i64>>,
    quality: Option<f32>,
    psnr: Option<f64>,
    encodes: usize,
    invalid: usize,
    pruned: usize,
    outliers: usize,
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
        let (trimmed, made) = (None, Made::default());
        let (outliers, importance, kept) = (None, None, None);
        let job = Job { options, scene, outliers, trimmed, cameras, importance, input, kept, made };
        let made = job.run(line)?;
        Ok(Made { seconds: start.elapsed().as_secs_f64(), ..made })
    })?;
    let report = report(py, &made, input)?;
    Ok((PyBytes::new(py, &made.encoded.bytes), report))
}

impl Job {
    fn run(mut self, line: &Line) -> Result<Made> {
        let aim = self.options.aim();
        if let Aim::Lossless = aim {
            self.drop_invalid(false)?;
            self.made.encoded = gsvx::encode_lossless(&self.scene, false)?;
            return Ok(self.finish());
        }
        self.drop_invalid(true)?;
        self.look(line)?;
        // Quality is measured against what came in, not against what pruning left.
        let reference = match (aim, &self.cameras) {
            (Aim::Psnr(_), Some(cameras)) => {
                Some(Reference::new(&self.scene, &cameras.list, line)?)
            }
            _ => None,
        };
        self.prune()?;
        if let Aim::Within(bounds) = aim {
            let mut options = self.options.at(gsvx::DEFAULT_QUALITY)?;
            options.max_error = Some(bounds);
            self.made.encoded = gsvx::encode(&self.scene, &options)?;
            self.made.encodes = 1;
            return Ok(self.finish());
        }
        self.trim()?;
        match (aim, reference) {
            (Aim::Bytes(most), _) => self.largest_below(most, line)?,
            (Aim::Psnr(target), Some(reference)) => {
                self.smallest_above(target, &reference, line)?;
            }
            (Aim::Quality(quality), _) => {
                self.made.encoded = self.encode_at(quality, line)?;
                self.made.quality = Some(quality);
            }
            _ => return Err(Fault::Usage("target_psnr needs cameras".into())),
        }
        Ok(self.finish())
    }

    /// Leaves invalid Gaussians out if that is wanted. A lossless stream keeps them unless they are to be
    /// left out; a lossy one cannot (`refuse`).
    fn drop_invalid(&mut self, refuse: bool) -> Result<()> {
        if !self.options.drop_invalid {
            if refuse {
                self.scene.validate()?;
            }
            return Ok(());
        }
        let valid = self.scene.valid_indices();
        self.made.invalid = self.scene.len() - valid.len();
        if self.made.invalid > 0 {
            self.scene = self.scene.select(&valid);
            self.kept = Some(valid);
        }
        Ok(())
    }

    /// Finds what the cameras see.
    fn look(&mut self, line: &Line) -> Result<()> {
        let Some(cameras) = &self.cameras else { return Ok(()) };
        let seen = Seen::of(&self.scene, cameras, line)?;
        self.made.share_and_unseen = Some((seen.share, seen.unseen()));
        self.made.warnings.extend(seen.warning);
        self.importance = Some(match self.options.drop_unseen {
            true => seen.weights,
            false => gsvx::importance::with_unseen(&self.scene, &seen.weights),
        });
        Ok(())
    }

    /// Leaves out the least important Gaussians.
    fn prune(&mut self) -> Result<()> {
        if self.options.prune == 0.0 {
            return Ok(());
        }
        let kept = match &self.importance {
            Some(seen) => gsvx::prune(seen, self.options.prune)?,
            None => {
                gsvx::prune(&gsvx::importance::without_cameras(&self.scene), self.options.prune)?
            }
        };
        self.made.pruned = self.scene.len() - kept.len();
        if let Some(seen) = &mut self.importance {
            *seen = kept.iter().map(|&i| seen[i]).collect();
        }
        self.scene = self.scene.select(&kept);
        self.kept = Some(match self.kept.take() {
            Some(before) => kept.iter().map(|&i| before[i]).collect(),
            None => kept,
        });
        Ok(())
    }

    /// Splits outliers off.
    fn trim(&mut self) -> Result<()> {
        if !self.options.trim {
            return Ok(());
        }
        let Some(split) = gsvx::split_outliers(&self.scene)? else { return Ok(()) };
        if let Some(seen) = &mut self.importance {
            *seen = split.inside.iter().map(|&i| seen[i]).collect();
        }
        self.outliers = Some(self.scene.select(&split.outliers));
        self.scene = self.scene.select(&split.inside);
        self.made.outliers = split.outliers.len();
        self.trimmed = Some(split);
        Ok(())
    }

    /// Voxelizes and encodes at a quality.
    fn encode_at(&mut self, quality: f32, line: &Line) -> gsvx::Result<Encoded> {
        self.made.encodes += 1;
        let Self { options, scene, importance, .. } = &*self;
        let strategy = |found: &[f32], seen| options.strategy(quality, found, seen);
        let (seen, outliers) = (importance.as_deref(), self.outliers.as_ref());
        let mut choices = options.at(quality)?;
        let encoded = match (choices.covariance, &self.cameras) {
            (CovarianceMode::Vq { .. }, Some(cameras)) => {
                encode_with_sensitivity(scene, strategy, (seen, outliers), choices, &cameras.list)?
            }
            _ => {
                choices.importance = seen.map(<[f32]>::to_vec);
                gsvx::encode_with(scene, strategy, outliers, &choices)?
            }
        };
        line.tell(Event {
            stage: "encode".into(),
            done: self.made.encodes as u64,
            total: 0,
            values: vec![
                ("quality", quality.into()),
                ("bytes", encoded.bytes.len() as f64),
                ("gaussians", encoded.index.header.count as f64),
            ],
        });
        Ok(encoded)
    }

    /// One encode of a search.
    fn attempt(&mut self, quality: f32, line: &Line) -> gsvx::Result<Encoded> {
        if line.check().is_err() {
            // It ends the search. Nobody waits for what it returns.
            return Err(gsvx::Error::Corrupt { what: "interrupted", value: 0 });
        }
        self.encode_at(quality, line)
    }

    /// The best stream of at most `most` bytes, or the smallest if there is none.
    fn largest_below(&mut self, most: u64, line: &Line) -> Result<()> {
        let found = rate::to_bytes(most, |quality| self.attempt(quality, line));
        let (encoded, quality) = match found {
            Err(gsvx::Error::TargetTooSmall { smallest, .. }) => {
                self.made.missed = Some(format!(
                    "the target of {most} bytes is below the smallest stream of this scene, {smallest} \
                     bytes; prune or max_sh_degree=0 makes smaller ones"
                ));
                (self.encode_at(0.0, line)?, 0.0)
            }
            found => found.map(|found| (found.encoded, found.quality))?,
        };
        (self.made.encoded, self.made.quality) = (encoded, Some(quality));
        Ok(())
    }

    /// The smallest stream of at least `target` dB, or the best if there is none.
    fn smallest_above(&mut self, target: f64, reference: &Reference, line: &Line) -> Result<()> {
        let measure = |encoded: &Encoded| {
            let mut options = gsvx::DecodeOptions::default();
            options.max_gaussians = Some(u64::MAX);
            Ok(reference.psnr(&gsvx::decode_with(&encoded.bytes, &options)?.scene))
        };
        let found = rate::to_measure(target, |quality| self.attempt(quality, line), measure)?;
        let got = found.measured.unwrap_or(f64::NAN);
        if got < target {
            self.made.missed = Some(format!(
                "its renders reach {got:.2} dB, not {target:.2}: quality {} is the best there is; \
                 lossless=True keeps every float",
                found.quality
            ));
        }
        self.made.psnr = Some(got);
        (self.made.encoded, self.made.quality) = (found.encoded, Some(found.quality));
        Ok(())
    }

    /// Takes the rows back to the Gaussians of the input.
    fn finish(mut self) -> Made {
        let Some(mut rows) = self.made.encoded.rows.take().filter(|_| self.options.rows) else {
            return self.made;
        };
        if let Some(split) = &self.trimmed {
            let leaves = self.made.encoded.index.header.count as usize - split.outliers.len();
            rows = split.rows(&rows, leaves as u32);
        }
        let number = |row: u32| if row == LEFT_OUT { -1 } else { i64::from(row) };
        self.made.rows = Some(match &self.kept {
            None => rows.into_iter().map(number).collect(),
            Some(kept) => {
                let mut all = vec![-1; self.input];
                kept.iter().zip(rows).for_each(|(&i, row)| all[i] = number(row));
                all
            }
        });
        self.made
    }
}

/// With the codebook's precision where changes of shapes show.
fn encode_with_sensitivity(
    scene: &Scene,
    strategy: impl FnOnce(&[f32], gsvx::Seen) -> gsvx::Result<Strategy>,
    (seen, outliers): (Option<&[f32]>, Option<&Scene>),
    mut choices: EncodeOptions,
    cameras: &[Camera],
) -> gsvx::Result<Encoded> {
    let n = scene.len();
    let Prepared { scene, voxels, importance } = gsvx::prepare(scene, strategy, seen)?;
    choices.importance = Some(importance);
    choices.covariance_sensitivity = Some(finetune::covariance_sensitivity(&scene, cameras));
    let encoded = gsvx::encode_voxels(&scene, &voxels, outliers, &choices)?;
    let rows = choices.rows.then(|| voxels.leaf_of_each(n));
    Ok(Encoded { left_out: voxels.dropped.len(), rows, ..encoded })
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
    out.set_item("encodes", made.encodes)?;
    out.set_item("invalid", made.invalid)?;
    out.set_item("pruned", made.pruned)?;
    out.set_item("outliers", made.outliers)?;
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

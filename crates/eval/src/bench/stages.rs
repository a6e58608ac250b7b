//! Measures each stage in the settings that exchange time for error.

use anyhow::Result;
use finetune::probe::{TileTest, Variant, VariantPass};
use finetune::{RenderOptions, metrics, render};
use gpcc_lite::attribute::{self, Options};
use gpcc_lite::coeffs::Mode;
use gpcc_lite::predict::Neighbours;
use gpcc_lite::quant::Step;
use gpcc_lite::raht::Plan;
use gs_model::{Camera, Scene, ply};
use gsvx::{DecodeOptions, EncodeOptions, Entropy, Prepared, Seen, importance};
use voxel::{Cube, Merge, Strategy, Voxelization};

use super::{Row, Time, timed};
use crate::scenes::SceneFiles;

/// Fraction bits of the fixed-point transform's values.
const VALUE_BITS: u32 = gpcc_lite::quant::VALUE_BITS;
/// Integers per unit of an attribute, as in `gsvx`.
const UNITS: f64 = 65536.0;

/// Measures every stage on one scene.
pub(super) fn measure(found: &SceneFiles, repeat: usize) -> Result<Vec<Row>> {
    let path = &found.dataset.model_path;
    let mut rows = Vec::new();
    let ((mut scene, _), time, peak_mb) = timed(repeat, || Ok(ply::read(path)?))?;
    scene.drop_invalid();
    rows.push(Row {
        stage: "Reading the model",
        setting: "PLY".into(),
        time,
        error: 0.0,
        of: "none, every float comes back",
        bytes: std::fs::metadata(path).ok().map(|m| m.len() as usize),
        peak_mb,
    });
    let cube = Cube::of(&scene.means)?;
    let depth = 12;
    let voxels = voxel::voxelize(&scene, &cube, &Strategy::Uniform { depth })?;
    let merged = voxel::merge(&scene, &voxels, Merge::Moments)?;
    let cameras: Vec<Camera> = found.dataset.held_out().take(2).map(|v| small(&v.camera)).collect();
    raht(&mut rows, &merged, &voxels, repeat)?;
    attributes(&mut rows, &merged, &voxels, repeat)?;
    neighbours(&mut rows, &merged, &voxels, repeat)?;
    codebooks(&mut rows, &merged, repeat)?;
    voxelizations(&mut rows, &scene, &cube, &cameras, repeat)?;
    rasterizers(&mut rows, &scene, &cameras[..1], repeat)?;
    variants(&mut rows, &scene, &cameras[..1], repeat)?;
    chain(&mut rows, &scene, &cameras, repeat)?;
    Ok(rows)
}

/// A view of at most 640 pixels: enough to see errors, quick enough to repeat.
pub(super) fn small(camera: &Camera) -> Camera {
    let factor = (f64::from(camera.width) / 640.0).max(1.0);
    let size = |v: u32| (f64::from(v) / factor).round() as u32;
    camera.scaled_to(size(camera.width), size(camera.height)).unwrap_or_else(|| camera.clone())
}

/// Root mean square difference of renders.
fn render_error(a: &Scene, b: &Scene, cameras: &[Camera]) -> f64 {
    let options = RenderOptions::default();
    let mean: f64 = cameras
        .iter()
        .map(|c| metrics::psnr(&render(a, c, &options), &render(b, c, &options)))
        .map(|psnr| libm::pow(10.0, -psnr / 10.0))
        .sum::<f64>()
        / cameras.len().max(1) as f64;
    mean.sqrt()
}

fn luma(scene: &Scene) -> Vec<f64> {
    (0..scene.len()).map(|i| gsvx::attributes::colour::forward(scene.sh_of(i)[0])[0]).collect()
}

/// RAHT in f32, in f64 and in fixed point.
fn raht(rows: &mut Vec<Row>, merged: &Scene, voxels: &Voxelization, repeat: usize) -> Result<()> {
    let plan = Plan::new(&voxels.leaves, voxels.j_high)?;
    let values = luma(merged);
    let mut add = |setting: &str, measured: (Vec<f64>, Time, f64)| {
        let (back, time, peak_mb) = measured;
        let error = back.iter().zip(&values).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        rows.push(Row {
            stage: "RAHT and its inverse, one channel",
            setting: setting.into(),
            time,
            error,
            of: "largest difference after the way there and back, in units of SH (the fixed-point \
                 input is rounded to 2^-16)",
            bytes: None,
            peak_mb,
        });
    };
    add(
        "f32",
        timed(repeat, || {
            let mut v: Vec<f32> = values.iter().map(|&v| v as f32).collect();
            plan.forward_f32(&mut v)?;
            plan.inverse_f32(&mut v)?;
            Ok(v.into_iter().map(f64::from).collect())
        })?,
    );
    add(
        "f64",
        timed(repeat, || {
            let mut v = values.clone();
            plan.forward_f64(&mut v)?;
            plan.inverse_f64(&mut v)?;
            Ok(v)
        })?,
    );
    add(
        "fixed point (i64)",
        timed(repeat, || {
            let mut v: Vec<i64> =
                values.iter().map(|&v| ((v * UNITS).round() as i64) << VALUE_BITS).collect();
            plan.forward_fixed(&mut v)?;
            plan.inverse_fixed(&mut v)?;
            let unit = 1.0 / (UNITS * f64::from(1u32 << VALUE_BITS));
            Ok(v.into_iter().map(|v| v as f64 * unit).collect())
        })?,
    );
    Ok(())
}

/// Entropy coder, dead zone and prediction, at one step.
fn attributes(
    rows: &mut Vec<Row>,
    merged: &Scene,
    voxels: &Voxelization,
    repeat: usize,
) -> Result<()> {
    let plan = Plan::new(&voxels.leaves, voxels.j_high)?;
    plan.prepare_prediction();
    let mut planes = vec![Vec::new(); 3];
    for i in 0..merged.len() {
        let ycc = gsvx::attributes::colour::forward(merged.sh_of(i)[0]);
        (0..3).for_each(|c| planes[c].push((ycc[c] * UNITS).round() as i32));
    }
    let views: Vec<&[i32]> = planes.iter().map(Vec::as_slice).collect();
    let steps = [Step::new(0.1 * UNITS); 3];
    for (name, mode) in [("range", Mode::Range), ("RLGR", Mode::Rlgr)] {
        for (dead_zone, lambda) in [("RDOQ", Options::default().lambda), ("no RDOQ", 0)] {
            for (predicts, prediction) in [("prediction", true), ("no prediction", false)] {
                let options = Options {
                    mode,
                    lambda,
                    prediction,
                    // The decoder is measured apart.
                    reconstruction: false,
                    ..Options::default()
                };
                let (coded, time, peak_mb) =
                    timed(repeat, || Ok(attribute::encode(&plan, &views, &steps, &options)?))?;
                let decoded = attribute::decode(&plan, &coded.bytes, views.len())?;
                let square: f64 = decoded
                    .iter()
                    .zip(&planes)
                    .flat_map(|(a, b)| a.iter().zip(b))
                    .map(|(a, b)| (f64::from(a - b) / UNITS) * (f64::from(a - b) / UNITS))
                    .sum();
                rows.push(Row {
                    stage: "Coding DC colours",
                    setting: format!("{name}, {dead_zone}, {predicts}"),
                    time,
                    error: (square / (3 * merged.len()).max(1) as f64).sqrt(),
                    of: "root mean square, units of SH, at a step of 0.1; compare bytes at equal \
                         error",
                    bytes: Some(coded.bytes.len()),
                    peak_mb,
                });
            }
        }
    }
    Ok(())
}

/// Number of neighbours that predict a value.
fn neighbours(
    rows: &mut Vec<Row>,
    merged: &Scene,
    voxels: &Voxelization,
    repeat: usize,
) -> Result<()> {
    let near = Neighbours::new(&voxels.leaves, voxels.j_high)?;
    let values: Vec<i64> =
        merged.log_scales.iter().map(|l| (f64::from(l[0]) * 4096.0) as i64).collect();
    for k in [1, 2, 3, 4, 6, 8, 12] {
        let (sum, time, peak_mb) = timed(repeat, || {
            let mut sum = 0.0;
            for at in 0..near.len() {
                let (index, distance) = near.of(at);
                let (mut total, mut weights) = (0i64, 0i64);
                for (&j, &d) in index.iter().zip(distance).take(k) {
                    let w = ((1i64 << 20) / (i64::from(d) + 8)).max(1);
                    total += w * values[j as usize];
                    weights += w;
                }
                let prediction = total.checked_div(weights).unwrap_or(0);
                sum += (values[near.order()[at] as usize] - prediction).unsigned_abs() as f64;
            }
            Ok(sum)
        })?;
        rows.push(Row {
            stage: "Neighbours that predict",
            setting: format!("k = {k}"),
            time,
            error: sum / 4096.0 / near.len().max(1) as f64,
            of: "mean absolute residual of the first log-scale; finding the neighbours is not \
                 in the time (the stream's k is 12)",
            bytes: None,
            peak_mb,
        });
    }
    Ok(())
}

/// Size of the covariance codebook.
fn codebooks(rows: &mut Vec<Row>, merged: &Scene, repeat: usize) -> Result<()> {
    let weights = importance::without_cameras(merged);
    let covariances: Vec<vq::Covariance> = merged
        .rotations
        .iter()
        .zip(&merged.log_scales)
        .map(|(&q, l)| Ok(vq::Covariance::split(q, l.map(|v| v.clamp(-100.0, 100.0)))?.0))
        .collect::<Result<_>>()?;
    for bits in [6, 8, 10, 12] {
        let options = vq::Options::with_codewords(1 << bits);
        let ((book, indices), time, peak_mb) = timed(repeat.min(2), || {
            let book = vq::Codebook::train(&covariances, &weights, &options)?;
            let indices = book.assign(&covariances);
            Ok((book, indices))
        })?;
        let d = book.distortion(&covariances, &weights, &indices)?;
        let bytes = book.to_bytes().len() + vq::index::encode(&indices, book.len())?.len();
        rows.push(Row {
            stage: "Covariance codebook",
            setting: format!("2^{bits} codewords"),
            time,
            error: d.weighted_mean.sqrt(),
            of: "root of the weighted mean squared distance of normalised covariances",
            bytes: Some(bytes),
            peak_mb,
        });
    }
    Ok(())
}

/// Criteria of the voxelization.
fn voxelizations(
    rows: &mut Vec<Row>,
    scene: &Scene,
    cube: &Cube,
    cameras: &[Camera],
    repeat: usize,
) -> Result<()> {
    let guessed = importance::without_cameras(scene);
    let default = gsvx::default_strategy(gsvx::DEFAULT_QUALITY, &guessed, Seen::Guessed)?;
    for (name, strategy) in [
        ("uniform, depth 10", Strategy::Uniform { depth: 10 }),
        ("uniform, depth 12", Strategy::Uniform { depth: 12 }),
        ("paper, 8 to 12", Strategy::paper(8, 12)),
        ("rate-distortion, default", default),
    ] {
        let ((voxels, merged), time, peak_mb) = timed(repeat, || {
            let voxels = voxel::voxelize(scene, cube, &strategy)?;
            let merged = voxel::merge(scene, &voxels, Merge::Moments)?;
            Ok((voxels, merged))
        })?;
        rows.push(Row {
            stage: "Voxelizing and merging",
            setting: format!("{name} ({} leaves)", voxels.len()),
            time,
            error: render_error(scene, &merged, cameras),
            of: "root mean square difference of renders from those of the input, two held-out \
                 views",
            bytes: None,
            peak_mb,
        });
    }
    Ok(())
}

/// Blending of a view: the executor, which skips rows and lanes of a tile, against the scalar
/// reference, which visits every pixel.
fn rasterizers(
    rows: &mut Vec<Row>,
    scene: &Scene,
    cameras: &[Camera],
    repeat: usize,
) -> Result<()> {
    let Some(camera) = cameras.first() else { return Ok(()) };
    let photo = render(scene, camera, &RenderOptions::default());
    let mut probe = finetune::probe::Probe::new(scene, camera, &photo);
    let of = "none: both give the same bits (finetune's test `the_executor_agrees_with_the_scalar_reference`); \
              blend and its adjoint of one view";
    let (_, time, peak_mb) = timed(repeat, || {
        probe.blend();
        probe.blend_adjoint();
        Ok(())
    })?;
    let stage = "Blending a view";
    let setting = "rows and lanes tested".to_owned();
    rows.push(Row { stage, setting, time, error: 0.0, of, bytes: None, peak_mb });
    let (_, time, peak_mb) = timed(1, || {
        probe.scalar();
        Ok(())
    })?;
    let setting = "every pixel of a tile".to_owned();
    rows.push(Row { stage, setting, time, error: 0.0, of, bytes: None, peak_mb });
    Ok(())
}

/// Variants of the rasterizer: the test of tiles, the transmittance at which blending stops, and the
/// precision of colours. The time is of one step of a fine-tune. The error is against a render that
/// lists a splat in every tile of its bounding square and never stops.
fn variants(rows: &mut Vec<Row>, scene: &Scene, cameras: &[Camera], repeat: usize) -> Result<()> {
    let Some(camera) = cameras.first() else { return Ok(()) };
    let photo = render(scene, camera, &RenderOptions::default());
    let d = Variant::default();
    let mut whole =
        VariantPass::new(camera, &photo, Variant { tile_test: TileTest::Square, t_stop: 0.0, ..d });
    whole.forward(scene);
    let whole = whole.image();
    let mut list = vec![
        ("tiles of the ellipse (default)".to_owned(), d),
        ("tiles of the rectangle".to_owned(), Variant { tile_test: TileTest::Rectangle, ..d }),
        ("tiles of the square".to_owned(), Variant { tile_test: TileTest::Square, ..d }),
    ];
    for t_stop in [0.0, 1e-3, 1e-2] {
        list.push((format!("stop at {t_stop:.0e} (default 1e-4)"), Variant { t_stop, ..d }));
    }
    list.push(("colours in half precision".to_owned(), Variant { half_colour: true, ..d }));
    for (setting, variant) in list {
        let mut pass = VariantPass::new(camera, &photo, variant);
        let (_, time, peak_mb) = timed(repeat, || {
            pass.step(scene);
            Ok(())
        })?;
        let image = pass.image();
        let pairs = image.rgb.iter().zip(&whole.rgb);
        let square: f64 = pairs.map(|(a, b)| f64::from(a - b) * f64::from(a - b)).sum();
        rows.push(Row {
            stage: "Rasterizer: tile test, early stop, colour",
            setting,
            time,
            error: (square / image.rgb.len().max(1) as f64).sqrt(),
            of: "root mean square difference of the view from one with the square's tiles and \
                 without early stop; the time is of a whole step of one view",
            bytes: None,
            peak_mb,
        });
    }
    Ok(())
}

/// The whole codec by quality, and its decoder.
fn chain(rows: &mut Vec<Row>, scene: &Scene, cameras: &[Camera], repeat: usize) -> Result<()> {
    let of = "root mean square difference of renders from those of the input, two held-out views";
    for (setting, quality, entropy) in [
        ("quality 40", 40.0, Entropy::Range),
        ("quality 60", 60.0, Entropy::Range),
        ("quality 80", 80.0, Entropy::Range),
        ("quality 60, --fast", 60.0, Entropy::Fast),
    ] {
        let (bytes, time, peak_mb) = timed(repeat.min(2), || {
            let choose = |found: &[f32], seen| gsvx::default_strategy(quality, found, seen);
            let Prepared { scene, voxels, importance } = gsvx::prepare(scene, choose, None)?;
            let base = EncodeOptions::from_quality(quality)?;
            let options = EncodeOptions { entropy, importance: Some(importance), ..base };
            Ok(gsvx::encode(&scene, &voxels, &options)?.bytes)
        })?;
        let decode = || Ok(gsvx::decode(&bytes, &DecodeOptions::default())?.scene);
        let (decoded, decode_time, decode_peak) = timed(repeat, decode)?;
        let error = render_error(scene, &decoded, cameras);
        let size = Some(bytes.len());
        let row = |stage, time, peak_mb| Row {
            stage,
            setting: setting.into(),
            time,
            error,
            of,
            bytes: size,
            peak_mb,
        };
        rows.push(row("Voxelizing and encoding", time, peak_mb));
        rows.push(row("Decoding", decode_time, decode_peak));
    }
    let (bytes, time, peak_mb) = timed(1, || Ok(gsvx::encode_lossless(scene)?.bytes))?;
    let (_, decode_time, decode_peak) =
        timed(1, || Ok(gsvx::decode(&bytes, &DecodeOptions::default())?.scene))?;
    let size = Some(bytes.len());
    for (stage, time, peak_mb) in
        [("Voxelizing and encoding", time, peak_mb), ("Decoding", decode_time, decode_peak)]
    {
        let setting = "--lossless".to_owned();
        rows.push(Row { stage, setting, time, error: 0.0, of, bytes: size, peak_mb });
    }
    rows.sort_by_key(|r| match r.stage {
        "Voxelizing and encoding" => 1,
        "Decoding" => 2,
        _ => 0,
    });
    Ok(())
}

//! Measures each stage in the settings that exchange time for error.

use anyhow::Result;
use finetune::probe::{TileTest, Variant, VariantPass};
use finetune::{RenderOptions, metrics, render};
use gpcc_lite::attribute::{self, Options};
use gpcc_lite::coder::{Decoder, Encoder};
use gpcc_lite::predict::Neighbours;
use gpcc_lite::raht::{self, Plan, Rows};
use gs_model::{Camera, Scene, ply};
use gsvx::{EncodeOptions, Seen, importance};
use voxel::{Cube, Merge, Strategy, Voxelization};

use super::{Cost, Row, Stage, timed};
use crate::scenes::SceneFiles;

/// Measures every stage on one scene.
pub(super) fn measure(found: &SceneFiles, repeat: usize) -> Result<Vec<Row>> {
    let path = &found.dataset.model_path;
    let mut rows = Vec::new();
    let ((mut scene, _), cost) = timed(repeat, || Ok(ply::read(path)?))?;
    scene.drop_invalid();
    let stage = Stage { name: "Reading the model", error: "none, every float comes back" };
    let bytes = std::fs::metadata(path).ok().map(|m| m.len() as usize);
    rows.push(stage.row("PLY", cost, 0.0, bytes));
    let cube = voxel::cube_of(&scene.means)?;
    let depth = 12;
    let voxels = voxel::voxelize(&scene, &cube, &Strategy::Uniform { depth })?;
    let merged = voxel::merge(&scene, &voxels, Merge::Moments)?;
    let cameras: Vec<Camera> = found.dataset.held_out().take(2).map(|v| small(&v.camera)).collect();
    transforms(&mut rows, &merged, &voxels, repeat)?;
    attributes(&mut rows, &merged, &voxels, repeat)?;
    neighbours(&mut rows, &merged, &voxels, repeat)?;
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

/// Y, Co, Cg of the base colours, in a row for each Gaussian.
fn base_colours(scene: &Scene) -> Rows {
    let mut rows = Rows::new(scene.len(), 3);
    for i in 0..scene.len() {
        let [y, co, cg] = crate::attributes::colour_planes(scene.sh_of(i)[0]);
        rows.row_mut(i).copy_from_slice(&[y as f32, co as f32, cg as f32]);
    }
    rows
}

/// RAHT in single and in double precision.
fn transforms(
    rows: &mut Vec<Row>,
    merged: &Scene,
    voxels: &Voxelization,
    repeat: usize,
) -> Result<()> {
    let plan = Plan::new(voxels.octree().clone());
    let colours = base_colours(merged);
    let luma: Vec<f64> = (0..colours.leaves()).map(|i| f64::from(colours.row(i)[0])).collect();
    let stage = Stage {
        name: "RAHT and its inverse, one channel",
        error: "largest difference after the way there and back, in units of SH",
    };
    let mut add = |setting: &str, (back, cost): (Vec<f64>, Cost)| {
        let error = back.iter().zip(&luma).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        rows.push(stage.row(setting, cost, error, None));
    };
    add(
        "f32, as in streams",
        timed(repeat, || {
            let mut v = Rows::new(luma.len(), 1);
            luma.iter().enumerate().for_each(|(i, &y)| v.row_mut(i)[0] = y as f32);
            raht::forward(&plan, &mut v)?;
            raht::inverse(&plan, &mut v)?;
            Ok((0..v.leaves()).map(|i| f64::from(v.row(i)[0])).collect())
        })?,
    );
    add(
        "f64",
        timed(repeat, || {
            let mut v = luma.clone();
            plan.forward_f64(&mut v)?;
            plan.inverse_f64(&mut v)?;
            Ok(v)
        })?,
    );
    Ok(())
}

/// Rate-distortion optimised quantisation against rounding, at one step.
fn attributes(
    rows: &mut Vec<Row>,
    merged: &Scene,
    voxels: &Voxelization,
    repeat: usize,
) -> Result<()> {
    let plan = Plan::new(voxels.octree().clone());
    let colours = base_colours(merged);
    let steps = [0.1; 3];
    let stage = Stage {
        name: "Coding DC colours",
        error: "root mean square, units of SH, at a step of 0.1; compare bytes at equal error",
    };
    for (setting, lambda) in [("RDOQ", Options::default().lambda), ("no RDOQ", 0.0)] {
        let (bytes, cost) = timed(repeat, || {
            let (mut coder, mut values) = (Encoder::default(), colours.clone());
            attribute::encode(&mut coder, &plan, &steps, &Options { lambda }, &mut values)?;
            Ok(coder.finish())
        })?;
        let mut decoded = Rows::new(colours.leaves(), colours.channels());
        attribute::decode(&mut Decoder::new(&bytes)?, &plan, &steps, &mut decoded)?;
        let square: f64 = (0..colours.leaves())
            .flat_map(|i| colours.row(i).iter().zip(decoded.row(i)))
            .map(|(a, b)| f64::from(a - b) * f64::from(a - b))
            .sum();
        let error = (square / (3 * merged.len()).max(1) as f64).sqrt();
        rows.push(stage.row(setting, cost, error, Some(bytes.len())));
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
    let near = Neighbours::new(voxels.octree());
    let values: Vec<i64> =
        merged.log_scales.iter().map(|l| (f64::from(l[0]) * 4096.0) as i64).collect();
    let stage = Stage {
        name: "Neighbours that predict",
        error: "mean absolute residual of the first log-scale; finding the neighbours is not in the \
                time (the stream's k is 12)",
    };
    for k in [1, 2, 3, 4, 6, 8, 12] {
        let (sum, cost) = timed(repeat, || {
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
        let error = sum / 4096.0 / near.len().max(1) as f64;
        rows.push(stage.row(&format!("k = {k}"), cost, error, None));
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
    let stage = Stage { name: "Voxelizing and merging", error: FROM_INPUT };
    for (name, strategy) in [
        ("uniform, depth 10", Strategy::Uniform { depth: 10 }),
        ("uniform, depth 12", Strategy::Uniform { depth: 12 }),
        ("paper, 8 to 12", Strategy::paper(8, 12)),
        ("rate-distortion, default", default),
    ] {
        let ((voxels, merged), cost) = timed(repeat, || {
            let voxels = voxel::voxelize(scene, cube, &strategy)?;
            let merged = voxel::merge(scene, &voxels, Merge::Moments)?;
            Ok((voxels, merged))
        })?;
        let setting = format!("{name} ({} leaves)", voxels.len());
        rows.push(stage.row(&setting, cost, render_error(scene, &merged, cameras), None));
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
    let stage = Stage {
        name: "Blending a view",
        error: "none: both give the same bits (finetune's test \
                `the_executor_agrees_with_the_scalar_reference`); blend and its adjoint of one view",
    };
    let ((), cost) = timed(repeat, || {
        probe.blend();
        probe.blend_adjoint();
        Ok(())
    })?;
    rows.push(stage.row("rows and lanes tested", cost, 0.0, None));
    let ((), cost) = timed(1, || {
        probe.scalar();
        Ok(())
    })?;
    rows.push(stage.row("every pixel of a tile", cost, 0.0, None));
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
    let stage = Stage {
        name: "Rasterizer: tile test, early stop, colour",
        error: "root mean square difference of the view from one with the square's tiles and without \
                early stop; the time is of a whole step of one view",
    };
    for (setting, variant) in list {
        let mut pass = VariantPass::new(camera, &photo, variant);
        let ((), cost) = timed(repeat, || {
            pass.step(scene);
            Ok(())
        })?;
        let image = pass.image();
        let pairs = image.rgb.iter().zip(&whole.rgb);
        let square: f64 = pairs.map(|(a, b)| f64::from(a - b) * f64::from(a - b)).sum();
        let error = (square / image.rgb.len().max(1) as f64).sqrt();
        rows.push(stage.row(&setting, cost, error, None));
    }
    Ok(())
}

/// The whole codec by quality, with levels of detail, and lossless; and its decoder.
fn chain(rows: &mut Vec<Row>, scene: &Scene, cameras: &[Camera], repeat: usize) -> Result<()> {
    for (setting, quality, lod) in [
        ("quality 40", 40.0, false),
        ("quality 60", 60.0, false),
        ("quality 80", 80.0, false),
        ("quality 60, --lod", 60.0, true),
    ] {
        let mut options = EncodeOptions::from_quality(quality)?;
        options.lod = lod;
        let encode = || Ok(gsvx::encode(scene, &options)?.bytes);
        let coded = timed(repeat.min(2), encode)?;
        let decoded = timed(repeat, || Ok(gsvx::decode(&coded.0)?))?;
        let error = render_error(scene, &decoded.0, cameras);
        both_ways(rows, setting, error, coded, decoded);
    }
    let coded = timed(1, || Ok(gsvx::encode_lossless(scene, false)?.bytes))?;
    let decoded = timed(1, || Ok(gsvx::decode(&coded.0)?))?;
    both_ways(rows, "--lossless", 0.0, coded, decoded);
    rows.sort_by_key(|r| match r.stage {
        ENCODING => 1,
        DECODING => 2,
        _ => 0,
    });
    Ok(())
}

/// What renders are compared with.
const FROM_INPUT: &str =
    "root mean square difference of renders from those of the input, two held-out views";
const ENCODING: Stage = Stage { name: "Voxelizing and encoding", error: FROM_INPUT };
const DECODING: Stage = Stage { name: "Decoding", error: FROM_INPUT };

/// The rows of one setting of encoder and decoder.
fn both_ways(
    rows: &mut Vec<Row>,
    setting: &str,
    error: f64,
    (bytes, encode): (Vec<u8>, Cost),
    (_, decode): (Scene, Cost),
) {
    for (stage, cost) in [(ENCODING, encode), (DECODING, decode)] {
        rows.push(stage.row(setting, cost, error, Some(bytes.len())));
    }
}

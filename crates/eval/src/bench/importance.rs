//! Rates with and without cameras, also of models with a sky or with a distant copy of themselves.

use std::path::Path;

use anyhow::{Context, Result};
use finetune::TrainView;
use finetune::framing::{self, Constraints};
use gs_model::{Camera, Format, Scene};
use gsvx::{EncodeOptions, Seen};
use testing::Rng;

use crate::bd;
use crate::cells;
use crate::page::{Page, Table, signed};
use crate::scenes::{self, ModelAndCameras, TestScene};
use crate::voxelized::voxelized;

const QUALITIES: [f32; 5] = [34.0, 48.0, 62.0, 76.0, 90.0];

/// Measures and writes the page at `out`.
pub(super) fn run(names: &[String], out: &Path) -> Result<()> {
    let mut page = Page::new(out, "What do cameras bring?");
    page.text(format!(
        "`cargo xtask bench-gsvx --importance {}`. BD-rates: pchip, qualities 34, 48, 62, 76 and 90. PSNR of the \
         held-out views: scenes against photos, the desk, the room below a sky, and models (12 views of an orbit, \
         640 x 480) against renders of the input.",
        names.join(","),
    ));
    page.text("## With cameras");
    page.text(
        "Against `--drop-unseen`. Without that flag the most prominent part of what cameras hardly see is kept. Off the \
         cameras: dB from renders of the input, 8 views of a full circle at 30 degrees, at quality 62: dropped, kept.",
    );
    let scenes = names.iter().map(|name| Measured::open(name)).collect::<Result<Vec<_>>>()?;
    let mut table =
        Table::new("scene | Gaussians | kept | off the cameras, dropped | off the cameras, kept");
    for scene in scenes.iter().filter(|s| !s.training.is_empty()) {
        with_cameras(scene, &mut table)?;
    }
    page.table(&table);
    page.text("## Without cameras");
    page.text(
        "Importance is a guess (`gsvx::importance::without_cameras`). Against opacity times the root of the area of the \
         two largest axes; against the same importance for all; against the better of both.",
    );
    let mut table =
        Table::new("scene | against opacity and size | against uniform | against the better");
    for scene in &scenes {
        guessed(scene, &mut table)?;
    }
    page.table(&table);
    page.text("## Skies and copies");
    page.text(format!(
        "The room, a few units wide, at quality {}, without cameras: alone, with a third as many large Gaussians on a \
         sphere around it, and with a distant copy of itself. dB of the room's held-out views against renders of the \
         input.",
        gsvx::DEFAULT_QUALITY
    ));
    page.table(&far_parts(scenes::DEFAULT)?);
    page.write()
}

/// The plainer guess, which depends on the scale of each part of a scene.
fn opacity_and_size(scene: &Scene) -> Vec<f32> {
    let of = |(&logit, ls): (&f32, &[f32; 3])| {
        let thin = ls.iter().copied().fold(f32::INFINITY, f32::min);
        let log_area = f64::from(ls[0] + ls[1] + ls[2] - thin);
        (libm::exp(0.5 * log_area) / (1.0 + libm::exp(-f64::from(logit)))) as f32
    };
    scene.opacity_logits.iter().zip(&scene.log_scales).map(of).collect()
}

/// A model with what it is measured at.
struct Measured {
    name: String,
    model: Scene,
    training: Vec<Camera>,
    views: Vec<TrainView>,
}

/// The room with a sky 100 units away.
const ROOM_AND_SKY: &str = "room-and-sky";

impl Measured {
    /// A scene, [`scenes::DESK`], [`ROOM_AND_SKY`], or the path of a model.
    fn open(name: &str) -> Result<Self> {
        let from_renders = |model: Scene, training, cameras: Vec<Camera>| {
            let views = cameras.into_iter().map(|c| TrainView::rendered(&model, c)).collect();
            Self { name: stem(name), views, model, training }
        };
        if Format::of_name(name).is_some() {
            let model = scenes::read_model(name.as_ref())?;
            let cameras = orbit(&model, 12, None, [640, 480])?;
            return Ok(from_renders(model, Vec::new(), cameras));
        }
        if name == scenes::DESK {
            let ModelAndCameras { model, training, held_out } = ModelAndCameras::open(name, 12)?;
            return Ok(from_renders(model, training, held_out));
        }
        let base = if name == ROOM_AND_SKY { scenes::DEFAULT } else { name };
        let TestScene { mut model, training, held_out, .. } = TestScene::open(base, 12)?;
        if name == ROOM_AND_SKY {
            model.append(&sky(100.0, model.len() / 3, model.sh_degree));
            let cameras = held_out.into_iter().map(|v| v.camera).collect();
            return Ok(from_renders(model, training, cameras));
        }
        Ok(Self { name: name.to_owned(), model, training, views: held_out })
    }

    /// Sizes and PSNRs at all qualities.
    fn curve(&self, encode: impl Fn(f32) -> Result<Vec<u8>>) -> Result<Vec<bd::Point>> {
        let point = |&quality: &f32| {
            let stream = encode(quality)?;
            let psnr_db = db(&gsvx::decode(&stream)?, &self.views);
            Ok(bd::Point { rate: stream.len() as f64, psnr_db })
        };
        QUALITIES.iter().map(point).collect()
    }

    /// The curve of importances that stand for a guess.
    fn guessed(&self, importance: &[f32]) -> Result<Vec<bd::Point>> {
        self.curve(|quality| {
            let strategy = gsvx::default_strategy(quality, importance, Seen::Guessed)?;
            let prepared = voxelized(&self.model, &strategy, importance.to_vec())?;
            let mut options = EncodeOptions::from_quality(quality)?;
            options.importance = Some(prepared.importance);
            let octree = prepared.voxels.octree();
            Ok(gsvx::encode_voxels(&prepared.scene, octree, None, &options)?.bytes)
        })
    }
}

/// The name of a file without folder and extension.
fn stem(name: &str) -> String {
    Path::new(name).file_stem().map_or(name.into(), |s| s.to_string_lossy().into_owned())
}

/// Cameras on a circle; on the whole of it if `up` is known.
fn orbit(
    model: &Scene,
    n: u32,
    up: Option<[f64; 3]>,
    [width, height]: [u32; 2],
) -> Result<Vec<Camera>> {
    let tangent = 0.577;
    let tangents = [tangent, tangent * f64::from(height) / f64::from(width)];
    let elevation = up.map(|_| 30.0);
    let found = framing::find(model, &Constraints { up, radius: None, elevation, tangents });
    let mut placement = found.context("nothing to look at")?;
    placement.arc = placement.arc.filter(|_| up.is_none());
    Ok(placement.cameras(n, "orbit", [width, height], 0.5 * f64::from(width) / tangent))
}

/// Difference in bytes at equal PSNR, per cent.
fn bd_rate(anchor: &[bd::Point], curve: &[bd::Point]) -> Option<f64> {
    bd::bd_rate(&bd::hull(anchor), &bd::hull(curve), bd::Method::Pchip)
}

/// One row: what keeping something of what cameras hardly see costs and brings.
fn with_cameras(scene: &Measured, table: &mut Table) -> Result<()> {
    let seen = finetune::saliency(&scene.model, &scene.training).squared;
    let encode = |quality, drop_unseen| -> Result<Vec<u8>> {
        let mut options = EncodeOptions::from_quality(quality)?;
        (options.importance, options.drop_unseen) = (Some(seen.clone()), drop_unseen);
        Ok(gsvx::encode(&scene.model, &options)?.bytes)
    };
    let dropped = scene.curve(|quality| encode(quality, true))?;
    let kept = scene.curve(|quality| encode(quality, false))?;
    let up = scene.training.iter().map(|c| -c.rotation.row(1)).sum::<glam::DVec3>();
    let cameras = orbit(&scene.model, 8, Some(up.normalize().to_array()), [320, 240])?;
    let off: Vec<_> = cameras.into_iter().map(|c| TrainView::rendered(&scene.model, c)).collect();
    let mut row = cells![scene.name, scene.model.len(), signed(bd_rate(&dropped, &kept), 1, " %")];
    for drop_unseen in [true, false] {
        let decoded = gsvx::decode(&encode(62.0, drop_unseen)?)?;
        row.push(format!("{:.1}", db(&decoded, &off)));
    }
    table.told(row);
    Ok(())
}

/// One row: the guess against two plainer ones.
fn guessed(scene: &Measured, table: &mut Table) -> Result<()> {
    let guess = scene.guessed(&gsvx::importance::without_cameras(&scene.model))?;
    let plainer = scene.guessed(&opacity_and_size(&scene.model))?;
    let uniform = scene.guessed(&vec![1.0; scene.model.len()])?;
    let (a, b) = (bd_rate(&plainer, &guess), bd_rate(&uniform, &guess));
    let worse = a.zip(b).map(|(a, b)| a.max(b));
    table.told(cells![scene.name, signed(a, 1, " %"), signed(b, 1, " %"), signed(worse, 1, " %")]);
    Ok(())
}

/// The rows of a scene alone, with skies, and with copies of itself far away.
fn far_parts(name: &str) -> Result<Table> {
    let TestScene { model: alone, held_out, .. } = TestScene::open(name, usize::MAX)?;
    let mut models = vec![("alone".to_owned(), Scene::default())];
    for radius in [30.0, 100.0, 1000.0] {
        let sky = sky(radius, alone.len() / 3, alone.sh_degree);
        models.push((format!("a sky, {radius} units away"), sky));
    }
    for distance in [1e5f32, 3e6] {
        let mut copy = alone.clone();
        copy.means.iter_mut().for_each(|p| p[0] += distance);
        models.push((format!("a copy, {distance:.0e} units away"), copy));
    }
    let mut table = Table::new("model | Gaussians in the stream | bytes | dB");
    for (what, far) in models {
        let mut model = alone.clone();
        model.append(&far);
        let encoded = gsvx::encode(&model, &EncodeOptions::default())?;
        let decoded = gsvx::decode(&encoded.bytes)?;
        let (count, bytes) = (encoded.index.header.count, encoded.bytes.len());
        let views: Vec<_> =
            held_out.iter().map(|v| TrainView::rendered(&model, v.camera.clone())).collect();
        table.told(cells![what, count, bytes, format!("{:.2}", db(&decoded, &views))]);
    }
    Ok(table)
}

/// Mean PSNR of the renders of a scene, dB.
fn db(scene: &Scene, views: &[TrainView]) -> f64 {
    views.iter().map(|v| v.psnr(scene)).sum::<f64>() / views.len() as f64
}

/// Large Gaussians on a sphere, of two colours. Each covers twice its share of the sphere.
fn sky(radius: f32, n: usize, sh_degree: u8) -> Scene {
    let mut rng = Rng::seeded(21);
    let mut scene = Scene { sh_degree, ..Scene::default() };
    let log_scale = libm::logf(radius * (4.0 / n as f32).sqrt());
    while scene.len() < n {
        let p: [f32; 3] = std::array::from_fn(|_| rng.signed());
        let length = (p[0] * p[0] + p[1] * p[1] + p[2] * p[2]).sqrt();
        if !(0.1..1.0).contains(&length) {
            continue;
        }
        scene.means.push(p.map(|x| x * radius / length));
        scene.rotations.push([1.0, 0.0, 0.0, 0.0]);
        scene.log_scales.push([log_scale; 3]);
        scene.opacity_logits.push(2.0);
        let light = if rng.unit() < 0.5 { 0.2 } else { 0.9 };
        scene.sh.push([0.3 * light, 0.6 * light, light]);
        scene.sh.extend(std::iter::repeat_n([0.0; 3], scene.sh_len() - 1));
    }
    scene
}

//! Rates with and without cameras, also of models with a sky or with a distant copy of themselves.

use std::path::Path;

use anyhow::Result;
use finetune::{RenderOptions, metrics, render};
use gs_model::{Camera, Scene};
use gsvx::{EncodeOptions, Seen};
use testing::Rng;

use crate::cells;
use crate::codec::{self, Codec, CodecCurve};
use crate::page::{Page, Table, signed};
use crate::scenes::{self, TestScene};
use crate::voxelized::voxelized;

const QUALITIES: [f32; 5] = [34.0, 48.0, 62.0, 76.0, 90.0];

/// Measures and writes the page at `out`.
pub(super) fn run(names: &[String], out: &Path) -> Result<()> {
    let mut page = Page::new(out, "What do cameras bring?");
    page.text(format!(
        "`cargo xtask bench-gsvx --importance {}`. Without cameras, importance is a guess from opacity and from area \
         relative to that of the neighbours (`gsvx::importance::without_cameras`).",
        names.join(","),
    ));
    page.text(
        "BD-rate (pchip, qualities 34, 48, 62, 76 and 90, PSNR of the held-out views against the photos) against a \
         plainer guess: opacity times the root of the area of the two largest axes.",
    );
    let mut table = Table::new(
        "scene | without cameras | cameras, nothing left out | cameras, what they do not see left out",
    );
    for name in names {
        beside_cameras(name, &mut table)?;
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

/// The codec with importances from one source.
struct With {
    importance: Vec<f32>,
    seen: Seen,
}

impl Codec for With {
    fn name(&self) -> String {
        format!("{:?}", self.seen)
    }

    fn encode(&self, scene: &TestScene, quality: f32) -> Result<Vec<u8>> {
        let strategy = gsvx::default_strategy(quality, &self.importance, self.seen)?;
        let prepared = voxelized(&scene.model, &strategy, self.importance.clone())?;
        let mut options = EncodeOptions::from_quality(quality)?;
        options.importance = Some(prepared.importance);
        Ok(gsvx::encode_voxels(&prepared.scene, prepared.voxels.octree(), None, &options)?.bytes)
    }

    fn decode(&self, stream: &[u8]) -> Result<Scene> {
        Ok(gsvx::decode(stream)?)
    }
}

/// One row: the curves of a scene, against that of opacity and size.
fn beside_cameras(name: &str, table: &mut Table) -> Result<()> {
    let scene = TestScene::open(name, usize::MAX)?;
    let curve = |importance: Vec<f32>, seen| -> Result<CodecCurve> {
        codec::curve(&With { importance, seen }, &scene, &QUALITIES)
    };
    let plainer = curve(opacity_and_size(&scene.model), Seen::Guessed)?.rates();
    let seen = finetune::saliency(&scene.model, &scene.training).squared;
    let kept = gsvx::importance::with_unseen(&scene.model, &seen);
    let guessed = gsvx::importance::without_cameras(&scene.model);
    let mut row = cells![name];
    for (importance, seen) in
        [(guessed, Seen::Guessed), (kept, Seen::ByCameras), (seen, Seen::ByCamerasOnly)]
    {
        row.push(signed(curve(importance, seen)?.bd_rate(&plainer), 1, " %"));
    }
    table.told(row);
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
        let cameras = held_out.iter().map(|v| &v.camera);
        table.told(cells![what, count, bytes, format!("{:.2}", db(&decoded, &model, cameras))]);
    }
    Ok(table)
}

/// Mean PSNR between the renders of two scenes, dB.
fn db<'a>(
    scene: &Scene,
    reference: &Scene,
    cameras: impl ExactSizeIterator<Item = &'a Camera>,
) -> f64 {
    let (options, count) = (RenderOptions::default(), cameras.len());
    let of =
        |c: &Camera| metrics::psnr(&render(scene, c, &options), &render(reference, c, &options));
    cameras.map(of).sum::<f64>() / count as f64
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

//! What the encoder's virtual viewpoints bring, beside real cameras and beside the estimate from opacity
//! and size alone that they replaced; and models with parts far away.

use std::time::Instant;

use anyhow::{Context, Result};
use finetune::{RenderOptions, metrics, render};
use gs_model::{Camera, Scene};
use gsvx::{EncodeOptions, Seen};
use testing::Rng;

use crate::codec::{self, Codec, Curve};
use crate::scenes::TestScene;

const QUALITIES: [f32; 5] = [34.0, 48.0, 62.0, 76.0, 90.0];

/// Prints both tables.
pub(super) fn run(names: &[String]) -> Result<()> {
    println!(
        "| scene | virtual viewpoints | cameras | cameras, what they do not see left out | ms for the viewpoints | ms to encode |\n\
         |---|---:|---:|---:|---:|---:|"
    );
    for name in names {
        beside_cameras(name)?;
    }
    println!(
        "\n| model | estimate | Gaussians in the stream | bytes | room, dB | what was added, dB |\n\
         |---|---|---:|---:|---:|---:|"
    );
    far_parts()
}

/// Opacity times the root of the area of the two largest axes, as it was before virtual viewpoints.
fn opacity_and_size(scene: &Scene) -> Vec<f32> {
    let of = |(&logit, ls): (&f32, &[f32; 3])| {
        let thin = ls.iter().copied().fold(f32::INFINITY, f32::min);
        let log_area = f64::from(ls[0] + ls[1] + ls[2] - thin);
        (libm::exp(0.5 * log_area) / (1.0 + libm::exp(-f64::from(logit)))) as f32
    };
    scene.opacity_logits.iter().zip(&scene.log_scales).map(of).collect()
}

/// The codec with one way to know importances.
struct With {
    importance: Option<Vec<f32>>,
    seen: Seen,
}

impl Codec for With {
    fn name(&self) -> String {
        format!("{:?}", self.seen)
    }

    fn encode(&self, scene: &TestScene, quality: f32) -> Result<Vec<u8>> {
        Ok(self.stream(&scene.model, quality)?.bytes)
    }

    fn decode(&self, stream: &[u8]) -> Result<Scene> {
        Ok(gsvx::decode(stream)?)
    }
}

impl With {
    fn stream(&self, model: &Scene, quality: f32) -> Result<gsvx::Encoded> {
        let mut options = EncodeOptions::from_quality(quality)?;
        options.importance.clone_from(&self.importance);
        let strategy = |found: &[f32], _| gsvx::default_strategy(quality, found, self.seen);
        Ok(gsvx::encode_with(model, strategy, None, &options)?)
    }
}

/// One row: the curves of a scene, against that of opacity and size.
fn beside_cameras(name: &str) -> Result<()> {
    let scene = TestScene::open(name, usize::MAX)?;
    let seen = finetune::saliency_per_view(&scene.model, &scene.training).squared;
    let kept = gsvx::importance::with_unseen(&scene.model, &seen);
    let start = Instant::now();
    let virtual_ones = gsvx::importance::without_cameras(&scene.model);
    let estimate = start.elapsed().as_secs_f64();
    let curve = |importance: Vec<f32>, seen| -> Result<Curve> {
        codec::curve(&With { importance: Some(importance), seen }, &scene, &QUALITIES)
    };
    let before = curve(opacity_and_size(&scene.model), Seen::Guessed)?.rates();
    let virtual_ones = curve(virtual_ones, Seen::Guessed)?;
    let encode = virtual_ones.points[2].encode_seconds;
    let mut row = format!("| {name} |");
    let others = [curve(kept, Seen::ByCameras)?, curve(seen, Seen::ByCamerasOnly)?];
    for curve in [virtual_ones].iter().chain(&others) {
        let rate = curve.bd_rate(&before).context("the curves share no range of PSNR")?;
        row += &format!(" {rate:+.1} % |");
    }
    println!("{row} {:.1} | {:.0} |", 1e3 * estimate, 1e3 * encode);
    Ok(())
}

/// The room with a sky, and with copies of itself far away, at the default quality.
fn far_parts() -> Result<()> {
    let room = TestScene::open("room", usize::MAX)?;
    let cameras: Vec<Camera> = room.held_out.iter().map(|v| v.camera.clone()).collect();
    let n = room.model.len();
    let quality = gsvx::DEFAULT_QUALITY;
    let mut models = vec![("the room alone".to_owned(), room.model.clone())];
    for radius in [100.0, 1000.0] {
        let mut model = room.model.clone();
        model.append(&sky(radius, n / 3, room.model.sh_degree));
        models.push((format!("a sky around it, {radius} away"), model));
    }
    for (what, model) in &models {
        for (estimate, importance) in
            [("opacity and size", Some(opacity_and_size(model))), ("virtual viewpoints", None)]
        {
            let encoded = With { importance, seen: Seen::Guessed }.stream(model, quality)?;
            let decoded = gsvx::decode(&encoded.bytes)?;
            // The sky shows in no view of the room: it is looked at from above.
            let above = Camera::looking_at(
                String::new(),
                [0.0, 0.0, 30.0],
                [100.0, 30.0, 60.0],
                [0.0, 0.0, 1.0],
                [240, 160],
                120.0,
            );
            let added = if model.len() > n { db(&decoded, model, &[above])? } else { f64::NAN };
            row(what, estimate, &encoded, db(&decoded, model, &cameras)?, added);
        }
    }
    for (distance, what) in [(1e5f32, "1e5 away"), (3e6, "3e6 away")] {
        let moved = |by: f32, scene: &Scene| {
            let mut scene = scene.clone();
            scene.means.iter_mut().for_each(|p| p[0] += by);
            scene
        };
        let copy = moved(distance, &room.model);
        let mut model = room.model.clone();
        model.append(&copy);
        let encoded = gsvx::encode(&model, &EncodeOptions::from_quality(quality)?)?;
        let decoded = gsvx::decode(&encoded.bytes)?;
        let part = |far: bool| {
            let is_far = |&i: &usize| (decoded.means[i][0] > 0.5 * distance) == far;
            decoded.select(&(0..decoded.len()).filter(is_far).collect::<Vec<_>>())
        };
        // The copy is brought back, for its floats and those of cameras there are coarse.
        let near = db(&part(false), &room.model, &cameras)?;
        let far = db(&moved(-distance, &part(true)), &moved(-distance, &copy), &cameras)?;
        row(&format!("a copy of it {what}"), "virtual viewpoints", &encoded, near, far);
    }
    Ok(())
}

fn row(what: &str, estimate: &str, encoded: &gsvx::Encoded, room: f64, added: f64) {
    let added = if added.is_nan() { String::new() } else { format!("{added:.2}") };
    let (count, bytes) = (encoded.index.header.count, encoded.bytes.len());
    println!("| {what} | {estimate} | {count} | {bytes} | {room:.2} | {added} |");
}

/// Mean PSNR between the renders of two scenes, dB.
fn db(scene: &Scene, reference: &Scene, cameras: &[Camera]) -> Result<f64> {
    let options = RenderOptions::default();
    let of =
        |c: &Camera| metrics::psnr(&render(scene, c, &options), &render(reference, c, &options));
    Ok(cameras.iter().map(of).sum::<f64>() / cameras.len() as f64)
}

/// Large Gaussians on a sphere, of two colours.
fn sky(radius: f32, n: usize, sh_degree: u8) -> Scene {
    let mut rng = Rng::seeded(21);
    let mut scene = Scene { sh_degree, ..Scene::default() };
    // Each covers twice its share of the sphere.
    let log_scale = (radius * (4.0 / n as f32).sqrt()).max(f32::MIN_POSITIVE);
    let log_scale = libm::logf(log_scale);
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

//! A model without photos, tuned to its own renders at generated cameras and looked at from all around.

use std::ops::RangeInclusive;
use std::path::Path;

use anyhow::{Context, Result, ensure};
use finetune::TrainView;
use finetune::framing::{self, Constraints};
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::cache::{self, Cache};
use crate::cells;
use crate::measure;
use crate::page::Table;
use crate::process::GsvxCommand;
use crate::scenes;

/// Cameras that the tune generates.
const CAMERAS: u32 = 32;
/// Qualities without tuning: that which is most nearly as good at these cameras is taken.
const UNTUNED: RangeInclusive<u8> = 44..=54;
/// Elevations of the circles that the streams are compared at, degrees, and views on each.
const ELEVATIONS: [u32; 2] = [8, 60];
const VIEWS: &str = "24";
const SIZE: &str = "320x240";

/// What was measured of a model.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct Object {
    name: String,
    untuned_bytes: u64,
    untuned_quality: u8,
    bytes: u64,
    /// PSNR at the cameras of the tune, without tuning and with it, dB.
    at_cameras: [f64; 2],
    user_seconds: f64,
    peak_mb: f64,
    circles: Vec<Circle>,
}

/// PSNR against renders of the model on a circle, dB.
#[derive(Clone, Debug, Serialize, Deserialize)]
struct Circle {
    elevation: u32,
    untuned: f64,
    tuned: f64,
    /// The least difference at a view, tuned less untuned.
    worst: f64,
}

/// Measures the model in a file, unless that was done before with this build of the command.
pub(super) fn object(gsvx: &GsvxCommand, model: &Path) -> Result<Object> {
    let model = scenes::root().join(model);
    ensure!(model.is_file(), "{}: no such model", model.display());
    let name = scenes::name_of(&model);
    let dir = scenes::root().join("out/rd").join(&name);
    let inputs = (cache::hash_file(gsvx.path())?, cache::hash_file(&model)?);
    let cache = Cache::open(&dir.join("stages"), &inputs, false)?;
    let what = (CAMERAS, UNTUNED, ELEVATIONS, VIEWS, SIZE);
    cache.run("object", &what, || measure(gsvx, &model, &name, &dir))
}

fn measure(gsvx: &GsvxCommand, model: &Path, name: &str, dir: &Path) -> Result<Object> {
    println!("{name} ...");
    let [untuned, tuned] = ["untuned", "tuned"].map(|s| dir.join(s).with_extension("gsvx"));
    let orbit = format!("--orbit={CAMERAS}");
    let cost = gsvx.make(&[&"tune", &model, &orbit, &"--effort=quick"], &tuned)?;
    let renders = renders(model)?;
    let psnr_of = |stream: &Path| -> Result<f64> {
        Ok(measure::psnr_db(&gsvx::decode(&std::fs::read(stream)?)?, &renders))
    };
    let tuned_db = psnr_of(&tuned)?;
    let encoded = |quality: u8| -> Result<f64> {
        let words = format!("--quality={quality}");
        gsvx.make(&[&"encode", &model, &words, &"--no-estimate"], &untuned)?;
        psnr_of(&untuned)
    };
    let all: Vec<(u8, f64)> = UNTUNED.map(|q| Ok((q, encoded(q)?))).collect::<Result<_>>()?;
    let off = |db: f64| (db - tuned_db).abs();
    let nearest = all.into_iter().min_by(|a, b| off(a.1).total_cmp(&off(b.1)));
    let (untuned_quality, untuned_db) = nearest.context("qualities")?;
    encoded(untuned_quality)?;
    let views = |stream: &Path, elevation: u32| -> Result<Vec<f64>> {
        let elevation = elevation.to_string();
        let words: [&dyn AsRef<std::ffi::OsStr>; 10] = [
            &"compare",
            &model,
            &stream,
            &"--orbit",
            &VIEWS,
            &"--full-circle",
            &"--elevation",
            &elevation,
            &"--size",
            &SIZE,
        ];
        let said: Value = gsvx.run(&words)?.json()?;
        let all = said["views"].as_array().context("views")?;
        all.iter().map(|view| view["psnr"].as_f64().context("psnr")).collect()
    };
    let mut circles = Vec::new();
    for elevation in ELEVATIONS {
        let (before, after) = (views(&untuned, elevation)?, views(&tuned, elevation)?);
        let mean = |all: &[f64]| all.iter().sum::<f64>() / all.len() as f64;
        let worst = after.iter().zip(&before).map(|(a, b)| a - b).fold(f64::INFINITY, f64::min);
        circles.push(Circle { elevation, untuned: mean(&before), tuned: mean(&after), worst });
    }
    let bytes = |stream: &Path| Ok::<_, std::io::Error>(std::fs::metadata(stream)?.len());
    Ok(Object {
        name: name.to_owned(),
        untuned_bytes: bytes(&untuned)?,
        untuned_quality,
        bytes: bytes(&tuned)?,
        at_cameras: [untuned_db, tuned_db],
        user_seconds: cost.user,
        peak_mb: cost.peak_mb,
        circles,
    })
}

/// Renders of the model at the cameras of the tune.
fn renders(model: &Path) -> Result<Vec<TrainView>> {
    let scene = scenes::read_model(model)?;
    let covered = framing::cover(&scene, &Constraints::default(), CAMERAS, framing::SIZE, false);
    let cameras = covered.context("a model without a Gaussian")?.cameras;
    Ok(cameras.into_iter().map(|camera| TrainView::rendered(&scene, camera)).collect())
}

impl Object {
    /// What the table shows.
    pub(super) fn text(&self) -> String {
        let Self {
            name, bytes, untuned_bytes, untuned_quality, at_cameras: [untuned, tuned], ..
        } = self;
        format!(
            "Without photos: {name} as `gsvx tune --orbit {CAMERAS} --effort quick` makes it ({bytes} bytes, {:.1} CPU \
             minutes, {:.0} MB, {tuned:.2} dB from the model at the cameras of the tune) and as `gsvx encode --quality \
             {untuned_quality}` does ({untuned_bytes} bytes, {untuned:.2} dB). PSNR against renders of the model at \
             {VIEWS} views all around (`gsvx compare --full-circle --elevation E`), and the least difference at one of \
             them.",
            self.user_seconds / 60.0,
            self.peak_mb,
        )
    }

    pub(super) fn table(&self) -> Table {
        let mut table = Table::new("elevation | tuned, dB | untuned, dB | least difference, dB");
        for Circle { elevation, untuned, tuned, worst } in &self.circles {
            table.row(cells![
                format!("{elevation} degrees"),
                format!("{tuned:.2}"),
                format!("{untuned:.2}"),
                format!("{worst:+.2}"),
            ]);
        }
        table
    }
}

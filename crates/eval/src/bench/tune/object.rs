//! A model without photos, tuned to its own renders at generated cameras and looked at from all around.

use std::path::Path;

use anyhow::{Context, Result, ensure};
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::cache::{self, Cache};
use crate::cells;
use crate::page::Table;
use crate::process::GsvxCommand;
use crate::scenes;

/// Cameras that the tune generates.
const CAMERAS: &str = "32";
/// The stream without tuning that is about as good at these.
const UNTUNED_QUALITY: &str = "50";
/// Elevations of the circles that the streams are compared at, degrees, and views on each.
const ELEVATIONS: [u32; 2] = [8, 60];
const VIEWS: &str = "24";
const SIZE: &str = "320x240";

/// What was measured of a model.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct Object {
    name: String,
    untuned_bytes: u64,
    bytes: u64,
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
    let folder = model.parent().and_then(Path::file_name).unwrap_or_default().to_string_lossy();
    let stem = model.file_stem().unwrap_or_default().to_string_lossy();
    let name = if stem == "meta" { folder } else { stem };
    let dir = scenes::root().join("out/rd").join(&*name);
    let inputs = (cache::hash_file(gsvx.path())?, cache::hash_file(&model)?);
    let cache = Cache::open(&dir.join("stages"), &inputs, false)?;
    let what = (CAMERAS, UNTUNED_QUALITY, ELEVATIONS, VIEWS, SIZE);
    cache.run("object", &what, || measure(gsvx, &model, &name, &dir))
}

fn measure(gsvx: &GsvxCommand, model: &Path, name: &str, dir: &Path) -> Result<Object> {
    println!("{name} ...");
    let [untuned, tuned] = ["untuned", "tuned"].map(|s| dir.join(s).with_extension("gsvx"));
    gsvx.make(&[&"encode", &model, &"--quality", &UNTUNED_QUALITY, &"--no-estimate"], &untuned)?;
    let words: [&dyn AsRef<std::ffi::OsStr>; 6] =
        [&"tune", &model, &"--orbit", &CAMERAS, &"--effort", &"quick"];
    let cost = gsvx.make(&words, &tuned)?;
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
        bytes: bytes(&tuned)?,
        user_seconds: cost.user,
        peak_mb: cost.peak_mb,
        circles,
    })
}

impl Object {
    /// What the table shows.
    pub(super) fn text(&self) -> String {
        format!(
            "Without photos: {} as `gsvx tune --orbit {CAMERAS} --effort quick` makes it ({} bytes, {:.1} CPU minutes, \
             {:.0} MB) and as `gsvx encode --quality {UNTUNED_QUALITY}` does ({} bytes). PSNR against renders of the \
             model at {VIEWS} views all around (`gsvx compare --full-circle --elevation E`), and the least difference \
             at one of them.",
            self.name,
            self.bytes,
            self.user_seconds / 60.0,
            self.peak_mb,
            self.untuned_bytes,
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

//! What is lost at each quality without cameras, and what bounds on errors cost: the page from which the
//! default quality is chosen.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, Result, ensure};
use finetune::{Image, RenderOptions, TrainView, metrics, render};
use gs_model::Scene;
use gsvx::{EncodeOptions, MaxError};
use serde_json::Value;

use crate::command;
use crate::measure;
use crate::progress::Bar;
use crate::scenes::{self, TestScene};

/// What [`run`] measures.
#[derive(Clone, Debug)]
pub struct Options {
    /// Scenes with photos.
    pub scenes: Vec<String>,
    /// Folder of models without photos.
    pub models: PathBuf,
    /// The command, which makes viewpoints around these.
    pub gsvx: PathBuf,
    /// Where the page goes, relative to the root of the workspace.
    pub out: PathBuf,
}

/// Qualities in the first table.
const QUALITIES: [f32; 7] = [50.0, 60.0, 65.0, 70.0, 75.0, 80.0, 90.0];
/// Bounds in the second.
const BOUNDS: [f32; 5] = [0.1, 0.03, 0.01, 0.003, 0.001];
/// What the default must reach: renders against those of the input at the worst view, SSIM in the mean, and
/// the loss against photos, dB.
const ENOUGH_DB: f64 = 40.0;
const ENOUGH_SSIM: f64 = 0.99;
const MOST_LOST_DB: f64 = 0.2;

/// One model at one quality.
struct Row {
    model: String,
    quality: f32,
    bytes: u64,
    /// Against renders of the input: PSNR in the mean and at the worst view, mean SSIM.
    psnr: f64,
    worst: f64,
    ssim: f64,
    /// PSNR that is lost against the photos, where there are some.
    lost: Option<f64>,
}

impl Row {
    /// Whether nobody sees a difference, by the measure of the page.
    fn is_enough(&self) -> bool {
        self.worst >= ENOUGH_DB
            && self.ssim >= ENOUGH_SSIM
            && self.lost.is_none_or(|lost| lost <= MOST_LOST_DB)
    }

    fn line(&self) -> String {
        format!(
            "| {} | {:.0} | {} | {:.2} | {:.2} | {:.4} | {} | {} |\n",
            self.model,
            self.quality,
            self.bytes,
            self.psnr,
            self.worst,
            self.ssim,
            self.lost.map_or("-".into(), |lost| format!("{lost:.3}")),
            if self.is_enough() { "yes" } else { "no" },
        )
    }
}

/// Measures and writes the page.
///
/// # Errors
/// If the command is not there or fails, or a scene cannot be read.
pub fn run(options: &Options) -> Result<()> {
    let gsvx = command::find(&options.gsvx)?;
    let (mut rows, mut bounded) = (Vec::new(), String::new());
    for name in &options.scenes {
        let scene = Reference::open(name)?;
        for quality in QUALITIES {
            rows.push(scene.at_quality(quality)?);
        }
        bounded += &scene.bounded()?;
    }
    let models = scenes::root().join(&options.models);
    for model in model_files(&models)? {
        for quality in QUALITIES {
            rows.push(from_the_command(&gsvx, &model, quality)?);
        }
    }
    crate::page::write(&options.out, &page(&rows, &bounded), None)
}

/// The models of a folder, by name; none if it is not there.
fn model_files(folder: &Path) -> Result<Vec<PathBuf>> {
    let Ok(entries) = std::fs::read_dir(folder) else {
        println!("SKIPPED: {} is not there", folder.display());
        return Ok(Vec::new());
    };
    let mut files = Vec::new();
    for entry in entries {
        let path = entry?.path();
        let known = path.extension().is_some_and(|e| e == "ply" || e == "spz" || e == "splat");
        // Forms of one model that another file has too.
        let twin = path.with_extension("").with_extension("spz");
        if known && (path == twin || !twin.exists()) {
            files.push(path);
        }
    }
    files.sort();
    Ok(files)
}

/// A scene with photos, and the renders of its model.
struct Reference {
    name: String,
    model: Scene,
    held_out: Vec<TrainView>,
    renders: Vec<Image>,
    psnr: f64,
}

impl Reference {
    fn open(name: &str) -> Result<Self> {
        let TestScene { files, model, held_out, .. } = TestScene::open(name, usize::MAX)?;
        let (score, renders) = measure::score(&model, &held_out, &bar(&files.name, &held_out));
        Ok(Self { name: files.name, model, held_out, renders, psnr: score.psnr_db })
    }

    fn at_quality(&self, quality: f32) -> Result<Row> {
        let stream = gsvx::encode(&self.model, &EncodeOptions::from_quality(quality)?)?.bytes;
        let decoded = gsvx::decode(&stream)?;
        let (score, renders) =
            measure::score(&decoded, &self.held_out, &bar(&self.name, &self.held_out));
        let pairs = || renders.iter().zip(&self.renders);
        let dbs: Vec<f64> = pairs().map(|(a, b)| metrics::psnr(a, b)).collect();
        let ssims: f64 = pairs().map(|(a, b)| metrics::ssim(a, b)).sum();
        let row = Row {
            model: self.name.clone(),
            quality,
            bytes: stream.len() as u64,
            psnr: dbs.iter().sum::<f64>() / dbs.len().max(1) as f64,
            worst: dbs.iter().copied().fold(f64::INFINITY, f64::min),
            ssim: ssims / dbs.len().max(1) as f64,
            lost: Some(self.psnr - score.psnr_db),
        };
        print!("{}", row.line());
        Ok(row)
    }

    /// Rows of the second table.
    fn bounded(&self) -> Result<String> {
        let mut out = String::new();
        let mut row = |what: String, encoded: &gsvx::Encoded, told: String| -> Result<()> {
            let mut all = gsvx::DecodeOptions::default();
            all.max_gaussians = Some(u64::MAX);
            let decoded = gsvx::decode_with(&encoded.bytes, &all)?.scene;
            let view = |(v, reference): (&TrainView, &Image)| {
                metrics::psnr(&render(&decoded, &v.camera, &RenderOptions::default()), reference)
            };
            let db = self.held_out.iter().zip(&self.renders).map(view).sum::<f64>();
            let db = db / self.held_out.len().max(1) as f64;
            let bits = 8.0 * encoded.bytes.len() as f64 / self.model.len().max(1) as f64;
            let db = if db.is_finite() { format!("{db:.2}") } else { "equal".into() };
            let line = format!(
                "| {} | {what} | {} | {bits:.1} | {db} | {told} |\n",
                self.name,
                encoded.bytes.len()
            );
            print!("{line}");
            out += &line;
            Ok(())
        };
        let best = gsvx::encode(&self.model, &EncodeOptions::from_quality(100.0)?)?;
        row("quality 100".into(), &best, "no bound".into())?;
        for bound in BOUNDS {
            let mut options = EncodeOptions::default();
            options.max_error = Some(MaxError::all(bound));
            let encoded = gsvx::encode(&self.model, &options)?;
            let e = encoded.max_error.context("errors are measured")?;
            let told = format!("{:.1e}, {:.1e}, {:.1e}, {:.1e}", e.mean, e.opacity, e.shape, e.sh);
            row(format!("`--max-error {bound}`"), &encoded, told)?;
        }
        row("`--lossless`".into(), &gsvx::encode_lossless(&self.model, false)?, "0".into())?;
        Ok(out)
    }
}

fn bar(name: &str, views: &[TrainView]) -> Bar {
    Bar::new(&format!("render {name}"), views.len() as u64)
}

/// One model at one quality, at eight viewpoints that the command makes.
fn from_the_command(gsvx: &Path, model: &Path, quality: f32) -> Result<Row> {
    let dir = tempfile::tempdir().context("make a temporary folder")?;
    let stream = dir.path().join("a.gsvx");
    let json = |command: &mut Command| -> Result<Value> {
        let out = command.arg("--json").output().context("start gsvx")?;
        ensure!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
        Ok(serde_json::from_slice(&out.stdout)?)
    };
    let encoded = json(
        Command::new(gsvx)
            .args(["encode", "-q", &quality.to_string(), "-o"])
            .args([stream.as_path(), model]),
    )?;
    let compared =
        json(Command::new(gsvx).args(["compare", "--orbit", "8"]).args([model, stream.as_path()]))?;
    let number = |value: &Value| value.as_f64().unwrap_or(f64::INFINITY);
    let views = compared["views"].as_array().map(Vec::as_slice).unwrap_or_default();
    let name = model.file_name().unwrap_or_default().to_string_lossy();
    let row = Row {
        model: name.split('.').next().unwrap_or_default().to_owned(),
        quality,
        bytes: encoded["bytes"].as_u64().context("bytes")?,
        psnr: number(&compared["psnr"]),
        worst: views.iter().map(|v| number(&v["psnr"])).fold(f64::INFINITY, f64::min),
        ssim: compared["ssim"].as_f64().context("ssim")?,
        lost: None,
    };
    print!("{}", row.line());
    Ok(row)
}

fn page(rows: &[Row], bounded: &str) -> String {
    let enough = |q: &f32| rows.iter().filter(|r| r.quality == *q).all(Row::is_enough);
    let least = QUALITIES.into_iter().find(enough);
    let mut out = format!(
        "# What is lost?\n\n\
         `cargo build --release -p gsvx-cli && cargo xtask bench-quality`. Streams without cameras. PSNR and SSIM \
         are of renders of the stream against renders of the input: at the held-out views of scenes with photos, \
         at eight viewpoints around other models (`gsvx compare --orbit 8`). \"Lost\" is how much nearer the input \
         is to the photos than the stream.\n\n\
         The default quality is the lowest at which nobody should see a difference on any of these models: {ENOUGH_DB:.0} dB \
         or more at every view, an SSIM of {ENOUGH_SSIM} or more, and {MOST_LOST_DB} dB or less lost against photos. "
    );
    let _ = match least {
        Some(q) => write!(
            out,
            "Of the qualities measured, that is {q:.0}. The default is {:.0}.\n\n",
            gsvx::DEFAULT_QUALITY
        ),
        None => write!(out, "None of the qualities measured does it.\n\n"),
    };
    out += "| model | quality | bytes | PSNR dB | worst view dB | SSIM | lost dB | enough |\n\
            |---|---:|---:|---:|---:|---:|---:|---:|\n";
    rows.iter().for_each(|row| out += &row.line());
    out += "\n## Between the best quality and lossless\n\n\
            `--max-error` merges no Gaussian and bounds the error of every attribute. The errors are the largest \
            in the stream: of means (in standard deviations along the longest axis), opacities, shapes (norm of \
            the difference of the logarithms) and SH coefficients. PSNR is the mean over the held-out views, \
            against renders of the input.\n\n\
            | model | setting | bytes | bit/Gaussian | PSNR dB | largest errors |\n\
            |---|---|---:|---:|---:|---|\n";
    out += bounded;
    out
}

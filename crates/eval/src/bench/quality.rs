//! What is lost at each quality without cameras, and what bounds on errors cost: the page from which the
//! default quality is chosen.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use finetune::{Image, TrainView, metrics};
use gs_model::Scene;
use gsvx::{EncodeOptions, MaxError};
use serde_json::Value;

use crate::cells;
use crate::measure;
use crate::page::{Page, Table};
use crate::process::GsvxCommand;
use crate::progress::Bar;
use crate::scenes::{self, TestScene};

/// Flags of `cargo xtask bench-quality`.
#[derive(Clone, Debug, clap::Args)]
pub struct QualityOptions {
    /// Scenes with photos
    #[arg(default_values_t = ["room", "fox", "bonsai"].map(String::from))]
    scenes: Vec<String>,
    /// Folder of models without photos
    #[arg(long, default_value = "../shared/models")]
    models: PathBuf,
    /// Where the page goes
    #[arg(long, default_value = "docs/results/quality.md")]
    out: PathBuf,
}

/// Qualities in the first table.
const QUALITIES: [f32; 4] = [50.0, 75.0, 80.0, 90.0];
/// Bounds in the second.
const BOUNDS: [f32; 3] = [0.1, 0.01, 0.001];
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

    fn cells(&self) -> Vec<String> {
        cells![
            self.model,
            self.quality,
            self.bytes,
            format!("{:.2}", self.psnr),
            format!("{:.2}", self.worst),
            format!("{:.4}", self.ssim),
            self.lost.map_or("-".into(), |lost| format!("{lost:.3}")),
            if self.is_enough() { "yes" } else { "no" },
        ]
    }
}

/// Measures and writes the page.
///
/// # Errors
/// If the command is not there or fails, or a scene cannot be read.
pub fn run(options: &QualityOptions) -> Result<()> {
    let gsvx = GsvxCommand::find()?;
    let mut rows = Vec::new();
    let mut table =
        Table::new("model | quality | bytes | PSNR dB | worst view dB | SSIM | lost dB | enough");
    let mut bounded = Table::new("model | setting | bytes | bit/Gaussian | PSNR dB");
    let mut add = |row: Row| {
        table.told(row.cells());
        rows.push(row);
    };
    for name in &options.scenes {
        let scene = Reference::open(name)?;
        QUALITIES.into_iter().try_for_each(|q| scene.at_quality(q).map(&mut add))?;
        scene.bounded(&mut bounded)?;
    }
    for model in model_files(&scenes::root().join(&options.models))? {
        for quality in QUALITIES {
            add(from_the_command(&gsvx, &model, quality)?);
        }
    }
    let enough = |q: &f32| rows.iter().filter(|r| r.quality == *q).all(Row::is_enough);
    let least = match QUALITIES.into_iter().find(enough) {
        Some(q) => format!(
            "Of the qualities measured, that is {q}. The default is {}.",
            gsvx::DEFAULT_QUALITY
        ),
        None => "None of the qualities measured does it.".into(),
    };
    let mut page = Page::new(&options.out, "What is lost?");
    page.text(
        "`cargo xtask bench-quality`. Streams without cameras. PSNR and SSIM \
         compare renders of the stream with renders of the input: at the held-out views of scenes with photos, at eight \
         viewpoints around other models. \"Lost\" is how far the PSNR against the photos falls below that of the \
         input.",
    );
    page.text(format!(
        "The default quality is the lowest that is \"enough\" on all these models: {ENOUGH_DB} dB or more at every \
         view, an SSIM of {ENOUGH_SSIM} or more, and {MOST_LOST_DB} dB or less lost against photos. {least}"
    ));
    page.table(&table);
    page.text("## Between the best quality and lossless");
    page.text(
        "`--max-error` merges no Gaussian and bounds the error of every attribute ([accuracy.md](../accuracy.md)). \
         PSNR is the mean over the held-out views, against renders of the input.",
    );
    page.table(&bounded);
    page.write()
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
        let (score, renders) = measure::score(&model, &held_out, &Bar::hidden());
        Ok(Self { name: files.name, model, held_out, renders, psnr: score.psnr_db })
    }

    /// PSNR of a scene against the photos, and of each of its renders against that of the model; mean SSIM.
    fn compare(&self, scene: &Scene) -> (f64, Vec<f64>, f64) {
        let (score, renders) = measure::score(scene, &self.held_out, &Bar::hidden());
        let pairs = || renders.iter().zip(&self.renders);
        let ssims: f64 = pairs().map(|(a, b)| metrics::ssim(a, b)).sum();
        let dbs = pairs().map(|(a, b)| metrics::psnr(a, b)).collect();
        (score.psnr_db, dbs, ssims / renders.len().max(1) as f64)
    }

    fn at_quality(&self, quality: f32) -> Result<Row> {
        let stream = gsvx::encode(&self.model, &EncodeOptions::from_quality(quality)?)?.bytes;
        let (psnr, dbs, ssim) = self.compare(&gsvx::decode(&stream)?);
        Ok(Row {
            model: self.name.clone(),
            quality,
            bytes: stream.len() as u64,
            psnr: dbs.iter().sum::<f64>() / dbs.len().max(1) as f64,
            worst: dbs.iter().copied().fold(f64::INFINITY, f64::min),
            ssim,
            lost: Some(self.psnr - psnr),
        })
    }

    /// Rows of the second table.
    fn bounded(&self, table: &mut Table) -> Result<()> {
        let mut row = |what: String, encoded: &gsvx::Encoded| -> Result<()> {
            let mut all = gsvx::DecodeOptions::default();
            all.max_gaussians = Some(u64::MAX);
            let (_, dbs, _) = self.compare(&gsvx::decode_with(&encoded.bytes, &all)?.scene);
            let db = dbs.iter().sum::<f64>() / dbs.len().max(1) as f64;
            let db = if db.is_finite() { format!("{db:.2}") } else { "equal".into() };
            let bits = 8.0 * encoded.bytes.len() as f64 / self.model.len().max(1) as f64;
            let bits = format!("{bits:.1}");
            table.told(cells![self.name, what, encoded.bytes.len(), bits, db]);
            Ok(())
        };
        let best = gsvx::encode(&self.model, &EncodeOptions::from_quality(100.0)?)?;
        row("quality 100".into(), &best)?;
        for bound in BOUNDS {
            let mut options = EncodeOptions::default();
            options.max_error = Some(MaxError::all(bound));
            row(format!("`--max-error {bound}`"), &gsvx::encode(&self.model, &options)?)?;
        }
        row("`--lossless`".into(), &gsvx::encode_lossless(&self.model, false)?)
    }
}

/// One model at one quality, at eight viewpoints that the command makes.
fn from_the_command(gsvx: &GsvxCommand, model: &Path, quality: f32) -> Result<Row> {
    let dir = tempfile::tempdir().context("make a temporary folder")?;
    let stream = dir.path().join("a.gsvx");
    let q = quality.to_string();
    let encoded: Value = gsvx.make(&[&"encode", &"-q", &q, &model], &stream)?.json()?;
    let compared: Value = gsvx.run(&[&"compare", &"--orbit", &"8", &model, &stream])?.json()?;
    let number = |value: &Value| value.as_f64().unwrap_or(f64::INFINITY);
    let views = compared["views"].as_array().map(Vec::as_slice).unwrap_or_default();
    let name = model.file_name().unwrap_or_default().to_string_lossy();
    Ok(Row {
        model: name.split('.').next().unwrap_or_default().to_owned(),
        quality,
        bytes: encoded["bytes"].as_u64().context("bytes")?,
        psnr: number(&compared["psnr"]),
        worst: views.iter().map(|v| number(&v["psnr"])).fold(f64::INFINITY, f64::min),
        ssim: compared["ssim"].as_f64().context("ssim")?,
        lost: None,
    })
}

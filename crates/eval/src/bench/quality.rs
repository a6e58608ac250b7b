//! What is lost at each quality without cameras, and what bounds on errors cost: the page from which the
//! default quality is chosen.

use std::ffi::OsStr;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use serde_json::Value;

use crate::cells;
use crate::measure;
use crate::page::{Page, Table};
use crate::process::GsvxCommand;
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
const QUALITIES: [u8; 4] = [50, 75, 80, 90];
/// Settings in the second.
const SETTINGS: [&str; 5] =
    ["--quality=100", "--max-error=0.1", "--max-error=0.01", "--max-error=0.001", "--lossless"];
/// What the default must reach: PSNR and SSIMULACRA2 of renders against those of the input at the worst view, SSIM in
/// the mean, and the loss against photos, dB.
const ENOUGH_DB: f64 = 40.0;
const ENOUGH_SSIM: f64 = 0.99;
/// By its scale, a high quality; at 90 no difference is seen side by side at a normal distance.
const ENOUGH_SSIMULACRA2: f64 = 70.0;
const MOST_LOST_DB: f64 = 0.2;

/// What is coded, and what its streams are compared at.
struct Model {
    name: String,
    path: PathBuf,
    /// Words of `gsvx compare`.
    views: Vec<String>,
    /// The scene whose photos the model was trained on, and the PSNR of the model against those held out.
    photos: Option<(TestScene, f64)>,
}

/// A stream beside its model.
struct Loss {
    bytes: u64,
    gaussians: f64,
    /// Against renders of the input: PSNR in the mean and at the worst view, mean SSIM.
    psnr: f64,
    worst: f64,
    ssim: f64,
    /// SSIMULACRA2 in the mean and at the worst view.
    ssimulacra2: [f64; 2],
    /// PSNR that is lost against the photos, where there are some.
    lost: Option<f64>,
}

impl Loss {
    /// Whether nobody sees a difference, by the measure of the page.
    fn is_enough(&self) -> bool {
        self.worst >= ENOUGH_DB
            && self.ssim >= ENOUGH_SSIM
            && self.ssimulacra2[1] >= ENOUGH_SSIMULACRA2
            && self.lost.is_none_or(|lost| lost <= MOST_LOST_DB)
    }
}

/// Measures and writes the page.
///
/// # Errors
/// If the command is not there or fails, or a scene cannot be read.
pub fn run(options: &QualityOptions) -> Result<()> {
    let gsvx = GsvxCommand::find()?;
    let scenes = options.scenes.iter().map(|name| Model::with_photos(name));
    let files = model_files(&scenes::root().join(&options.models))?;
    let models: Vec<Model> = scenes
        .chain(files.into_iter().map(|path| Ok(Model::alone(path))))
        .collect::<Result<_>>()?;
    let mut table = Table::new(
        "model | quality | bytes | PSNR dB | worst view dB | SSIM | SSIMULACRA2 | worst view | lost dB | enough",
    );
    let mut enough = QUALITIES.map(|_| true);
    for model in &models {
        for (quality, enough) in QUALITIES.iter().zip(&mut enough) {
            let loss = model.coded(&gsvx, &format!("--quality={quality}"))?;
            *enough &= loss.is_enough();
            table.told(cells![
                model.name,
                quality,
                loss.bytes,
                format!("{:.2}", loss.psnr),
                format!("{:.2}", loss.worst),
                format!("{:.4}", loss.ssim),
                format!("{:.2}", loss.ssimulacra2[0]),
                format!("{:.2}", loss.ssimulacra2[1]),
                loss.lost.map_or("-".into(), |lost| format!("{lost:.3}")),
                if loss.is_enough() { "yes" } else { "no" },
            ]);
        }
    }
    let mut bounded = Table::new("model | setting | bytes | bit/Gaussian | PSNR dB");
    for model in models.iter().filter(|m| m.photos.is_some()) {
        for setting in SETTINGS {
            let loss = model.coded(&gsvx, setting)?;
            let bits = format!("{:.1}", 8.0 * loss.bytes as f64 / loss.gaussians.max(1.0));
            let db = format!("{:.2}", loss.psnr);
            bounded.told(cells![model.name, format!("`{setting}`"), loss.bytes, bits, db]);
        }
    }
    let least = QUALITIES.iter().zip(enough).find(|(_, enough)| *enough);
    let least = least.map_or("none".into(), |(quality, _)| quality.to_string());
    let mut page = Page::new(&options.out, "What is lost?");
    page.text(
        "`cargo xtask bench-quality`. Streams without cameras. PSNR, SSIM and SSIMULACRA2 compare renders of the stream with renders \
         of the input (`gsvx compare`): at the held-out views of scenes with photos, at eight viewpoints around other \
         models. \"Lost\" is how far the PSNR against the photos falls below that of the input.",
    );
    page.text(format!(
        "The default quality is the lowest that is \"enough\" on all these models: {ENOUGH_DB} dB and an \
         SSIMULACRA2 of {ENOUGH_SSIMULACRA2} (high quality, by its scale) or more at every view, an SSIM of {ENOUGH_SSIM} \
         or more, and {MOST_LOST_DB} dB or less lost against photos. Of the qualities measured, that is {least}. The default is {}.",
        ::gsvx::DEFAULT_QUALITY
    ));
    page.table(&table);
    page.text("## Between the best quality and lossless");
    page.text(
        "`--max-error` merges no Gaussian and bounds the error of every attribute ([accuracy.md](../accuracy.md)).",
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

impl Model {
    fn with_photos(name: &str) -> Result<Self> {
        let test = TestScene::open(name, usize::MAX)?;
        let db = measure::psnr_db(&test.model, &test.held_out);
        let dataset = &test.files.dataset;
        let views = vec![format!("--cameras={}", dataset.dir.display()), "--every=8".into()];
        let (name, path) = (name.to_owned(), dataset.model_path.clone());
        Ok(Self { name, path, views, photos: Some((test, db)) })
    }

    fn alone(path: PathBuf) -> Self {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        let name = name.split('.').next().unwrap_or_default().to_owned();
        Self { name, path, views: vec!["--orbit=8".into()], photos: None }
    }

    /// Codes the model by the command at a setting, and compares the stream.
    fn coded(&self, gsvx: &GsvxCommand, setting: &str) -> Result<Loss> {
        let dir = tempfile::tempdir().context("make a temporary folder")?;
        let stream = dir.path().join("a.gsvx");
        gsvx.make(&[&"encode", &"--no-estimate", &setting, &self.path], &stream)?;
        let words: [&dyn AsRef<OsStr>; 3] = [&"compare", &self.path, &stream];
        let views = self.views.iter().map(|w| w as &dyn AsRef<OsStr>);
        let compared = gsvx.run(&words.into_iter().chain(views).collect::<Vec<_>>())?;
        let compared: Value = compared.json()?;
        // Equal pictures have none.
        let db = |of: &Value| of["psnr"].as_f64().unwrap_or(f64::INFINITY);
        let third = |of: &Value| of["ssimulacra2"].as_f64().unwrap_or(f64::NAN);
        let views = compared["views"].as_array().map(Vec::as_slice).unwrap_or_default();
        let bytes = std::fs::read(&stream)?;
        let scene = ::gsvx::decode(&bytes)?;
        let lost = |(test, db): &(TestScene, f64)| db - measure::psnr_db(&scene, &test.held_out);
        Ok(Loss {
            bytes: bytes.len() as u64,
            gaussians: compared["gaussians"][0].as_f64().context("gaussians")?,
            psnr: db(&compared),
            worst: views.iter().map(db).fold(f64::INFINITY, f64::min),
            ssim: compared["ssim"].as_f64().context("ssim")?,
            ssimulacra2: [third(&compared), views.iter().map(third).fold(f64::INFINITY, f64::min)],
            lost: self.photos.as_ref().map(lost),
        })
    }
}

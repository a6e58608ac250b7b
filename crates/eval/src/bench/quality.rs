//! What is lost at each quality without cameras, and what bounds on errors cost: the page from which the
//! default quality is chosen.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result};

use crate::measure;
use crate::page::{Page, Table, number};
use crate::process::GsvxCommand;
use crate::record::Record;
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
    let mut worst = QUALITIES.map(|_| Worst::default());
    for model in &models {
        for (quality, worst) in QUALITIES.iter().zip(&mut worst) {
            let (Record { bytes, score, .. }, lost) =
                model.coded(&gsvx, &format!("--quality={quality}"))?;
            let (db, worst_db) = (score.psnr_db, score.worst(|v| v.psnr_db));
            let (third, worst_third) = (score.ssimulacra2, score.worst(|v| v.ssimulacra2));
            let is_enough = worst_db >= ENOUGH_DB
                && score.ssim >= ENOUGH_SSIM
                && worst_third >= ENOUGH_SSIMULACRA2
                && lost.is_none_or(|lost| lost <= MOST_LOST_DB);
            worst.add([worst_db, score.ssim, worst_third], lost, is_enough);
            let (ssim, lost) = (score.ssim, number(lost, 3));
            let (name, says) = (&model.name, if is_enough { "yes" } else { "no" });
            table.told(format!(
                "{name} | {quality} | {bytes} | {db:.2} | {worst_db:.2} | {ssim:.4} | {third:.2} | {worst_third:.2} | \
                 {lost} | {says}"
            ));
        }
    }
    let mut bounded = Table::new(format!("bytes, dB | `{}`", SETTINGS.join("` | `")));
    for model in models.iter().filter(|m| m.photos.is_some()) {
        let mut row = model.name.clone();
        for setting in SETTINGS {
            let (record, _) = model.coded(&gsvx, setting)?;
            row += &format!(" | {}, {:.2}", record.bytes, record.score.psnr_db);
        }
        bounded.told(row);
    }
    let all = models.len();
    let least = QUALITIES.iter().zip(&worst).find(|(_, worst)| worst.enough == all);
    let least = least.map_or("none".into(), |(quality, _)| quality.to_string());
    let mut page = Page::new(&options.out, "What is lost?");
    page.text(
        "`cargo xtask bench-quality`: streams without cameras, their renders against those of the input: at held-out views, or at eight viewpoints around models without photos. \"Lost\": PSNR against photos, below that of the input.",
    );
    page.text(format!(
        "The default quality is the lowest of these that is \"enough\" on all models: {ENOUGH_DB} dB and an \
         SSIMULACRA2 of {ENOUGH_SSIMULACRA2} at every view, an SSIM of {ENOUGH_SSIM} \
         and at most {MOST_LOST_DB} dB lost: {least}. The default is {}.",
        ::gsvx::DEFAULT_QUALITY
    ));
    let mut summary = Table::new(
        "quality | worst view dB | least SSIM | worst SSIMULACRA2 | most lost dB | enough on",
    );
    for (quality, Worst { scores: [db, ssim, third], lost, enough }) in QUALITIES.iter().zip(worst)
    {
        summary.row(format!(
            "{quality} | {db:.2} | {ssim:.4} | {third:.2} | {lost:.3} | {enough} of {all}"
        ));
    }
    page.table(&summary);
    page.data("Each model:", table);
    page.text("## Between the best quality and lossless");
    page.text(
        "`--max-error` merges no Gaussian and bounds the error of every attribute ([accuracy.md](../accuracy.md)).",
    );
    page.table(&bounded);
    page.write()
}

/// The worst of all models at a quality, and how many of them it is enough for.
struct Worst {
    /// PSNR of a view, SSIM, SSIMULACRA2 of a view.
    scores: [f64; 3],
    lost: f64,
    enough: usize,
}

impl Default for Worst {
    fn default() -> Self {
        Self { scores: [f64::INFINITY; 3], lost: f64::NEG_INFINITY, enough: 0 }
    }
}

impl Worst {
    fn add(&mut self, scores: [f64; 3], lost: Option<f64>, is_enough: bool) {
        self.scores.iter_mut().zip(scores).for_each(|(worst, score)| *worst = worst.min(score));
        self.lost = lost.map_or(self.lost, |lost| self.lost.max(lost));
        self.enough += usize::from(is_enough);
    }
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
        // Of a model in several formats, only the SPZ file is taken.
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

    /// A stream of the command at a setting, beside renders of the input; and the PSNR that is lost against the photos,
    /// where there are some.
    fn coded(&self, gsvx: &GsvxCommand, setting: &str) -> Result<(Record, Option<f64>)> {
        let dir = tempfile::tempdir().context("make a temporary folder")?;
        let stream = dir.path().join("a.gsvx");
        let mut command = gsvx.words(["encode", "--no-estimate", setting]);
        gsvx.make(command.arg(&self.path), &stream)?;
        let score = gsvx.compare(&self.path, &stream, &self.views)?;
        let bytes = std::fs::read(&stream)?;
        let scene = ::gsvx::decode(&bytes)?;
        let lost = |(test, db): &(TestScene, f64)| db - measure::psnr_db(&scene, &test.held_out);
        let bytes = bytes.len() as u64;
        let record = Record { bytes, score, ..Record::default() };
        Ok((record, self.photos.as_ref().map(lost)))
    }
}

//! `cargo xtask bench-real-size`: models of a million Gaussians, coded and tuned.
//!
//! A stream takes minutes. What was measured stays recorded for one build of the command.

use std::ffi::OsStr;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use finetune::TrainView;
use gs_model::dataset::{HOLD_OUT_EVERY, open_views};
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::cache::{self, Cache};
use crate::page::{Page, Table};
use crate::peers::lgsc;
use crate::process::GsvxCommand;
use crate::progress::Bar;
use crate::{cells, manifest, measure, scenes};

/// Flags of `cargo xtask bench-real-size`.
#[derive(Clone, Debug, clap::Args)]
pub struct RealSizeOptions {
    /// Models, as MODEL or SCENE:MODEL with the scene of the photos
    #[arg(default_values_t = DEFAULT.map(String::from))]
    models: Vec<String>,
    /// Efforts of the tunes
    #[arg(long, value_delimiter = ',', default_values_t = ["quick", "normal"].map(String::from))]
    efforts: Vec<String>,
    /// Where the page goes
    #[arg(long, default_value = "docs/results/real-size.md")]
    out: PathBuf,
}

const DEFAULT: [&str; 2] =
    ["office:out/train/office.ply", "../shared/models/la_fontaine/meta.json"];
/// Qualities of the untuned streams that are encoded with cameras.
const WITH_CAMERAS: [u32; 4] = [20, 35, 50, 80];
/// Generated cameras of a tune without photos, and those that its streams are compared at.
const TUNE_ORBIT: &str = "--orbit=32";
const COMPARE_ORBIT: [&str; 4] =
    ["--orbit=24", "--full-circle", "--elevation=20", "--size=640x480"];

/// A model, and what its streams are compared with.
struct Model {
    name: String,
    path: PathBuf,
    photos: Option<Photos>,
}

/// Photos of a scene.
struct Photos {
    scene: String,
    dir: PathBuf,
    held_out: Vec<TrainView>,
}

/// What was measured of a file of a model.
#[derive(Clone, Debug, Serialize, Deserialize)]
struct Coded {
    bytes: u64,
    /// Not of the model itself, where it is compared with its own renders.
    quality: Option<[f64; 2]>,
    cost: Option<Cost>,
}

/// What a command took.
#[derive(Clone, Debug, Serialize, Deserialize)]
struct Cost {
    wall: f64,
    user: f64,
    peak_mb: f64,
}

/// Measures and writes the page.
///
/// # Errors
/// If the command or a model is not there, or something cannot be read.
pub fn run(options: &RealSizeOptions) -> Result<()> {
    let gsvx = GsvxCommand::find()?;
    let models = options.models.iter().map(|word| Model::open(word)).collect::<Result<Vec<_>>>()?;
    let mut page = Page::new(&options.out, "Real size?");
    page.text(format!(
        "`cargo xtask bench-real-size {} --efforts {}` runs whole commands of gsvx, files included. {}. Seconds are wall \
         clock; CPU are the user seconds of all threads.",
        options.models.join(" "),
        options.efforts.join(","),
        manifest::machine(),
    ));
    for model in &models {
        let (text, table) = model.table(&gsvx, &options.efforts)?;
        page.text(text);
        page.table(&table);
    }
    page.text(
        "L-GSC has as many steps of position along an axis for any model. Some Gaussians of office lie 70,000 units away, \
         so a step along z is half a unit at level 0 and two units at level 2. The size of L-GSC is that of streams \
         written here; its time is not measured.",
    );
    page.text("How time and memory grow with the number of Gaussians: [speed.md](speed.md).");
    page.write()
}

impl Model {
    /// `word` is as on the command line.
    fn open(word: &str) -> Result<Self> {
        let (scene, path) = match word.split_once(':') {
            Some((scene, path)) => (Some(scene), path),
            None => (None, word),
        };
        let path = scenes::root().join(path);
        let hint = scene.map(|s| format!("; `cargo xtask train {s} --cap 1000000` makes one"));
        ensure!(path.is_file(), "{}: no such model{}", path.display(), hint.unwrap_or_default());
        let photos = scene.map(Photos::open).transpose()?;
        Ok(Self { name: scenes::name_of(&path), path, photos })
    }

    /// The files of the model that are measured: name and words of the command, in the table's order.
    fn files(&self, efforts: &[String]) -> Vec<(String, Vec<String>)> {
        let words = |all: &[&str]| all.iter().map(ToString::to_string).collect::<Vec<_>>();
        let cameras = self.photos.as_ref().map(|p| format!("--cameras={}", p.dir.display()));
        let mut files = vec![
            ("PLY".to_owned(), words(&["convert", "--force"])),
            ("SPZ v4".to_owned(), words(&["convert", "--force"])),
            ("L-GSC, level 0".to_owned(), words(&["lgsc", "0"])),
            ("L-GSC, level 2".to_owned(), words(&["lgsc", "2"])),
            ("`gsvx encode`".to_owned(), words(&["encode", "--no-estimate"])),
            ("`gsvx encode -q 45`".to_owned(), words(&["encode", "--no-estimate", "-q45"])),
        ];
        if let Some(cameras) = &cameras {
            for quality in WITH_CAMERAS {
                let words = words(&["encode", "--no-estimate", cameras, &format!("-q{quality}")]);
                files.push((format!("`gsvx encode --cameras -q {quality}`"), words));
            }
        }
        for effort in efforts {
            let views = cameras.as_deref().unwrap_or(TUNE_ORBIT);
            let name = format!("`gsvx tune --effort {effort}`");
            files.push((name, words(&["tune", &format!("--effort={effort}"), views])));
        }
        files
    }

    fn table(&self, gsvx: &GsvxCommand, efforts: &[String]) -> Result<(String, Table)> {
        let dir = scenes::root().join("out/rd").join(&self.name);
        let inputs = (cache::hash_file(gsvx.path())?, cache::hash_file(&self.path)?);
        let cache = Cache::open(&dir.join("stages"), &inputs, false)?;
        let mut table = Table::new("file | MB | PSNR, dB | SSIM | seconds | CPU | peak MB");
        for (name, words) in self.files(efforts) {
            println!("{}: {name} ...", self.name);
            let extension = match &*name {
                _ if words[0] == "lgsc" => "ply",
                "PLY" => "ply",
                "SPZ v4" => "spz",
                _ => "gsvx",
            };
            let file = dir.join("real-size").with_extension(extension);
            let judge = (self.photos.as_ref().map(|p| p.held_out.len()), COMPARE_ORBIT);
            let what = (&words, extension, judge);
            let coded: Coded =
                cache.run("real-size", &what, || self.measure(gsvx, &words, &file))?;
            table.row(coded.row(&name));
        }
        let compared = match &self.photos {
            Some(Photos { scene, held_out, .. }) => format!(
                "Against {} held-out photos of {scene}. `cargo xtask train {scene} --cap 1000000` trains such a model.",
                held_out.len()
            ),
            None => format!(
                "Against renders of the model (`gsvx compare {}`).",
                COMPARE_ORBIT.join(" ")
            ),
        };
        Ok((format!("**{}.** {compared}", self.name), table))
    }

    /// Makes a file and compares it.
    fn measure(&self, gsvx: &GsvxCommand, words: &[String], file: &Path) -> Result<Coded> {
        if let [word, level] = words
            && word == "lgsc"
        {
            let level = lgsc::LEVELS[level.parse::<usize>()?];
            let (stream, decoded) = lgsc::code(&scenes::read_model(&self.path)?, level)?;
            gs_model::ply::write(file, &decoded)?;
            let quality = self.quality(gsvx, file)?;
            return Ok(Coded { bytes: stream.len() as u64, quality: Some(quality), cost: None });
        }
        let mut all: Vec<&dyn AsRef<OsStr>> = words.iter().map(|w| w as _).collect();
        all.push(&self.path);
        let done = match words[0].as_str() {
            "convert" => gsvx.run(&[&all[..], &[&file]].concat())?,
            _ => gsvx.make(&all, file)?,
        };
        let bytes = std::fs::metadata(file)?.len();
        // The model itself.
        let is_ply = file.extension().is_some_and(|e| e == "ply");
        let compared = !is_ply || self.photos.is_some();
        let quality = compared.then(|| self.quality(gsvx, file)).transpose()?;
        let cost = Cost { wall: done.wall, user: done.user, peak_mb: done.peak_mb };
        Ok(Coded { bytes, quality, cost: (!is_ply).then_some(cost) })
    }

    /// PSNR and SSIM of a file against the photos, or against renders of the model.
    fn quality(&self, gsvx: &GsvxCommand, file: &Path) -> Result<[f64; 2]> {
        if let Some(photos) = &self.photos {
            return photos.quality(file);
        }
        let words: Vec<&dyn AsRef<OsStr>> = vec![&"compare", &self.path, &file];
        let orbit = COMPARE_ORBIT.iter().map(|w| w as &dyn AsRef<OsStr>);
        let said: Value = gsvx.run(&words.into_iter().chain(orbit).collect::<Vec<_>>())?.json()?;
        let number = |key: &str| said[key].as_f64().with_context(|| format!("no {key}"));
        Ok([number("psnr")?, number("ssim")?])
    }
}

impl Photos {
    fn open(scene: &str) -> Result<Self> {
        let dir = scenes::dir_of(scene)?;
        let views = open_views(&dir)?;
        let held_out = measure::load(views.iter().step_by(HOLD_OUT_EVERY))?;
        Ok(Self { scene: scene.to_owned(), dir, held_out })
    }

    /// PSNR and SSIM of the model in a file.
    fn quality(&self, file: &Path) -> Result<[f64; 2]> {
        let bar = Bar::new("render", self.held_out.len() as u64);
        let (score, _) = measure::score(&scenes::read_model(file)?, &self.held_out, &bar);
        bar.done();
        Ok([score.psnr_db, score.ssim])
    }
}

impl Coded {
    fn row(&self, name: &str) -> Vec<String> {
        let number = |value: Option<f64>, digits: usize| {
            value.map_or("-".to_owned(), |v| format!("{v:.digits$}"))
        };
        let cost = self.cost.as_ref();
        cells![
            name,
            format!("{:.2}", self.bytes as f64 / 1e6),
            number(self.quality.map(|q| q[0]), 2),
            number(self.quality.map(|q| q[1]), 3),
            number(cost.map(|c| c.wall), 1),
            number(cost.map(|c| c.user), 1),
            number(cost.map(|c| c.peak_mb), 0),
        ]
    }
}

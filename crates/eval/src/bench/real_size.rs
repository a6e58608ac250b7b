//! `cargo xtask bench-real-size`: models of a million Gaussians, coded and tuned.
//!
//! A stream takes minutes. What was measured stays recorded for one build of the command.

use std::path::{Path, PathBuf};

use anyhow::{Result, ensure};
use finetune::TrainView;
use gs_model::dataset::{HOLD_OUT_EVERY, open_views};

use crate::cache::{self, Cache};
use crate::measure::{self, Score};
use crate::page::{Page, Table, number};
use crate::peers::lgsc;
use crate::process::{self, GsvxCommand, NO_LIMIT, Usage};
use crate::record::Record;
use crate::{manifest, scenes};

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

/// Measures and writes the page.
///
/// # Errors
/// If the command or a model is not there, or something cannot be read.
pub fn run(options: &RealSizeOptions) -> Result<()> {
    let gsvx = GsvxCommand::find()?;
    let models = options.models.iter().map(|word| Model::open(word)).collect::<Result<Vec<_>>>()?;
    let mut page = Page::new(&options.out, "Real size?");
    page.text(format!(
        "`cargo xtask bench-real-size {} --efforts {}`. {}.",
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
        "L-GSC has equally many steps of position for any model. Some Gaussians of office lie 70,000 units away, so a step along z is half a unit at level 0, two at level 2.",
    );
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

    /// The files of the model that are measured: name, extension, and words of the command, in the table's order.
    fn files(&self, efforts: &[String]) -> Vec<(String, &'static str, Vec<String>)> {
        let cameras = self.photos.as_ref().map(|p| format!("--cameras={}", p.dir.display()));
        let mut files = Vec::new();
        let mut add = |name: &str, extension, words: &str, views: Option<&str>| {
            let words = words.split(' ').chain(views).map(str::to_owned).collect();
            files.push((name.to_owned(), extension, words));
        };
        add("PLY", "ply", "convert --force", None);
        add("SPZ v4", "spz", "convert --force", None);
        add("L-GSC, level 0", "ply", "lgsc 0", None);
        add("L-GSC, level 2", "ply", "lgsc 2", None);
        add("`gsvx encode`", "gsvx", "encode --no-estimate", None);
        add("`gsvx encode -q 45`", "gsvx", "encode --no-estimate -q45", None);
        if cameras.is_some() {
            for quality in WITH_CAMERAS {
                let name = format!("`gsvx encode --cameras -q {quality}`");
                let words = format!("encode --no-estimate -q{quality}");
                add(&name, "gsvx", &words, cameras.as_deref());
            }
        }
        for effort in efforts {
            let (name, words) =
                (format!("`gsvx tune --effort {effort}`"), format!("tune --effort={effort}"));
            add(&name, "gsvx", &words, Some(cameras.as_deref().unwrap_or(TUNE_ORBIT)));
        }
        files
    }

    fn table(&self, gsvx: &GsvxCommand, efforts: &[String]) -> Result<(String, Table)> {
        let dir = scenes::root().join("out/rd").join(&self.name);
        let inputs = (cache::hash_file(&gsvx.0)?, cache::hash_file(&self.path)?);
        let cache = Cache::open(&dir.join("stages"), &inputs, false)?;
        let mut table =
            Table::new("file | MB | PSNR, dB | SSIM | SSIMULACRA2 | seconds | CPU | peak MB");
        for (name, extension, words) in self.files(efforts) {
            println!("{}: {name} ...", self.name);
            let file = dir.join("real-size").with_extension(extension);
            let judge = (self.photos.as_ref().map(|p| p.held_out.len()), COMPARE_ORBIT);
            let what = (&words, extension, judge);
            let record: Record =
                cache.run("real-size", &what, || self.measure(gsvx, &words, &file))?;
            let Record { bytes, score, encode: Usage { wall, user, peak_mb }, .. } = record;
            // What takes no time was not measured.
            let needed = |x: f64, decimals| number(Some(x).filter(|_| wall > 0.0), decimals);
            let (needs, peak) =
                ([wall, user].map(|s| needed(s, 1)).join(" | "), needed(peak_mb, 0));
            let (mb, db) = (bytes as f64 / 1e6, number(score.psnr_db, 2));
            let (ssim, ssimulacra2) = (number(score.ssim, 3), number(score.ssimulacra2, 1));
            table.row(format!(
                "{name} | {mb:.2} | {db} | {ssim} | {ssimulacra2} | {needs} | {peak}"
            ));
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

    /// Makes a file and compares it with the photos, or with renders of the model.
    fn measure(&self, gsvx: &GsvxCommand, words: &[String], file: &Path) -> Result<Record> {
        let is_ply = file.extension().is_some_and(|e| e == "ply");
        let (mut bytes, mut encode) = (0, Usage::default());
        if words[0] == "lgsc" {
            let level = lgsc::LEVELS[words[1].parse::<usize>()?];
            let (stream, decoded) = lgsc::code(&scenes::read_model(&self.path)?, level)?;
            gs_model::ply::write(file, &decoded)?;
            bytes = stream.len() as u64;
        } else {
            let mut command = gsvx.words(words);
            command.arg(&self.path);
            let output = match words[0].as_str() {
                "convert" => process::run(command.arg(file), NO_LIMIT)?,
                _ => gsvx.make(&mut command, file)?,
            };
            if !is_ply {
                encode = output.usage;
            }
        }
        let score = match &self.photos {
            Some(photos) => {
                measure::score(&self.name, &scenes::read_model(file)?, &photos.held_out)
            }
            // The model itself.
            None if is_ply && bytes == 0 => Score::default(),
            None => gsvx.compare(&self.path, file, &COMPARE_ORBIT.map(String::from))?,
        };
        if bytes == 0 {
            bytes = std::fs::metadata(file)?.len();
        }
        Ok(Record { bytes, score, encode, ..Record::default() })
    }
}

impl Photos {
    fn open(scene: &str) -> Result<Self> {
        let dir = scenes::dir_of(scene)?;
        let views = open_views(&dir)?;
        let held_out = measure::load(views.iter().step_by(HOLD_OUT_EVERY))?;
        Ok(Self { scene: scene.to_owned(), dir, held_out })
    }
}

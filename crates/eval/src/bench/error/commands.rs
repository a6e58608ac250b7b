//! Whole commands: seconds against the PSNR of renders.

use std::path::Path;

use anyhow::{Context, Result};

use super::Family;
use crate::measure;
use crate::page::number;
use crate::process::GsvxCommand;
use crate::study::Study;

/// The quality of the tunes, and of the stream that they are compared with.
const TUNED: &str = "--quality=58";

pub(super) fn families(study: &Study) -> Result<Vec<Family>> {
    let dataset = &study.test.files.dataset;
    let folder = dataset.dir.display();
    let bench = Bench {
        gsvx: GsvxCommand::find()?,
        study,
        model: &dataset.model_path,
        cameras: format!("--cameras={folder}"),
        views: vec![format!("--cameras={folder}"), "--every=8".into()],
        dir: tempfile::tempdir().context("make a temporary folder")?,
    };
    Ok(vec![bench.encode()?, bench.tune()?, bench.decode()?])
}

struct Bench<'a> {
    gsvx: GsvxCommand,
    study: &'a Study,
    model: &'a Path,
    cameras: String,
    /// Words of `gsvx compare`.
    views: Vec<String>,
    dir: tempfile::TempDir,
}

/// PSNR of equal pictures in the chart, dB.
const EQUAL: f64 = 100.0;

impl Bench<'_> {
    fn encode(&self) -> Result<Family> {
        let about = "PSNR against renders of the input.";
        let mut family = Family::new("Encode", about, "bytes | PSNR, dB");
        for (words, buys) in [
            ("--no-estimate --quality=30", "the fewest of use"),
            ("--no-estimate --quality=50", "web pages"),
            ("--no-estimate --quality=65", "half the steps"),
            ("--no-estimate", "again: the default quality, 80"),
            ("", "the estimate of the loss"),
            ("CAMERAS --no-estimate", "bits go where they show"),
            ("CAMERAS", "with the estimate"),
            ("--no-estimate --quality=95", "half the steps of 80"),
            ("--max-error=0.01", "a bound on every error"),
            ("--lossless", "every float"),
        ] {
            let stream = self.dir.path().join("a.gsvx");
            let mut command = self.gsvx.words(["encode"]);
            let words = words.replace("CAMERAS", &self.cameras);
            command.args(words.split_whitespace()).arg(self.model);
            let seconds = self.gsvx.make(&mut command, &stream)?.usage.wall;
            let db = self.gsvx.compare(self.model, &stream, &self.views)?.psnr_db.min(EQUAL);
            let words = words.replace(&self.cameras, "--cameras");
            let words = if words.is_empty() { "no flag".into() } else { format!("`{words}`") };
            let bytes = std::fs::metadata(&stream)?.len();
            family.row(&words, seconds, db, &format!("{bytes} | {}", number(db, 2)), buys);
        }
        Ok(family)
    }

    fn tune(&self) -> Result<Family> {
        let about = "PSNR against the held-out photos.";
        let mut family = Family::new("Tune", about, "bytes | PSNR, dB");
        family.is_drawn = false;
        for (words, buys) in [
            ("encode --drop-unseen --no-estimate", "the stream to beat"),
            ("tune --effort=quick", "fewer Gaussians, fitted to photos"),
            ("tune", "more steps"),
        ] {
            let stream = self.dir.path().join("b.gsvx");
            let mut command = self.gsvx.words(words.split(' '));
            command.args([TUNED, &self.cameras]).arg(self.model);
            let seconds = self.gsvx.make(&mut command, &stream)?.usage.wall;
            let bytes = std::fs::read(&stream)?;
            let db = measure::psnr_db(&gsvx::decode(&bytes)?, &self.study.test.held_out);
            let cells = format!("{} | {}", bytes.len(), number(db, 2));
            family.row(&format!("`{words} {TUNED}`"), seconds, db, &cells, buys);
        }
        Ok(family)
    }

    fn decode(&self) -> Result<Family> {
        let about = "A stream with levels of detail, to a PLY.";
        let mut family = Family::new("Decode", about, "Gaussians | PSNR, dB");
        let stream = self.dir.path().join("c.gsvx");
        let mut command = self.gsvx.words(["encode", "--lod", "--no-estimate"]);
        self.gsvx.make(command.arg(self.model), &stream)?;
        for (words, buys) in [
            ("--lod=255", "a first picture"),
            ("--max-sh-degree=0", "no view dependence"),
            ("--max-sh-degree=1", "SH of degree 1"),
            ("--max-sh-degree=2", "SH of degree 2"),
            ("", "all of the stream"),
        ] {
            let model = self.dir.path().join("c.ply");
            let mut command = self.gsvx.words(["decode"]);
            command.args(words.split_whitespace()).arg(&stream);
            let seconds = self.gsvx.make(&mut command, &model)?.usage.wall;
            let db = self.gsvx.compare(self.model, &model, &self.views)?.psnr_db;
            let (scene, _) = gs_model::ply::read(&model)?;
            let words = if words.is_empty() { "no flag".into() } else { format!("`{words}`") };
            family.row(&words, seconds, db, &format!("{} | {}", scene.len(), number(db, 2)), buys);
        }
        Ok(family)
    }
}

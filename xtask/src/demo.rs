//! `cargo xtask demo`: a folder for any web host, with a page that shows streams of a scene, untuned and tuned.
//!
//! The page is `demo.html` of `crates/gsvx-web/npm/viewer`; the streams lie beside it.

use std::io::{BufRead as _, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use anyhow::{Context, Result, ensure};
use eval::scenes::{self, DEFAULT};
use serde_json::{Map, Value, json};
use xshell::{Shell, cmd};

use crate::npm;

/// Of the stream that stands for the model as trained: differences are hard to see.
const UNTUNED_QUALITY: &str = "90";
/// The lowest of docs/results/tune.md at which a quick tune comes within 0.3 dB of the model on each scene.
const TUNED_QUALITY: &str = "66";

/// Arguments of `demo`.
#[derive(clap::Args, Debug)]
pub(crate) struct DemoArgs {
    /// A name in crates/eval/scenes.toml, or a folder.
    #[arg(default_value = DEFAULT)]
    scene: String,
    /// Folder to write, from the root of this repository.
    #[arg(long, default_value = "out/demo")]
    out: PathBuf,
}

/// Writes the folder and says what to do with it.
pub(crate) fn run(args: &DemoArgs) -> Result<()> {
    let out = scenes::root().join(&args.out);
    make(&args.scene, &out)?;
    let out = out.display();
    println!("{out}: for any web host, or `python3 -m http.server --directory {out}`");
    Ok(())
}

/// Writes the page and both streams of a scene into a folder.
pub(crate) fn make(scene: &str, out: &Path) -> Result<()> {
    npm::needed()?;
    let files = scenes::find(scene)?;
    let sh = Shell::new()?;
    sh.create_dir(out)?;
    let (model, cameras) = (files.dataset.model_path.as_path(), &files.dataset.dir);
    let gsvx = eval::gsvx_command()?;
    let stream = |words: &[&str], cameras: &[&Path], name: &str| -> Result<Value> {
        let stream = out.join(name);
        let command =
            cmd!(sh, "{gsvx} --json {words...} {model} --web --force -o {stream} {cameras...}");
        let report = command.quiet().read()?;
        serde_json::from_str(&report).context("the report of gsvx is no JSON")
    };
    let original = stream(&["encode", "--quality", UNTUNED_QUALITY], &[], "original.gsvx")?;
    let tune = ["tune", "--effort", "quick", "--quality", TUNED_QUALITY];
    let tuned = stream(&tune, &[Path::new("--cameras"), cameras], "tuned.gsvx")?;
    let facts = json!({
        "name": files.name,
        "plyBytes": model.metadata()?.len(),
        "original": {
            "file": "original.gsvx", "bytes": original["bytes"], "quality": original["quality"],
            "psnr": original["estimated_loss"]["psnr"],
        },
        "tuned": {
            "file": "tuned.gsvx", "bytes": tuned["bytes"], "quality": tuned["quality"], "psnr": tuned["psnr"],
            "modelPsnr": tuned["input_psnr"],
        },
        "start": start(&gsvx, model)?,
    });
    npm::page("viewer/demo.mjs", &[out, Path::new(&facts.to_string())])
}

/// The camera at which `gsvx view` starts, out of the address that it prints.
fn start(gsvx: &Path, model: &Path) -> Result<Value> {
    let mut command = Command::new(gsvx);
    command.args(["--json", "view", "--no-open"]).arg(model).stdout(Stdio::piped());
    let mut server = command.spawn().with_context(|| format!("start {}", gsvx.display()))?;
    let mut line = String::new();
    let read = server.stdout.take().map(|out| BufReader::new(out).read_line(&mut line));
    server.kill()?;
    server.wait()?;
    read.transpose()?;
    let report: Value = serde_json::from_str(&line).context("gsvx view says no address")?;
    camera(report["url"].as_str().unwrap_or_default())
}

/// The camera in an address of `gsvx view`, as the page takes it.
fn camera(url: &str) -> Result<Value> {
    let mut start = Map::new();
    for (name, value) in url.split('&').filter_map(|part| part.split_once('=')) {
        let numbers: Vec<f64> = value.split(',').filter_map(|number| number.parse().ok()).collect();
        match name {
            "up" | "eye" | "ahead" => start.insert(name.into(), json!(numbers)),
            "angle" => start.insert(name.into(), json!(numbers.first())),
            _ => None,
        };
    }
    ensure!(start.len() == 4, "gsvx view finds no camera: {url}");
    Ok(start.into())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_page_starts_at_the_camera_of_gsvx_view() {
        let url =
            "http://127.0.0.1:1/?url=/file/0/a.ply&up=0,0,1&eye=1.5,-2,0&ahead=0,1,0&angle=40.5";
        let start = json!({ "up": [0.0, 0.0, 1.0], "eye": [1.5, -2.0, 0.0], "ahead": [0.0, 1.0, 0.0], "angle": 40.5 });
        assert_eq!(camera(url).unwrap(), start);
        assert!(camera("http://127.0.0.1:1/?url=/file/0/a.ply").is_err());
    }
}

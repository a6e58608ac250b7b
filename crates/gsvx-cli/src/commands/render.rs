//! `gsvx render`.

use crate::exit::usage;
use crate::format::is_stream_name;
use crate::input::ReadingAny;
use crate::output::{Output, counted, is_stdio, make_folder};
use crate::progress::Meter;
use crate::report::Reporter;
use crate::views::{Origin, PlacedCameras, WhichViews};
use crate::{pictures, size};
use anyhow::{Result, bail};
use finetune::{RenderOptions, render};
use gs_model::{Camera, Format};
use serde_json::json;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

pub(crate) const EXAMPLES: &str = "\
Examples:
  gsvx render scene.gsvx --cameras data/fox -o views            one PNG per camera
  gsvx render model.ply --cameras data/fox --every 8 -o held-out
  gsvx render scene.gsvx --orbit 24 --size 800x600 -o turn
  gsvx render scene.gsvx --orbit 1 -o view.png";

#[derive(clap::Args)]
pub(crate) struct RenderArgs {
    /// A stream or a model of any format; `-` for standard input.
    input: PathBuf,
    /// Folder for the PNGs (made if it is not there), or with a single view a file called .png;
    /// `-` for standard output.
    #[arg(short, long)]
    output: PathBuf,
    #[command(flatten)]
    views: WhichViews,
    /// Background colour: red, green, blue from 0 to 1.
    #[arg(long, value_name = "R,G,B", default_value = "0,0,0", value_parser = colour)]
    background: [f32; 3],
    #[command(flatten)]
    reading: ReadingAny,
    /// Replace existing images.
    #[arg(long)]
    force: bool,
}

fn colour(text: &str) -> Result<[f32; 3], String> {
    let within = |colour: &[f32; 3]| colour.iter().all(|v| (0.0..=1.0).contains(v));
    let colour = size::list(text, ',').filter(within);
    colour.ok_or_else(|| "use R,G,B with three numbers from 0 to 1".into())
}

/// Renders a model.
pub(crate) fn run(args: &RenderArgs, report: Reporter) -> Result<()> {
    let single = is_single(&args.output)?;
    let (scene, _) = args.reading.any(&args.input)?;
    let PlacedCameras { cameras, origin } = args.views.cameras(&scene, &args.input)?;
    let options = RenderOptions { background: args.background, ..Default::default() };
    if single && cameras.len() > 1 {
        let n = cameras.len();
        let name = args.output.display();
        return Err(usage(format!(
            "{name}: a single image, but there are {n} views; name a folder"
        )));
    }
    let open = |path: &Path| Output::open(path, args.force, &[&args.input]);
    let outputs = if single {
        vec![open(&args.output)?]
    } else {
        let names = file_names(&cameras)?;
        make_folder(&args.output)?;
        // All are opened before the first is drawn: a conflict loses no work.
        names.iter().map(|name| open(&args.output.join(name))).collect::<Result<Vec<_>>>()?
    };
    let stdout = outputs.iter().any(Output::is_stdout);
    let names: Vec<String> = outputs.iter().map(Output::name).collect();
    let steps = Meter::new("render", cameras.len());
    for (camera, output) in cameras.iter().zip(outputs) {
        pictures::write(&render(&scene, camera, &options), output)?;
        steps.inc();
    }
    drop(steps);
    let mut human = format!(
        "{}: {} of {}",
        args.output.display(),
        counted(names.len(), "image"),
        counted(scene.len(), "Gaussian")
    );
    if let Some(origin) = &origin {
        human += &format!("\n{}", origin.human());
    }
    let cameras = origin.as_ref().map(Origin::json);
    let json = json!({ "images": names, "gaussians": scene.len(), "cameras": cameras });
    report.say(stdout, &human, &json)
}

/// True if the output is one image, false if it is a folder.
fn is_single(output: &Path) -> Result<bool> {
    let name = output.display();
    let extension = output.extension().and_then(|e| e.to_str()).unwrap_or_default();
    match extension.to_ascii_lowercase().as_str() {
        "png" => Ok(true),
        "jpg" | "jpeg" | "webp" | "tif" | "tiff" | "bmp" => {
            Err(usage(format!("{name}: images are written as PNG; name it .png, or name a folder")))
        }
        _ if is_stream_name(output) || Format::of_name(output).is_some() => {
            Err(usage(format!("{name}: render writes images; name it .png, or name a folder")))
        }
        // A device takes one image.
        _ => Ok(is_stdio(output) || std::fs::metadata(output).is_ok_and(|m| !m.is_dir())),
    }
}

/// A file name per camera: the photo's, with `.png`.
fn file_names(cameras: &[Camera]) -> Result<Vec<String>> {
    let mut seen = BTreeSet::new();
    cameras
        .iter()
        .map(|camera| match pictures::stem(&camera.name).map(|stem| format!("{stem}.png")) {
            Some(name) if seen.insert(name.to_lowercase()) => Ok(name),
            _ => bail!("camera {:?}: its name gives no file name of its own", camera.name),
        })
        .collect()
}

//! `gsvx render`.

use crate::output::{Output, is_stdio};
use crate::report::Reporter;
use crate::views::ViewArgs;
use crate::{input, progress};
use anyhow::{Context, Result, bail};
use finetune::{Image, RenderOptions, render};
use gs_model::Camera;
use serde_json::json;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// Shown after the help.
pub(crate) const EXAMPLES: &str = "\
Examples:
  gsvx render scene.gsvx --cameras data/fox -o views            one PNG per camera
  gsvx render model.ply --cameras data/fox --every 8 -o held-out
  gsvx render scene.gsvx --orbit 24 --size 800x600 -o turn
  gsvx render scene.gsvx --orbit 1 -o view.png";

/// Arguments of `gsvx render`.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// A stream, PLY, .splat or SPZ; `-` for standard input.
    input: PathBuf,
    /// Folder for the PNGs (made if it is not there), or with a single view a file called .png;
    /// `-` for standard output.
    #[arg(short, long)]
    output: PathBuf,
    #[command(flatten)]
    views: ViewArgs,
    /// Background colour: red, green, blue from 0 to 1.
    #[arg(long, value_name = "R,G,B", value_delimiter = ',', num_args = 1, default_values_t = [0.0, 0.0, 0.0])]
    background: Vec<f32>,
    /// Leave out Gaussians with NaN, infinity or a zero quaternion instead of failing.
    #[arg(long)]
    drop_invalid: bool,
    /// Replace existing images.
    #[arg(long)]
    force: bool,
}

/// Renders a model.
pub(crate) fn run(args: &Args, report: Reporter) -> Result<()> {
    let Ok(background) = <[f32; 3]>::try_from(args.background.as_slice()) else {
        bail!("--background: three numbers, red, green, blue");
    };
    let scene = input::any(&args.input, args.drop_invalid)?;
    let cameras = args.views.cameras(&scene)?;
    let options = RenderOptions { background, ..Default::default() };
    let single = is_stdio(&args.output)
        || args.output.extension().is_some_and(|e| e.eq_ignore_ascii_case("png"));
    if single && cameras.len() > 1 {
        let n = cameras.len();
        bail!("{}: a single image, but there are {n} views; name a folder", args.output.display());
    }
    let outputs = if single {
        vec![Output::open(&args.output, args.force)?]
    } else {
        let names = file_names(&cameras)?;
        std::fs::create_dir_all(&args.output)
            .with_context(|| format!("{}: cannot be made", args.output.display()))?;
        // All are opened before the first is drawn: a conflict loses no work.
        names
            .iter()
            .map(|name| Output::open(&args.output.join(name), args.force))
            .collect::<Result<Vec<_>>>()?
    };
    let stdout = outputs.iter().any(Output::is_stdout);
    let names: Vec<String> = outputs.iter().map(Output::name).collect();
    let bar = progress::bar("render", cameras.len() as u64);
    for (camera, output) in cameras.iter().zip(outputs) {
        let image = render(&scene, camera, &options);
        output.write(|out| png(&image, out))?;
        bar.inc(1);
    }
    bar.finish_and_clear();
    let human =
        format!("{}: {} images of {} Gaussians", args.output.display(), names.len(), scene.len());
    report.say(stdout, &human, &json!({ "images": names, "gaussians": scene.len() }));
    Ok(())
}

/// A file name per camera: the photo's, with `.png`.
fn file_names(cameras: &[Camera]) -> Result<Vec<String>> {
    let mut seen = BTreeSet::new();
    cameras
        .iter()
        .map(|camera| {
            // Photos may lie in folders of their own: a/b.jpg becomes a-b.png.
            let stem = Path::new(&camera.name).with_extension("");
            let parts: Vec<String> = stem
                .components()
                .filter_map(|c| match c {
                    std::path::Component::Normal(part) => Some(part.to_string_lossy().into_owned()),
                    _ => None,
                })
                .collect();
            let name = format!("{}.png", parts.join("-"));
            if parts.is_empty() || !seen.insert(name.clone()) {
                bail!("camera {:?}: its name gives no file name of its own", camera.name);
            }
            Ok(name)
        })
        .collect()
}

fn png(image: &Image, out: &mut dyn std::io::Write) -> Result<()> {
    use image::ImageEncoder;
    let encoder = image::codecs::png::PngEncoder::new(out);
    let rgb = image.to_rgb8();
    Ok(encoder.write_image(&rgb, image.width, image.height, image::ExtendedColorType::Rgb8)?)
}

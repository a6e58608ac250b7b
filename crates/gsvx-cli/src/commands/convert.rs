//! `gsvx convert`.

use crate::commands::encode;
use crate::exit::{note, usage};
use crate::input::{self, Axes, ReadingAny};
use crate::output::{Output, OutputFolder, Written, counted, parent};
use crate::report::Reporter;
use crate::{content, doubts, format, glb, size, views};
use anyhow::{Context, Result, bail};
use gs_model::spz::{self, ShBits};
use gs_model::{Format, Scene, sog};
use indicatif::DecimalBytes;
use serde_json::json;
use std::path::{Path, PathBuf};

pub(crate) fn more() -> String {
    format!("{EXAMPLES}\n\n{}\n{AXES}", format::table())
}

const EXAMPLES: &str = "\
Examples:
  gsvx convert model.ply model.spz
  gsvx convert model.ply small.spz --spz-sh-bits 5,4    as Niantic's packer does by default
  gsvx convert niantic.spz model.ply --axes keep        an SPZ made by Niantic's ply_to_spz
  gsvx convert scene.gsvx scene.splat
  gsvx convert old.spz - --to ply > new.ply
  gsvx convert scene.gsvx scene.glb                     glTF, as three.js and others read it
  gsvx convert scene.gsvx small.glb --compress          glTF that holds the stream
  gsvx convert scene.sog scene.compressed.ply
  gsvx convert model.ply model.sog                      SOG, as PlayCanvas and SuperSplat read it
  gsvx convert model.ply folder/meta.json               the same as files in a folder
  gsvx convert folder/meta.json model.ply               an unbundled SOG
  gsvx convert model.ply small.ply --gaussians 500k     fewer Gaussians, merged where that shows least
  cat a.splat | gsvx convert - a.ply --from splat";

/// The name of the format whose axes are not always turned.
const SPZ: &str = "spz";
/// The name of the format that may be several files.
const SOG: &str = "sog";
/// The name of the format that may hold a stream.
const GLB: &str = "glb";

const AXES: &str = "\
To write a gsvx stream, use gsvx encode. OpenUSD (.usd) is read and written in Python: gsvx.from_usd, gsvx.to_usd.

With --compress a .glb holds a gsvx stream in the extension GSVX_gaussian_splatting_compression. gsvx
reads such files wherever it reads models; three.js needs the plugin gsvx/gltf of the npm package.

Axes of SPZ: its specification has y up and z back, PLY models have y down and z forward. gsvx turns
the model around whenever it reads or writes SPZ, so that it stands upright in viewers that follow the
specification. Niantic's own ply_to_spz and spz_to_ply copy the numbers without turning. A model that
went through one of them stands on its head after the other kind of tool; --axes keep leaves the
numbers as they are, as Niantic's tools do, read or written. A file that declares its axes
(SPZ_ADOBE_coordinate_system) is turned from those.";

#[derive(clap::Args)]
pub(crate) struct ConvertArgs {
    /// A model of any format, or a stream; `-` for standard input.
    input: PathBuf,
    /// The file to write; `-` for standard output. With the name meta.json, a SOG of several files, all in its folder.
    output: PathBuf,
    /// Format of the output [default: by its extension].
    #[arg(long, value_name = "FORMAT", value_parser = format::written())]
    to: Option<&'static Format>,
    /// Put a gsvx stream into the .glb: the input as it is if it is one, else the input encoded.
    #[arg(long)]
    compress: bool,
    /// With --compress, quality of a model that is encoded, from 0 to 100 [default: 80]. More choices: gsvx encode,
    /// then this command.
    #[arg(short, long, requires = "compress", value_parser = content::quality)]
    quality: Option<f32>,
    /// Merge to at most so many Gaussians, without coding: 200000, 500k, 1.2M.
    ///
    /// What costs least to merge goes first. What no rasterizer draws is left out. The order of the Gaussians changes. A
    /// model that has no more is written as it is.
    #[arg(long, value_name = "N", value_parser = size::count, allow_hyphen_values = true, conflicts_with = "compress")]
    gaussians: Option<u64>,
    /// With --gaussians: cameras of the training photos. What they see stays fine, and some of what they do not see is
    /// left out.
    #[arg(long, value_name = "PATH", requires = "gaussians")]
    cameras: Option<PathBuf>,
    /// Bits per SH coefficient in SPZ: of degree 1, of degrees 2 and 3.
    #[arg(long, value_name = "N,M", value_parser = sh_bits, default_value = "8,8")]
    spz_sh_bits: ShBits,
    #[command(flatten)]
    reading: ReadingAny,
    /// Replace an existing output.
    #[arg(long)]
    force: bool,
}

fn sh_bits(text: &str) -> Result<ShBits, String> {
    match size::list(text, ',') {
        Some([degree_1, rest]) if [degree_1, rest].iter().all(|bits| (1..=8).contains(bits)) => {
            Ok(ShBits { degree_1, rest })
        }
        _ => Err("use N,M with 1 to 8 each".into()),
    }
}

/// Where a model goes.
enum To {
    File(Output),
    /// A SOG of several files.
    Folder(OutputFolder),
}

/// Converts a model.
pub(crate) fn run(args: &ConvertArgs, report: Reporter) -> Result<()> {
    let is_folder = args.output.file_name().is_some_and(|name| name == sog::META);
    let asked = args.to.or(if is_folder { Format::named(SOG) } else { None });
    let format = format::of_output(asked, &args.output, None)?;
    if args.compress && format.name != GLB {
        let name = args.output.display();
        return Err(usage(format!("{name}: only a .glb holds a stream; leave out --compress")));
    }
    let to = match is_folder && format.name == SOG {
        true => To::Folder(OutputFolder::open(parent(&args.output), args.force)?),
        false => To::File(Output::open(&args.output, args.force, &[&args.input])?),
    };
    let (mut notes, mut were) = (Vec::new(), None);
    let (written, gaussians, sh_degree) = match to {
        To::File(output) if args.compress => {
            let stream = glb::stream(&args.reading, &args.input, args.quality, &mut notes)?;
            glb::write(output, &stream)?
        }
        to => {
            let (mut scene, file) = args.reading.any(&args.input)?;
            notes = file.sentences();
            if let Some(most) = args.gaussians {
                were = Some(scene.len());
                scene = fewer(args, scene, most)?;
            }
            if format.name == SPZ && args.reading.model.axes == Axes::Keep {
                // Writing SPZ turns the scene again, back to the axes that it had.
                spz::turn(&mut scene);
            }
            let sh_degree = scene.sh_degree.min(format.max_sh_degree);
            (write(args, format, to, &scene)?, scene.len(), sh_degree)
        }
    };
    let of = were.filter(|&n| n > gaussians).map_or(String::new(), |n| format!(" of {n}"));
    let human = format!("{}{of}, {}", counted(gaussians, "Gaussian"), DecimalBytes(written.bytes));
    let json = json!({
        "input_gaussians": were.unwrap_or(gaussians),
        "gaussians": gaussians,
        "sh_degree": sh_degree,
        "bytes": written.bytes,
        "notes": notes,
    });
    report.wrote(&written, &human, json)
}

/// A scene of at most so many Gaussians.
fn fewer(args: &ConvertArgs, scene: Scene, most: u64) -> Result<Scene> {
    let (name, n) = (input::name(&args.input), scene.len());
    let most = usize::try_from(most).unwrap_or(usize::MAX);
    if n <= most {
        note(format_args!(
            "{name}: has {}, no more than asked for; none is merged",
            counted(n, "Gaussian")
        ));
        return Ok(scene);
    }
    let (photos, placed) = views::with_photos(args.cameras.as_deref(), &scene)?;
    let cameras = placed.map(|placed| placed.cameras);
    let meters = encode::meters(cameras.as_deref());
    let made = tune::decimate(&scene, most, cameras.as_deref(), &photos, meters);
    let path = args.cameras.as_deref().unwrap_or(Path::new(""));
    let made = match made {
        Err(error @ tune::Error::NothingSeen) => bail!("{}: {error}", path.display()),
        other => other.with_context(|| name.clone())?,
    };
    made.doubts.iter().for_each(|doubt| doubts::warn_with(path, doubt, ""));
    let invisible = scene.drawn().map_or(0, |drawn| n - drawn.len());
    if invisible > 0 {
        note(format_args!("{name}: {}", content::transparent(invisible)));
    }
    Ok(made.scene)
}

/// Writes a model.
fn write(args: &ConvertArgs, format: &Format, to: To, scene: &Scene) -> Result<Written> {
    let output = match to {
        To::Folder(folder) => return write_files(args, format, folder, scene),
        To::File(output) if format.name != SPZ => return format::write(format, output, scene),
        To::File(output) => output,
    };
    let name = output.name();
    let written =
        output.write(|out| Ok(out.write_all(&spz::pack(&name, scene, args.spz_sh_bits)?)?))?;
    format::say_losses(&name, format, scene);
    Ok(written)
}

/// Writes a SOG of several files.
fn write_files(
    args: &ConvertArgs,
    format: &Format,
    mut folder: OutputFolder,
    scene: &Scene,
) -> Result<Written> {
    let name = args.output.display().to_string();
    let mut bytes = 0;
    for (file, content) in sog::files(&name, scene)? {
        bytes += folder.write(file, &[&args.input], |out| Ok(out.write_all(&content)?))?;
    }
    folder.put_in_place()?;
    format::say_losses(&name, format, scene);
    Ok(Written { name, bytes, stdout: false })
}

//! `gsvx convert`.

use crate::format;
use crate::input::ReadingAny;
use crate::output::{Output, counted, megabytes};
use crate::report::Reporter;
use anyhow::Result;
use clap::ValueEnum;
use gs_model::Format;
use gs_model::spz::{self, ShBits};
use serde_json::json;
use std::path::PathBuf;

/// Shown after the help.
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
  gsvx convert scene.sog scene.compressed.ply
  gsvx convert folder/meta.json model.ply               an unbundled SOG
  cat a.splat | gsvx convert - a.ply --from splat";

const AXES: &str = "\
To write a gsvx stream, use gsvx encode.

Axes of SPZ: its specification has y up and z back, PLY models have y down and z forward. gsvx turns
the model around whenever it reads or writes SPZ, so that it stands upright in viewers that follow the
specification. Niantic's own ply_to_spz and spz_to_ply copy the numbers without turning. A model that
went through one of them stands on its head after the other kind of tool; --axes keep leaves the
numbers as they are, as Niantic's tools do.";

/// Arguments of `gsvx convert`.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// A model of any format, or a stream; `-` for standard input.
    input: PathBuf,
    /// The file to write; `-` for standard output.
    output: PathBuf,
    /// Format of the output [default: by its extension].
    #[arg(long, value_name = "FORMAT", value_parser = format::written())]
    to: Option<&'static Format>,
    /// Bits per SH coefficient in SPZ: of degree 1, of degrees 2 and 3.
    #[arg(long, value_name = "N,M", value_parser = sh_bits, default_value = "8,8")]
    spz_sh_bits: ShBits,
    /// What is done about the axes of SPZ, read or written.
    #[arg(long, value_name = "HOW", default_value = "turn")]
    axes: Axes,
    #[command(flatten)]
    reading: ReadingAny,
    /// Replace an existing output.
    #[arg(long)]
    force: bool,
}

/// What is done about the axes of SPZ files.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Axes {
    /// Turned between SPZ (y up) and the other formats (y down), as SPZ's specification asks.
    Turn,
    /// Numbers stay as they are, as in Niantic's ply_to_spz and spz_to_ply.
    Keep,
}

fn sh_bits(text: &str) -> std::result::Result<ShBits, String> {
    let parsed = text.split_once(',').and_then(|(a, b)| Some((a.parse().ok()?, b.parse().ok()?)));
    match parsed {
        Some((a, b)) if (1..=8).contains(&a) && (1..=8).contains(&b) => {
            Ok(ShBits { degree_1: a, rest: b })
        }
        _ => Err("use N,M with 1 to 8 each".into()),
    }
}

/// Converts a model.
pub(crate) fn run(args: &Args, report: Reporter) -> Result<()> {
    let format = format::of_output(args.to, &args.output, None)?;
    let output = Output::open(&args.output, args.force, &[&args.input])?;
    let loaded = args.reading.any(&args.input)?;
    let is_spz = |name: &str| name == "spz";
    // Each of reading and writing SPZ has turned the scene once, or is about to.
    let read = loaded.report.as_ref().is_some_and(|r| is_spz(r.format));
    let mut scene = loaded.scene;
    if args.axes == Axes::Keep && read != is_spz(format.name) {
        spz::turn(&mut scene);
    }
    let (name, stdout) = (output.name(), output.is_stdout());
    let bytes = if is_spz(format.name) {
        output.write(|out| Ok(out.write_all(&spz::pack(&name, &scene, args.spz_sh_bits)?)?))?
    } else {
        format::write(format, output, &scene)?
    };
    let human =
        format!("{name}: {}, {}", counted(scene.len() as u64, "Gaussian"), megabytes(bytes));
    let json = json!({
        "output": name,
        "gaussians": scene.len(),
        "sh_degree": scene.sh_degree.min(format.max_sh_degree),
        "bytes": bytes,
    });
    report.say(stdout, &human, &json)
}

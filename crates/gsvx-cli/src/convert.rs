//! `gsvx convert`.

use crate::format;
use crate::input::ReadingAny;
use crate::output::{Output, counted};
use crate::report::Reporter;
use crate::size;
use anyhow::Result;
use clap::ValueEnum;
use gs_model::Format;
use gs_model::spz::{self, ShBits};
use indicatif::DecimalBytes;
use serde_json::json;
use std::path::PathBuf;

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

/// The name of the format that has other axes.
const SPZ: &str = "spz";

const AXES: &str = "\
To write a gsvx stream, use gsvx encode.

Axes of SPZ: its specification has y up and z back, PLY models have y down and z forward. gsvx turns
the model around whenever it reads or writes SPZ, so that it stands upright in viewers that follow the
specification. Niantic's own ply_to_spz and spz_to_ply copy the numbers without turning. A model that
went through one of them stands on its head after the other kind of tool; --axes keep leaves the
numbers as they are, as Niantic's tools do.";

#[derive(clap::Args)]
pub(crate) struct ConvertArgs {
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

fn sh_bits(text: &str) -> Result<ShBits, String> {
    match size::list(text, ',') {
        Some([degree_1, rest]) if [degree_1, rest].iter().all(|bits| (1..=8).contains(bits)) => {
            Ok(ShBits { degree_1, rest })
        }
        _ => Err("use N,M with 1 to 8 each".into()),
    }
}

/// Converts a model.
pub(crate) fn run(args: &ConvertArgs, report: Reporter) -> Result<()> {
    let format = format::of_output(args.to, &args.output, None)?;
    let output = Output::open(&args.output, args.force, &[&args.input])?;
    let (mut scene, read) = args.reading.any(&args.input)?;
    // Each of reading and writing SPZ has turned the scene once, or is about to.
    if args.axes == Axes::Keep && (read == SPZ) != (format.name == SPZ) {
        spz::turn(&mut scene);
    }
    let written = if format.name == SPZ {
        let name = output.name();
        output.write(|out| Ok(out.write_all(&spz::pack(&name, &scene, args.spz_sh_bits)?)?))?
    } else {
        format::write(format, output, &scene)?
    };
    let size = DecimalBytes(written.bytes);
    let human = format!("{}, {size}", counted(scene.len(), "Gaussian"));
    let json = json!({
        "gaussians": scene.len(),
        "sh_degree": scene.sh_degree.min(format.max_sh_degree),
        "bytes": written.bytes,
    });
    report.wrote(&written, &human, json)
}

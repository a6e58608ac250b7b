//! `gsvx convert`.

use crate::axes::{self, Axes};
use crate::exit::note;
use crate::format::Model;
use crate::input::ReadingAny;
use crate::output::{Output, counted, megabytes};
use crate::report::Reporter;
use anyhow::Result;
use gs_model::spz;
use serde_json::json;
use std::path::PathBuf;

/// Shown after the help.
pub(crate) const EXAMPLES: &str = "\
Examples:
  gsvx convert model.ply model.spz
  gsvx convert model.ply small.spz --spz-sh-bits 5,4    as Niantic's packer does by default
  gsvx convert niantic.spz model.ply --axes keep        an SPZ made by Niantic's ply_to_spz
  gsvx convert scene.gsvx scene.splat
  gsvx convert old.spz - --to ply > new.ply
  gsvx convert scene.gsvx scene.glb                     glTF, as three.js and others read it
  gsvx convert scene.sog scene.compressed.ply
  gsvx convert folder/meta.json model.ply               an unbundled SOG
  cat a.splat | gsvx convert - a.ply --from splat

PLY keeps every float, glTF almost; SPZ (version 4 is written, 2 to 4 are read), compressed.ply and
.splat are lossy. SOG (version 2) and .ksplat are read. To write a gsvx stream, use gsvx encode.

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
    #[arg(long, value_name = "FORMAT")]
    to: Option<Model>,
    /// Bits per SH coefficient in SPZ: of degree 1, of degrees 2 and 3.
    #[arg(long, value_name = "N,M", value_parser = sh_bits, default_value = "8,8")]
    spz_sh_bits: (u8, u8),
    /// What is done about the axes of SPZ, read or written.
    #[arg(long, value_name = "HOW", default_value = "turn")]
    axes: Axes,
    #[command(flatten)]
    reading: ReadingAny,
    /// Replace an existing output.
    #[arg(long)]
    force: bool,
}

fn sh_bits(text: &str) -> std::result::Result<(u8, u8), String> {
    let parsed = text.split_once(',').and_then(|(a, b)| Some((a.parse().ok()?, b.parse().ok()?)));
    match parsed {
        Some((a, b)) if (1..=8).contains(&a) && (1..=8).contains(&b) => Ok((a, b)),
        _ => Err("use N,M with 1 to 8 each".into()),
    }
}

/// Converts a model.
pub(crate) fn run(args: &Args, report: Reporter) -> Result<()> {
    let format = Model::of_output(args.to, &args.output, None)?;
    let output = Output::open(&args.output, args.force, &[&args.input])?;
    let loaded = args.reading.any(&args.input)?;
    let mut scene = loaded.scene;
    // Each of reading and writing SPZ has turned the scene once, or is about to.
    let turns = usize::from(loaded.format.starts_with("SPZ")) + usize::from(format == Model::Spz);
    if args.axes == Axes::Keep && turns == 1 {
        axes::turn(&mut scene);
    }
    let (name, stdout) = (output.name(), output.is_stdout());
    let (sh1_bits, sh_rest_bits) = args.spz_sh_bits;
    let spz = spz::WriteOptions { sh1_bits, sh_rest_bits };
    let mut bytes = 0u64;
    output.write(|out| {
        let mut out = Counted { out, bytes: &mut bytes };
        Ok(format.write(&mut out, &scene, &spz)?)
    })?;
    if let Some(lost) = format.loses(scene.sh_degree) {
        note(lost);
    }
    let human =
        format!("{name}: {}, {}", counted(scene.len() as u64, "Gaussian"), megabytes(bytes));
    let json = json!({
        "output": name,
        "gaussians": scene.len(),
        "sh_degree": if format == Model::Splat { 0 } else { scene.sh_degree },
        "bytes": bytes,
    });
    report.say(stdout, &human, &json)
}

/// Counts what goes through.
struct Counted<'a> {
    out: &'a mut dyn std::io::Write,
    bytes: &'a mut u64,
}

impl std::io::Write for Counted<'_> {
    fn write(&mut self, buf: &[u8]) -> std::io::Result<usize> {
        let n = self.out.write(buf)?;
        *self.bytes += n as u64;
        Ok(n)
    }

    fn flush(&mut self) -> std::io::Result<()> {
        self.out.flush()
    }
}

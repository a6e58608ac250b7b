//! `gsvx convert`.

use crate::input;
use crate::output::{Output, is_stdio, megabytes};
use crate::report::Reporter;
use anyhow::{Result, bail};
use clap::ValueEnum;
use gs_model::spz;
use serde_json::json;
use std::path::{Path, PathBuf};

/// Shown after the help.
pub(crate) const EXAMPLES: &str = "\
Examples:
  gsvx convert model.ply model.spz
  gsvx convert model.ply small.spz --spz-sh-bits 5,4    as Niantic's packer does by default
  gsvx convert scene.gsvx scene.splat
  gsvx convert old.spz - --to ply > new.ply

PLY keeps every bit; SPZ (version 4 is written, 2 to 4 are read) and .splat are lossy. To write a
gsvx stream, use gsvx encode.";

/// A format that is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Format {
    /// Inria's PLY layout.
    Ply,
    /// 32 bytes per Gaussian, no view dependence.
    Splat,
    /// Niantic's SPZ, version 4.
    Spz,
}

/// Arguments of `gsvx convert`.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// A PLY, .splat, SPZ or stream; `-` for standard input.
    input: PathBuf,
    /// The file to write; `-` for standard output.
    output: PathBuf,
    /// Format of the output [default: by its extension].
    #[arg(long)]
    to: Option<Format>,
    /// Bits per SH coefficient in SPZ: of degree 1, of degrees 2 and 3.
    #[arg(long, value_name = "N,M", value_parser = sh_bits, default_value = "8,8")]
    spz_sh_bits: (u8, u8),
    /// Leave out Gaussians with NaN, infinity or a zero quaternion instead of failing.
    #[arg(long)]
    drop_invalid: bool,
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

fn format_of(args: &Args) -> Result<Format> {
    if let Some(format) = args.to {
        return Ok(format);
    }
    if is_stdio(&args.output) {
        bail!("standard output: name its format with --to ply, splat or spz");
    }
    let extension =
        Path::new(&args.output).extension().and_then(|e| e.to_str()).unwrap_or_default();
    match extension.to_ascii_lowercase().as_str() {
        "ply" => Ok(Format::Ply),
        "splat" => Ok(Format::Splat),
        "spz" => Ok(Format::Spz),
        "gsvx" => bail!("{}: to write a stream, use gsvx encode", args.output.display()),
        _ => bail!(
            "{}: its extension names no format; pass --to ply, splat or spz",
            args.output.display()
        ),
    }
}

/// Converts a model.
pub(crate) fn run(args: &Args, report: Reporter) -> Result<()> {
    let format = format_of(args)?;
    let output = Output::open(&args.output, args.force)?;
    let scene = input::any(&args.input, args.drop_invalid)?;
    let (name, stdout) = (output.name(), output.is_stdout());
    let mut bytes = 0u64;
    output.write(|out| {
        let mut out = Counted { out, bytes: &mut bytes };
        match format {
            Format::Ply => gs_model::ply::write_to(&mut out, &scene)?,
            Format::Splat => gs_model::splat::write_to(&mut out, &scene)?,
            Format::Spz => {
                let (sh1_bits, sh_rest_bits) = args.spz_sh_bits;
                spz::write_to(&mut out, &scene, &spz::WriteOptions { sh1_bits, sh_rest_bits })?;
            }
        }
        Ok(())
    })?;
    if format == Format::Splat && scene.sh_degree > 0 {
        eprintln!("skipped: SH degrees 1 to {}: .splat holds no view dependence", scene.sh_degree);
    }
    let human = format!("{name}: {} Gaussians, {}", scene.len(), megabytes(bytes));
    report.say(
        stdout,
        &human,
        &json!({
            "output": name,
            "gaussians": scene.len(),
            "sh_degree": if format == Format::Splat { 0 } else { scene.sh_degree },
            "bytes": bytes,
        }),
    );
    Ok(())
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

//! `gsvx decode`.

use crate::input;
use crate::output::Output;
use crate::report::Reporter;
use anyhow::{Context, Result};
use serde_json::json;
use std::path::PathBuf;
use std::time::Instant;

/// Shown after the help.
pub(crate) const EXAMPLES: &str = "\
Examples:
  gsvx decode scene.gsvx -o back.ply
  gsvx decode scene.gsvx -o base.ply --max-sh-degree 0     base colour only
  gsvx decode scene.gsvx -o far.ply --lod 9                at most one Gaussian per cell
  curl https://example.org/scene.gsvx | gsvx decode - -o back.ply
  gsvx decode half.gsvx -o part.ply --allow-truncated";

/// Arguments of `gsvx decode`.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// The stream; `-` for standard input.
    input: PathBuf,
    /// The PLY to write; `-` for standard output.
    #[arg(short, long)]
    output: PathBuf,
    /// Highest SH degree to decode; less is faster and needs less of the stream.
    #[arg(long, default_value_t = 3, value_parser = clap::value_parser!(u8).range(0..=3))]
    max_sh_degree: u8,
    /// Level of detail: at most one Gaussian per octree cell of this depth.
    #[arg(long, value_name = "DEPTH", value_parser = clap::value_parser!(u8).range(0..=21))]
    lod: Option<u8>,
    /// Decode what a truncated stream still holds instead of failing.
    #[arg(long)]
    allow_truncated: bool,
    /// Refuse streams with more Gaussians than this.
    #[arg(long)]
    max_gaussians: Option<u64>,
    /// Replace an existing output.
    #[arg(long)]
    force: bool,
}

/// Decodes a stream to a PLY file.
pub(crate) fn run(args: &Args, report: Reporter) -> Result<()> {
    let output = Output::open(&args.output, args.force)?;
    let (written, stdout) = (output.name(), output.is_stdout());
    let start = Instant::now();
    let bytes = input::bytes(&args.input)?;
    let options = gsvx::DecodeOptions {
        max_sh_degree: args.max_sh_degree,
        lod: args.lod,
        allow_truncated: args.allow_truncated,
        max_gaussians: args.max_gaussians,
    };
    let name = || input::name(&args.input);
    let made = if options.lod.is_some() {
        let decoded = gsvx::decode(&bytes, &options).with_context(name)?;
        drop(bytes);
        let made = Made::of(decoded.scene.len(), decoded.scene.sh_degree, decoded.skipped);
        output.write(|out| Ok(gs_model::ply::write_to(out, &decoded.scene)?))?;
        made
    } else {
        let decoder = gsvx::Decoder::new(&bytes, &options).with_context(name)?;
        let mut damage = None;
        let outcome = write(&decoder, output, &mut damage);
        if let Some(error) = damage {
            return Err(error).with_context(name);
        }
        outcome?;
        Made::of(decoder.len(), decoder.sh_degree(), decoder.skipped().to_vec())
    };
    let seconds = start.elapsed().as_secs_f64();
    for skipped in &made.skipped {
        eprintln!("note: {skipped}");
    }
    let human = format!(
        "{written}: {} Gaussians, SH degree {}, decoded in {seconds:.2} s",
        made.gaussians, made.sh_degree
    );
    report.say(
        stdout,
        &human,
        &json!({
            "output": written,
            "gaussians": made.gaussians,
            "sh_degree": made.sh_degree,
            "skipped": made.skipped,
            "decode_seconds": seconds,
        }),
    );
    Ok(())
}

/// Writes what the decoder gives; damage to the stream goes to `damage`, beside the error.
fn write(
    decoder: &gsvx::Decoder<'_>,
    output: Output,
    damage: &mut Option<gsvx::Error>,
) -> Result<()> {
    let header = gs_model::ply::header(decoder.len(), decoder.sh_degree());
    let mut outcome = |outcome: std::result::Result<(), Stop>| {
        outcome.map_err(|stop| match stop {
            Stop::Output(error) => error,
            Stop::Damage(error) => {
                *damage = Some(error);
                anyhow::anyhow!("the stream is damaged")
            }
        })
    };
    // Every thread writes what it decodes to where it belongs: nothing waits for its turn, and
    // nothing holds more than a block of floats.
    #[cfg(unix)]
    if !output.is_stdout() {
        let row = gs_model::ply::row_bytes(decoder.sh_degree()) as u64;
        return output.write_at(|write| {
            write(&header, 0)?;
            outcome(decoder.blocks(|rows: &mut Vec<u8>, first, scene| {
                gs_model::ply::rows(scene, rows).map_err(|e| Stop::Output(e.into()))?;
                let at = header.len() as u64 + first as u64 * row;
                write(rows, at).map_err(|e| Stop::Output(e.into()))
            }))
        });
    }
    output.write(|out| {
        out.write_all(&header)?;
        // Each part is written while the next are decoded; nothing holds the whole scene.
        outcome(decoder.parts(
            |part| part.scene,
            |scene| {
                let written = gs_model::ply::write_rows_to(&mut *out, &scene);
                written.map_err(|e| Stop::Output(e.into()))
            },
        ))
    })
}

/// What was decoded.
struct Made {
    gaussians: usize,
    sh_degree: u8,
    skipped: Vec<String>,
}

impl Made {
    fn of(gaussians: usize, sh_degree: u8, skipped: Vec<String>) -> Self {
        Self { gaussians, sh_degree, skipped }
    }
}

/// Why decoding ended early.
enum Stop {
    Damage(gsvx::Error),
    Output(anyhow::Error),
}

impl From<gsvx::Error> for Stop {
    fn from(error: gsvx::Error) -> Self {
        Self::Damage(error)
    }
}

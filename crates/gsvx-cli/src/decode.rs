//! `gsvx decode`.

use crate::batch::{self, Job};
use crate::exit::note;
use crate::format::Model;
use crate::input::{self, Limit};
use crate::output::{Output, counted, is_stdio, megabytes};
use crate::positional;
use crate::region::{self, Part, Region};
use crate::report::Reporter;
use anyhow::{Context, Result, anyhow};
use serde_json::json;
use std::fs::File;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Shown after the help.
pub(crate) const EXAMPLES: &str = "\
Examples:
  gsvx decode scene.gsvx -o back.ply
  gsvx decode scene.gsvx -o back.spz                       or .splat, .glb, .compressed.ply: by the extension
  gsvx decode *.gsvx -o models/                            one PLY per stream
  gsvx decode scene.gsvx -o base.ply --max-sh-degree 0     base colour only
  gsvx decode scene.gsvx -o coarse.ply --lod 1             a coarser level of detail
  gsvx decode city.gsvx -o house.ply --box 3,0,-2,9,5,4    a part of it
  curl https://example.org/scene.gsvx | gsvx decode - -o back.ply
  gsvx decode half.gsvx -o part.ply --allow-truncated";

/// Arguments of `gsvx decode`.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// The streams; `-` for standard input.
    #[arg(required = true, value_name = "STREAM")]
    inputs: Vec<PathBuf>,
    /// The model to write, or a folder for several: .ply, .compressed.ply, .glb, .spz or .splat by its
    /// extension, PLY if it has another; `-` for standard output.
    #[arg(short, long, value_name = "PATH")]
    output: PathBuf,
    /// Format of the output [default: by its extension].
    #[arg(long, value_name = "FORMAT")]
    to: Option<Model>,
    /// Highest SH degree to decode; less is faster and needs less of the stream.
    #[arg(long, default_value_t = 3, value_name = "DEGREE",
          value_parser = clap::value_parser!(u8).range(0..=3))]
    max_sh_degree: u8,
    /// Level of detail: 0 is the finest; gsvx info tells which there are.
    #[arg(long, value_name = "LEVEL", default_value_t = 0)]
    lod: u8,
    /// Only the Gaussians whose centres lie in this box, given by two corners. Only the chunks that reach into
    /// it are read. The centres of all are between the corners that gsvx info prints.
    #[arg(long = "box", value_name = "X0,Y0,Z0,X1,Y1,Z1", value_parser = region::parse,
          allow_hyphen_values = true, conflicts_with = "allow_truncated")]
    region: Option<Region>,
    /// Decode what is whole of a truncated or damaged stream instead of failing.
    #[arg(long)]
    allow_truncated: bool,
    #[command(flatten)]
    limit: Limit,
    /// Replace an existing output.
    #[arg(long)]
    force: bool,
}

/// Decodes the streams.
pub(crate) fn run(args: &Args, report: Reporter) -> Result<()> {
    let format = Model::of_output(args.to, &args.output, Some(Model::Ply))?;
    let jobs = batch::jobs(&args.inputs, &args.output, format.extension(), args.force)?;
    batch::run(&jobs, |job| decode_file(args, job, format, report))
}

/// Decodes one stream to a model.
fn decode_file(args: &Args, job: &Job, format: Model, report: Reporter) -> Result<()> {
    let output = Output::open(&job.output, args.force, &[&job.input])?;
    let (written, stdout) = (output.name(), output.is_stdout());
    let start = Instant::now();
    if let Some(region) = args.region {
        let part = region::read(&job.input, region, args.lod, args.max_sh_degree, args.limit)?;
        return write_part(part, output, format, start, report);
    }
    let mut options = gsvx::DecodeOptions::default();
    options.max_sh_degree = args.max_sh_degree;
    options.lod = args.lod;
    options.salvage = args.allow_truncated;
    options.max_gaussians = args.limit.max_gaussians;
    let damage = |e| damage(e, args, &job.input);
    let made = if format != Model::Ply {
        let decoded = gsvx::decode_with(&input::bytes(&job.input)?, &options).map_err(damage)?;
        let scene = &decoded.scene;
        something(args, job, scene.len(), &decoded.skipped)?;
        output.write(|out| Ok(format.write(out, scene, &Default::default())?))?;
        if let Some(lost) = format.loses(scene.sh_degree) {
            note(lost);
        }
        Decoding { gaussians: scene.len(), sh_degree: scene.sh_degree, skipped: decoded.skipped }
    } else {
        // A file need not be in memory.
        let file = FileBytes::open(&job.input)?;
        let bytes = if file.is_none() { input::bytes(&job.input)? } else { Vec::new() };
        let decoder = match &file {
            Some(file) => gsvx::Decoder::of_source(file, &options),
            None => gsvx::Decoder::new(&bytes, &options),
        };
        let decoder = decoder.map_err(damage)?;
        something(args, job, decoder.len(), decoder.skipped())?;
        write(&decoder, output, damage)?;
        let skipped = decoder.skipped().to_vec();
        Decoding { gaussians: decoder.len(), sh_degree: decoder.sh_degree(), skipped }
    };
    made.say(&written, stdout, start.elapsed().as_secs_f64(), report)
}

/// The bytes of a stream in a file.
#[derive(Debug)]
struct FileBytes {
    file: File,
    len: u64,
}

impl FileBytes {
    /// Opens a plain file; `None` for what can only be read from its start.
    fn open(path: &Path) -> Result<Option<Self>> {
        let is_file = std::fs::metadata(path).is_ok_and(|m| m.is_file());
        if is_stdio(path) || !is_file {
            return Ok(None);
        }
        let cannot = || format!("{}: cannot be read", input::name(path));
        let file = File::open(path).with_context(cannot)?;
        let len = file.metadata().with_context(cannot)?.len();
        Ok(Some(Self { file, len }))
    }
}

impl gsvx::Source for FileBytes {
    fn len(&self) -> u64 {
        self.len
    }

    fn read(&self, range: Range<u64>) -> std::io::Result<Vec<u8>> {
        let mut bytes = vec![0; (range.end - range.start) as usize];
        positional::read_exact_at(&self.file, &mut bytes, range.start)?;
        Ok(bytes)
    }
}

/// Writes the Gaussians of a region.
fn write_part(
    part: Part,
    output: Output,
    format: Model,
    start: Instant,
    report: Reporter,
) -> Result<()> {
    let Part { scene, chunks: [decoded, all], bytes_read } = part;
    let (written, stdout) = (output.name(), output.is_stdout());
    output.write(|out| Ok(format.write(out, &scene, &Default::default())?))?;
    if let Some(lost) = format.loses(scene.sh_degree) {
        note(lost);
    }
    let seconds = start.elapsed().as_secs_f64();
    let human = format!(
        "{written}: {} Gaussians in the box, SH degree {}, from {decoded} of {all} chunks ({} read), in \
         {seconds:.2} s",
        scene.len(),
        scene.sh_degree,
        megabytes(bytes_read)
    );
    let json = json!({
        "output": written,
        "gaussians": scene.len(),
        "sh_degree": scene.sh_degree,
        "chunks_decoded": decoded,
        "chunks": all,
        "bytes_read": bytes_read,
        "decode_seconds": seconds,
    });
    report.say(stdout, &human, &json)
}

/// What was decoded.
struct Decoding {
    gaussians: usize,
    sh_degree: u8,
    skipped: Vec<String>,
}

impl Decoding {
    fn say(&self, written: &str, stdout: bool, seconds: f64, report: Reporter) -> Result<()> {
        let Self { gaussians, sh_degree, skipped } = self;
        for skipped in skipped {
            note(format_args!("note: {skipped}"));
        }
        let human = format!(
            "{written}: {}, SH degree {sh_degree}, decoded in {seconds:.2} s",
            counted(*gaussians as u64, "Gaussian")
        );
        let json = json!({
            "output": written,
            "gaussians": gaussians,
            "sh_degree": sh_degree,
            "skipped": skipped,
            "decode_seconds": seconds,
        });
        report.say(stdout, &human, &json)
    }
}

/// An error where damage has left no Gaussian: a model of none would look like a success.
fn something(args: &Args, job: &Job, gaussians: usize, skipped: &[String]) -> Result<()> {
    match skipped.last() {
        Some(why) if args.allow_truncated && gaussians == 0 => {
            Err(anyhow!("{}: nothing of it can be decoded: {why}", input::name(&job.input)))
        }
        _ => Ok(()),
    }
}

/// An error of the stream, with its remedy.
fn damage(error: gsvx::Error, args: &Args, input: &Path) -> anyhow::Error {
    let remedy =
        if args.allow_truncated { "" } else { "pass --allow-truncated to decode what is there" };
    input::explain_stream(error, input, remedy)
}

/// Writes what the decoder gives as PLY; `damage` makes an error of one in the stream.
fn write(
    decoder: &gsvx::Decoder<'_>,
    output: Output,
    damage: impl Fn(gsvx::Error) -> anyhow::Error,
) -> Result<()> {
    let header = gs_model::ply::header(decoder.len(), decoder.sh_degree());
    let outcome = |outcome: std::result::Result<(), Stop>| {
        outcome.map_err(|stop| match stop {
            Stop::Output(error) => error,
            Stop::Damage(error) => damage(error),
        })
    };
    // Every thread writes what it decodes to where it belongs: nothing waits for its turn, and
    // nothing holds more than a block of floats.
    if output.is_file() {
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
        outcome(decoder.chunks(|scene| {
            let written = gs_model::ply::write_rows_to(&mut *out, &scene);
            written.map_err(|e| Stop::Output(e.into()))
        }))
    })
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

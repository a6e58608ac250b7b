//! `gsvx decode`.

use crate::batch::{self, Job};
use crate::exit::{Failure, note};
use crate::format;
use crate::input::{self, Limit};
use crate::output::{Output, counted, is_stdio, megabytes};
use crate::positional;
use crate::region::{self, Inside, Region};
use crate::report::Reporter;
use anyhow::{Context, Result, bail};
use gs_model::Format;
use serde_json::{Value, json};
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
    /// The model to write, or a folder for several; `-` for standard output. Its extension names the format
    /// (gsvx convert --help lists them); it is PLY if it names none.
    #[arg(short, long, value_name = "PATH")]
    output: PathBuf,
    /// Format of the output [default: by its extension].
    #[arg(long, value_name = "FORMAT", value_parser = format::written())]
    to: Option<&'static Format>,
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
    let format = format::of_output(args.to, &args.output, Format::named(PLY))?;
    let jobs = batch::jobs(&args.inputs, &args.output, format.extensions[0], args.force)?;
    batch::run(&jobs, |job| decode_file(args, job, format, report))
}

/// Decodes one stream to a model.
fn decode_file(args: &Args, job: &Job, format: &Format, report: Reporter) -> Result<()> {
    let output = Output::open(&job.output, args.force, &[&job.input])?;
    let (written, stdout) = (output.name(), output.is_stdout());
    let start = Instant::now();
    let (human, json) = if let Some(region) = args.region {
        let part = region::read(&job.input, region, args.lod, args.max_sh_degree, args.limit)?;
        format::write(format, output, &part.scene)?;
        describe_part(&part)
    } else {
        let decoded = decode(args, &job.input, format, output)?;
        decoded.skipped.iter().for_each(|skipped| note(format_args!("note: {skipped}")));
        decoded.describe()
    };
    let seconds = start.elapsed().as_secs_f64();
    let mut json = json;
    json["output"] = json!(written);
    json["decode_seconds"] = json!(seconds);
    report.say(stdout, &format!("{written}: {human}, in {seconds:.2} s"), &json)
}

/// Writes the whole of a stream as a model.
fn decode(args: &Args, input: &Path, format: &Format, output: Output) -> Result<Decoding> {
    let mut options = gsvx::DecodeOptions::default();
    options.max_sh_degree = args.max_sh_degree;
    options.lod = args.lod;
    options.salvage = args.allow_truncated;
    options.max_gaussians = args.limit.max_gaussians;
    let named = || input::name(input);
    // A file need not be in memory.
    let file = if format.name == PLY { FileBytes::open(input)? } else { None };
    let bytes = if file.is_none() { input::bytes(input)? } else { Vec::new() };
    if format.name != PLY {
        let gsvx::Decoded { scene, skipped, .. } =
            gsvx::decode_with(&bytes, &options).with_context(named)?;
        something(args, input, scene.len(), &skipped)?;
        format::write(format, output, &scene)?;
        return Ok(Decoding { gaussians: scene.len(), sh_degree: scene.sh_degree, skipped });
    }
    let decoder = match &file {
        Some(file) => gsvx::Decoder::of_source(file, &options),
        None => gsvx::Decoder::new(&bytes, &options),
    };
    let decoder = decoder.with_context(named)?;
    something(args, input, decoder.len(), decoder.skipped())?;
    write_ply(&decoder, output)
        .map_err(|e| if e.is::<gsvx::Error>() { e.context(named()) } else { e })?;
    let skipped = decoder.skipped().to_vec();
    Ok(Decoding { gaussians: decoder.len(), sh_degree: decoder.sh_degree(), skipped })
}

/// The format that is written while a stream is decoded.
const PLY: &str = "ply";

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

/// What was decoded of a region, for a person and as JSON.
fn describe_part(part: &Inside) -> (String, Value) {
    let Inside { scene, chunks: [decoded, all], bytes_read } = part;
    let human = format!(
        "{} Gaussians in the box, SH degree {}, from {decoded} of {all} chunks ({} read)",
        scene.len(),
        scene.sh_degree,
        megabytes(*bytes_read)
    );
    let json = json!({
        "gaussians": scene.len(),
        "sh_degree": scene.sh_degree,
        "chunks_decoded": decoded,
        "chunks": all,
        "bytes_read": bytes_read,
    });
    (human, json)
}

/// What was decoded.
struct Decoding {
    gaussians: usize,
    sh_degree: u8,
    skipped: Vec<String>,
}

impl Decoding {
    /// For a person and as JSON.
    fn describe(&self) -> (String, Value) {
        let Self { gaussians, sh_degree, skipped } = self;
        let human = format!("{}, SH degree {sh_degree}", counted(*gaussians as u64, "Gaussian"));
        let json = json!({ "gaussians": gaussians, "sh_degree": sh_degree, "skipped": skipped });
        (human, json)
    }
}

/// An error where damage has left no Gaussian: a model of none would look like a success.
fn something(args: &Args, input: &Path, gaussians: usize, skipped: &[String]) -> Result<()> {
    match skipped.last() {
        Some(why) if args.allow_truncated && gaussians == 0 => {
            bail!("{}: nothing of it can be decoded: {why}", input::name(input))
        }
        _ => Ok(()),
    }
}

/// Writes what the decoder gives as PLY.
fn write_ply(decoder: &gsvx::Decoder<'_>, output: Output) -> Result<()> {
    let header = gs_model::ply::header(decoder.len(), decoder.sh_degree());
    // Every thread writes what it decodes to where it belongs: nothing waits for its turn, and
    // nothing holds more than a block of floats.
    if output.is_file() {
        let row = gs_model::ply::row_bytes(decoder.sh_degree()) as u64;
        return output.write_at(|write| {
            write(&header, 0)?;
            let outcome = decoder.blocks(|rows: &mut Vec<u8>, first, scene| {
                gs_model::ply::rows(scene, rows).map_err(Failure::from)?;
                let at = header.len() as u64 + first as u64 * row;
                write(rows, at).map_err(Failure)
            });
            outcome.map_err(|e| e.0)
        });
    }
    output.write(|out| {
        out.write_all(&header)?;
        let outcome = decoder
            .chunks(|scene| Ok::<_, Failure>(gs_model::ply::write_rows_to(&mut *out, &scene)?));
        outcome.map_err(|e| e.0)
    })?;
    Ok(())
}

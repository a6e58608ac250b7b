//! `gsvx decode`.

use crate::batch::{self, Job};
use crate::commands::sequence::{self, DecodeTask, FrameArgs};
use crate::exit::note;
use crate::format;
use crate::frame_source;
use crate::input::{self, Limit};
use crate::output::{Output, Written, counted};
use crate::region::{self, Inside, Region};
use crate::report::Reporter;
use crate::stream_file::StreamBytes;
use anyhow::{Context, Result, bail};
use gs_model::{Format, Scene, ply};
use gsvx::Decoder;
use indicatif::DecimalBytes;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::time::Instant;

pub(crate) const EXAMPLES: &str = "\
Examples:
  gsvx decode scene.gsvx -o back.ply
  gsvx decode scene.gsvx -o back.spz                       or .splat, .glb, .compressed.ply: by the extension
  gsvx decode *.gsvx -o models/                            one PLY per stream
  gsvx decode scene.gsvx -o base.ply --max-sh-degree 0     base colour only
  gsvx decode scene.gsvx -o coarse.ply --lod 1             a coarser level of detail
  gsvx decode city.gsvx -o house.ply --box 3,0,-2,9,5,4    a part of it
  gsvx decode clip.gsvx -o frame.ply --frame 17
  gsvx decode clip.gsvx -o frames/ --frames 10..20
  curl https://example.org/scene.gsvx | gsvx decode - -o back.ply
  gsvx decode half.gsvx -o part.ply --salvage";

#[derive(clap::Args)]
pub(crate) struct DecodeArgs {
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
          allow_hyphen_values = true, conflicts_with = "salvage")]
    region: Option<Region>,
    /// Decode what is whole of a truncated or damaged stream instead of failing.
    #[arg(long)]
    salvage: bool,
    #[command(flatten)]
    frames: FrameArgs,
    #[command(flatten)]
    limit: Limit,
    /// Replace an existing output.
    #[arg(long)]
    force: bool,
}

/// Decodes the streams.
pub(crate) fn run(args: &DecodeArgs, report: Reporter) -> Result<()> {
    let format = format::of_output(args.to, &args.output, Format::named(PLY))?;
    if args.frames.any() || args.inputs.iter().any(|input| frame_source::is_file(input)) {
        let &DecodeArgs { ref inputs, ref output, max_sh_degree, salvage, limit, force, .. } = args;
        let wanted = &args.frames;
        let what = DecodeTask { inputs, output, wanted, max_sh_degree, salvage, limit, force };
        return sequence::decode(&what, format, report);
    }
    let jobs = batch::jobs(&args.inputs, &args.output, format.extensions[0], args.force)?;
    batch::run(&jobs, |job| decode_file(args, job, format, report))
}

/// Decodes one stream to a model.
fn decode_file(args: &DecodeArgs, job: &Job, format: &Format, report: Reporter) -> Result<()> {
    let output = Output::open(&job.output, args.force, &[&job.input])?;
    let start = Instant::now();
    let (written, human, mut json) = match args.region {
        Some(region) => decode_part(args, job, region, format, output)?,
        None => decode(args, &job.input, format, output)?,
    };
    let seconds = start.elapsed().as_secs_f64();
    json["decode_seconds"] = json!(seconds);
    report.wrote(&written, &format!("{human}, in {seconds:.2} s"), json)
}

/// Writes a part of a stream as a model. Returns what was decoded, for a person and as JSON.
fn decode_part(
    args: &DecodeArgs,
    job: &Job,
    region: Region,
    format: &Format,
    output: Output,
) -> Result<(Written, String, Value)> {
    let Inside { scene, chunks: [decoded, all], bytes_read } =
        region::read(&job.input, region, args.lod, args.max_sh_degree, args.limit)?;
    let written = format::write(format, output, &scene)?;
    let human = format!(
        "{} in the box, SH degree {}, from {decoded} of {all} chunks ({} read)",
        counted(scene.len(), "Gaussian"),
        scene.sh_degree,
        DecimalBytes(bytes_read)
    );
    let json = json!({
        "gaussians": scene.len(),
        "sh_degree": scene.sh_degree,
        "chunks_decoded": decoded,
        "chunks": all,
        "bytes_read": bytes_read,
    });
    Ok((written, human, json))
}

/// Writes the whole of a stream as a model. Returns what was decoded, for a person and as JSON.
fn decode(
    args: &DecodeArgs,
    input: &Path,
    format: &Format,
    output: Output,
) -> Result<(Written, String, Value)> {
    let mut options = gsvx::DecodeOptions::default();
    options.max_sh_degree = args.max_sh_degree;
    options.lod = args.lod;
    options.salvage = args.salvage;
    options.max_gaussians = args.limit.max_gaussians;
    let source = StreamBytes::open(input)?;
    let decoder = match &source {
        StreamBytes::Memory(bytes) => Decoder::new(bytes, &options),
        file => Decoder::of_source(file, &options),
    };
    let named = || input::name(input);
    let decoder = decoder.with_context(named)?;
    let (gaussians, sh_degree, skipped) = (decoder.len(), decoder.sh_degree(), decoder.skipped());
    if let (true, 0, Some(why)) = (args.salvage, gaussians, skipped.last()) {
        // A model of no Gaussian would look like a success.
        bail!("{}: nothing of it can be decoded: {why}", named());
    }
    let written = if format.name == PLY {
        write_ply(&decoder, output)
    } else {
        whole(&decoder).and_then(|scene| format::write(format, output, &scene))
    };
    let written =
        written.map_err(|e| if e.is::<gsvx::Error>() { e.context(named()) } else { e })?;
    skipped.iter().for_each(|skipped| note(format_args!("note: {skipped}")));
    let human = format!("{}, SH degree {sh_degree}", counted(gaussians, "Gaussian"));
    let json = json!({ "gaussians": gaussians, "sh_degree": sh_degree, "skipped": skipped });
    Ok((written, human, json))
}

/// The format that is written while a stream is decoded.
const PLY: &str = "ply";

/// Writes what the decoder gives as PLY.
fn write_ply(decoder: &Decoder<'_>, output: Output) -> Result<Written> {
    let header = ply::header(decoder.len(), &decoder.empty_scene());
    // Every thread writes what it decodes to where it belongs: nothing waits for its turn, and
    // nothing holds more than a block of floats.
    if output.is_file() {
        let row = ply::row_bytes(decoder.sh_degree()) as u64;
        return output.write_at(|write| {
            write(&header, 0)?;
            decoder.blocks(|rows: &mut Vec<u8>, first, scene| {
                ply::rows(scene, rows)?;
                write(rows, header.len() as u64 + first as u64 * row)
            })
        });
    }
    output.write(|out| {
        out.write_all(&header)?;
        decoder.chunks(|scene| Ok(ply::write_rows_to(&mut *out, &scene)?))
    })
}

/// All that the decoder gives.
fn whole(decoder: &Decoder<'_>) -> Result<Scene> {
    let mut all = decoder.empty_scene();
    decoder.chunks::<gsvx::Error>(|scene| {
        all.append(&scene);
        Ok(())
    })?;
    Ok(all)
}

//! Sequences of frames: from models, to models, and what they hold.

use crate::content::{self, SceneArgs};
use crate::exit::{missed, note, usage};
use crate::format;
use crate::frame_source::{EncodeFrames, InputFrame, evenly, only};
use crate::input::{self, Limit, ReadingAny};
use crate::loss;
use crate::output::{Output, OutputFolder, counted};
use crate::progress::Meter;
use crate::report::Reporter;
use anyhow::{Context, Result, bail, ensure};
use finetune::metrics::Scores;
use finetune::{LossEstimate, RenderOptions, framing, render};
use gs_model::{Format, chain};
use gsvx::rate::{self, SearchResult};
use gsvx::sequence::{FrameGroup, Sequence};
use gsvx::{Index, SequenceEncoder, SequenceOptions};
use indicatif::DecimalBytes;
use serde_json::json;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Heading of the flags.
pub(crate) const HEADING: &str = "Sequences of frames";

/// What `gsvx encode` is to make of frames.
pub(crate) struct EncodeTask {
    pub(crate) options: SequenceOptions,
    /// Most bytes of a second, instead of the quality of the options.
    pub(crate) bytes_per_second: Option<u64>,
    pub(crate) estimate: bool,
}

/// An encoded sequence.
struct SequenceStream {
    bytes: Vec<u8>,
    input_bytes: u64,
    transparent: usize,
    outliers: usize,
}

impl AsRef<[u8]> for SequenceStream {
    fn as_ref(&self) -> &[u8] {
        &self.bytes
    }
}

/// Encodes frames at a quality. Says what the first holds if `say`.
fn made(
    args: &SceneArgs,
    frames: &EncodeFrames,
    options: SequenceOptions,
    say: bool,
) -> Result<SequenceStream> {
    let mut encoder = SequenceEncoder::new(options)?;
    let mut input_bytes = 0;
    let bar = Meter::new("frames", frames.len());
    for i in 0..frames.len() {
        let InputFrame { mut scene, there, bytes } =
            frames.frame(i, &args.reading, say && i == 0)?;
        scene.cut_sh(options.encode.code.max_sh_degree);
        input_bytes += bytes;
        let pushed = match there {
            Some(there) => encoder.push_known(scene, &there),
            None => encoder.push(scene),
        };
        pushed.with_context(|| frames.name(i))?;
        bar.inc();
    }
    let bytes = encoder.finish()?;
    let (transparent, outliers) = (encoder.transparent(), encoder.outliers());
    Ok(SequenceStream { bytes, input_bytes, transparent, outliers })
}

/// The best sequence of at most so many bytes. All frames are read for each quality that is tried.
fn searched(
    args: &SceneArgs,
    frames: &EncodeFrames,
    options: SequenceOptions,
    most: u64,
) -> Result<SearchResult<SequenceStream>> {
    let (mut why, mut first) = (None, true);
    let found = rate::to_bytes(most, |quality| {
        let say = std::mem::take(&mut first);
        let made = made(args, frames, SequenceOptions { quality, ..options }, say);
        // The search knows errors of the library alone.
        made.map_err(|error| {
            why = Some(error);
            gsvx::Error::Cancelled
        })
    });
    found.map_err(|error| why.unwrap_or_else(|| error.into()))
}

/// Encodes frames.
pub(crate) fn encode_frames(
    args: &SceneArgs,
    frames: &EncodeFrames,
    encoding: &EncodeTask,
    report: Reporter,
) -> Result<()> {
    let EncodeTask { options, bytes_per_second, estimate } = *encoding;
    let output = Output::open(&args.output, args.force, frames.paths())?;
    let start = Instant::now();
    let seconds = frames.len() as f64 / f64::from(options.fps);
    let found = match bytes_per_second {
        Some(most) => searched(args, frames, options, (most as f64 * seconds) as u64)?,
        None => SearchResult {
            encoded: made(args, frames, options, true)?,
            quality: options.quality,
            encodes: 1,
            measured: None,
            reached: true,
        },
    };
    let SearchResult { encoded, quality, encodes, reached, .. } = found;
    let SequenceStream { bytes, input_bytes, transparent, outliers } = encoded;
    if transparent > 0 {
        note(content::transparent(transparent));
    }
    if outliers > 0 {
        let far = counted(outliers, "Gaussian");
        note(format_args!("{far} far from all others do not move: they stay in their mean place"));
    }
    let sequence = Sequence::parse(&bytes)?;
    let written = output.write(|out| Ok(out.write_all(&bytes)?))?;
    let (seconds, groups) = (start.elapsed().as_secs_f64(), sequence.groups.len());
    let rate = per_second(&sequence, written.bytes);
    let tries = match encodes {
        1 => format!("quality {quality}"),
        _ => format!("quality {quality:.1}, {encodes} encodes"),
    };
    let mut human = format!(
        "{} in {}, {} -> {} ({:.1}x, {} per frame, {} per second); {tries}, in {seconds:.2} s",
        counted(frames.len(), "frame"),
        counted(groups, "group"),
        DecimalBytes(input_bytes),
        DecimalBytes(written.bytes),
        input_bytes as f64 / written.bytes as f64,
        DecimalBytes(written.bytes / frames.len() as u64),
        DecimalBytes(rate),
    );
    let mut json = json!({
        "frames": frames.len(),
        "groups": groups,
        "fps": options.fps,
        "quality": quality,
        "encodes": encodes,
        "target_reached": reached,
        "bytes": written.bytes,
        "bytes_per_second": rate,
        "input_bytes": input_bytes,
        "transparent": transparent,
        "outliers": outliers,
        "encode_seconds": seconds,
    });
    if estimate {
        let loss = estimated(args, frames, &sequence, &bytes)?;
        human += &format!("\n{}", loss::human(&loss));
        json["estimated_loss"] = loss::json(&loss);
        if let Some(warning) = loss::warning(&loss, false, true) {
            note(format_args!("warning: {}: {warning}", written.name));
        }
    }
    report.wrote(&written, &human, json)?;
    match bytes_per_second {
        Some(wanted) if !reached => Err(missed(format!(
            "{}: written, but at quality 0 a second takes {rate} bytes, more than {wanted}",
            written.name
        ))),
        _ => Ok(()),
    }
}

/// Frames that are drawn to estimate the loss, each from another place.
const ESTIMATED: u32 = 4;

/// How much less a sequence shows than its frames.
fn estimated(
    args: &SceneArgs,
    frames: &EncodeFrames,
    sequence: &Sequence,
    bytes: &[u8],
) -> Result<LossEstimate> {
    let input = |number: u64| {
        let InputFrame { scene, there, .. } =
            frames.frame(number as usize, &args.reading, false)?;
        Ok::<_, anyhow::Error>(match there {
            Some(there) => only(scene, &there),
            None => scene,
        })
    };
    let first = input(0)?;
    let cameras = framing::around(&first, ESTIMATED);
    let (mut scores, mut shows) = (Vec::new(), false);
    for (number, camera) in evenly(frames.len() as u64, ESTIMATED.into()).into_iter().zip(&cameras)
    {
        let mut frame = input(number)?;
        let Some(group) = sequence.group_of(number) else { continue };
        let decoded = sequence.group(bytes, group, Some(u64::MAX))?;
        let mut decoded = decoded.frame((number - sequence.groups[group].frames.start) as usize);
        let drawn = [&mut frame, &mut decoded].map(|scene| {
            scene.move_origin(first.origin);
            render(scene, camera, &RenderOptions::default())
        });
        let [reference, shown] = drawn;
        shows |= reference.rgb.iter().any(|&v| v > 0.0);
        scores.push(Scores::of(&shown, &reference));
    }
    let around = shows.then(|| loss::likeness(&scores));
    Ok(LossEstimate { around, ..LossEstimate::default() })
}

fn per_second(sequence: &Sequence, bytes: u64) -> u64 {
    (bytes as f64 * f64::from(sequence.fps) / sequence.frames().max(1) as f64) as u64
}

/// Frames on the command line: `10..20` for 10 to 19.
fn range(text: &str) -> Result<Range<u64>, String> {
    let parts = text.split_once("..").and_then(|(a, b)| Some(a.parse().ok()?..b.parse().ok()?));
    parts.filter(|r| r.start < r.end).ok_or_else(|| "use a range such as 10..20".to_owned())
}

/// Which frames are decoded.
#[derive(clap::Args)]
pub(crate) struct FrameArgs {
    /// The frame of a sequence, counted from 0.
    #[arg(long, value_name = "N", conflicts_with_all = ["region", "lod"])]
    frame: Option<u64>,
    /// Frames of a sequence, into a folder: 10..20 for 10 to 19.
    #[arg(long, value_name = "A..B", value_parser = range, conflicts_with_all = ["frame", "region", "lod"])]
    frames: Option<Range<u64>>,
}

impl FrameArgs {
    /// Whether frames are asked for.
    pub(crate) fn any(&self) -> bool {
        self.frame.is_some() || self.frames.is_some()
    }
}

/// What `gsvx decode` is to do with a sequence.
pub(crate) struct DecodeTask<'a> {
    pub(crate) inputs: &'a [PathBuf],
    pub(crate) output: &'a Path,
    pub(crate) wanted: &'a FrameArgs,
    pub(crate) max_sh_degree: u8,
    pub(crate) salvage: bool,
    pub(crate) limit: Limit,
    pub(crate) force: bool,
}

/// Writes frames of a sequence as models: one to a file, or several into a folder.
pub(crate) fn decode(args: &DecodeTask<'_>, format: &Format, report: Reporter) -> Result<()> {
    let [path] = args.inputs else {
        return Err(usage("--frame and --frames take one sequence"));
    };
    let (start, name) = (Instant::now(), input::name(path));
    let bytes = input::bytes(path)?;
    let sequence = Sequence::parse(&bytes).with_context(|| name.clone())?;
    let count = sequence.frames();
    let wanted = match (args.wanted.frame, &args.wanted.frames) {
        (Some(frame), _) => frame..frame + 1,
        (None, Some(frames)) => frames.clone(),
        (None, None) => bail!(
            "{name}: is a sequence of {count} frames; name some with --frame 0 or --frames 0..{count}"
        ),
    };
    ensure!(
        wanted.end <= count,
        "{name}: has no frame {}, only frames 0 to {}",
        wanted.end - 1,
        count.saturating_sub(1)
    );
    let mut folder = match args.wanted.frame {
        None => Some(OutputFolder::open(args.output, args.force)?),
        Some(_) => None,
    };
    let (mut skipped, mut written) = (Vec::new(), 0);
    for (number, group) in sequence.groups.iter().enumerate() {
        let some = wanted.start.max(group.frames.start)..wanted.end.min(group.frames.end);
        if some.is_empty() {
            continue;
        }
        let decoded = match sequence.group(&bytes, number, args.limit.max_gaussians) {
            Ok(decoded) => decoded,
            Err(why) if args.salvage => {
                let Range { start, end } = some;
                let which = match end - start {
                    1 => format!("frame {start}"),
                    _ => format!("frames {start} to {}", end - 1),
                };
                skipped.push(format!("{which}: {}", chain(&why)));
                continue;
            }
            Err(why) => return Err(why).with_context(|| name.clone()),
        };
        for frame in some {
            let mut scene = decoded.frame((frame - group.frames.start) as usize);
            scene.cut_sh(args.max_sh_degree);
            let gaussians = scene.len();
            written += 1;
            let Some(folder) = &mut folder else {
                let output = Output::open(args.output, args.force, &[path])?;
                let written = format::write(format, output, &scene)?;
                let seconds = start.elapsed().as_secs_f64();
                let human =
                    format!("frame {frame}, {}, in {seconds:.2} s", counted(gaussians, "Gaussian"));
                let json =
                    json!({ "frame": frame, "gaussians": gaussians, "decode_seconds": seconds });
                return report.wrote(&written, &human, json);
            };
            let file = format!("frame_{frame:04}.{}", format.extensions[0]);
            folder.write(&file, &[path], |out| Ok(format.write_to(&file, out, &scene)?))?;
        }
    }
    if let (0, Some(why)) = (written, skipped.last()) {
        bail!("{name}: nothing of it can be decoded: {why}");
    }
    if let Some(folder) = folder {
        folder.put_in_place()?;
    }
    skipped.iter().for_each(|skipped| note(format_args!("note: {skipped}")));
    let seconds = start.elapsed().as_secs_f64();
    let folder = args.output.display();
    let human = format!("{folder}: {} of {count}, in {seconds:.2} s", counted(written, "frame"));
    let json = json!({ "output": folder.to_string(), "frames": written, "skipped": skipped, "decode_seconds": seconds });
    report.say(false, &human, &json)
}

/// Prints what a sequence holds, and what is missing or damaged.
pub(crate) fn describe(
    bytes: &[u8],
    path: &Path,
    reading: &ReadingAny,
    report: Reporter,
) -> Result<()> {
    let name = input::name(path);
    let sequence = Sequence::parse(bytes).with_context(|| name.clone())?;
    let (total, frames) = (sequence.stream_len(), sequence.frames());
    let (mut faults, mut groups, mut most) = (Vec::new(), Vec::new(), 0);
    let mut lines = String::new();
    for (number, FrameGroup { frames, stream, motion, .. }) in sequence.groups.iter().enumerate() {
        let found = sequence.bytes_of(bytes, number).and_then(|(stream, _)| Index::parse(stream));
        let gaussians = found.as_ref().map_or(0, |index| index.header.count);
        reading.limit.check(path, gaussians)?;
        most = most.max(gaussians);
        let [stream, motion] = [stream, motion].map(|range| range.end - range.start);
        lines += &format!(
            "\n  {:<12} {gaussians:>10} {stream:>12} {motion:>12}",
            format!("{}..{}", frames.start, frames.end)
        );
        groups.push(json!({ "frames": [frames.start, frames.end], "gaussians": gaussians, "stream": stream, "motion": motion }));
        if let Err(why) = found {
            faults.push(chain(&why));
        }
    }
    let rate = per_second(&sequence, total);
    let mut text = format!(
        "{name}: {} ({} bytes)\n  frames         {frames}, {} per second\n  groups         {}\n  \
         Gaussians      {most} at most\n  bytes/frame    {}\n  bytes/second   {rate}\n\n  \
         {:<12} {:>10} {:>12} {:>12}{lines}",
        DecimalBytes(bytes.len() as u64),
        bytes.len(),
        sequence.fps,
        sequence.groups.len(),
        total / frames.max(1),
        "frames",
        "Gaussians",
        "static bytes",
        "motion bytes",
    );
    faults.iter().for_each(|fault| text += &format!("\n\n  {fault}"));
    let json = json!({
        "bytes": bytes.len(),
        "expected_bytes": total,
        "fps": sequence.fps,
        "frames": frames,
        "bytes_per_second": rate,
        "groups": groups,
        "faults": faults,
    });
    report.say(false, &text, &json)
}

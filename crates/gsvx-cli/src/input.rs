//! Reading models and streams, from files or standard input.

use crate::exit::note;
use crate::format::Source;
use crate::lost_columns::{self, Lost};
use crate::output::{counted, is_stdio};
use crate::size;
use anyhow::{Context, Result, anyhow, bail};
use gs_model::Scene;
use gs_model::model::{self, Format, Kind};
use gs_model::ply::{self, Invalid, ReadOptions};
use serde::{Deserialize, Serialize};
use std::fs::File;
use std::io::Read;
use std::path::Path;

/// How a model is read.
#[derive(clap::Args, Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Reading {
    /// Format of the input, where its name and content do not say: a .splat from a pipe, say.
    #[arg(long, value_name = "FORMAT", hide_short_help = true, help_heading = "Input")]
    from: Option<Source>,
    /// Leave out Gaussians with NaN, infinity or a zero quaternion instead of failing.
    #[arg(long, hide_short_help = true, help_heading = "Input")]
    drop_invalid: bool,
}

/// How a model or a stream is read.
#[derive(clap::Args, Clone, Debug)]
pub(crate) struct ReadingAny {
    #[command(flatten)]
    model: Reading,
    #[command(flatten)]
    limit: Limit,
}

/// How large an input may be.
#[derive(clap::Args, Clone, Copy, Debug)]
pub(crate) struct Limit {
    /// Refuse inputs of more Gaussians than this [default for streams: 1024 per byte, and 131072 more].
    #[arg(long, value_name = "N", value_parser = size::count, hide_short_help = true,
          help_heading = "Input")]
    pub(crate) max_gaussians: Option<u64>,
}

/// A model, and what its file said.
pub(crate) struct Loaded {
    pub(crate) scene: Scene,
    /// Length of the file.
    pub(crate) bytes: u64,
    /// The file's format, in words.
    pub(crate) format: String,
    pub(crate) gaussians_in_file: usize,
    /// What a PLY said besides.
    pub(crate) ply: Option<ply::ReadReport>,
}

impl Loaded {
    fn of_ply(scene: Scene, bytes: u64, ply: ply::ReadReport) -> Self {
        let format = match ply.format {
            ply::Format::Ascii => "PLY, ASCII",
            ply::Format::BinaryLittleEndian => "PLY, binary little-endian",
            ply::Format::BinaryBigEndian => "PLY, binary big-endian",
        };
        let gaussians_in_file = ply.gaussians_in_file;
        Self { scene, bytes, format: format.into(), gaussians_in_file, ply: Some(ply) }
    }

    fn of_model(scene: Scene, bytes: u64, report: model::Report) -> Self {
        if let Some(ply) = report.ply {
            return Self::of_ply(scene, bytes, ply);
        }
        let format = match report.format {
            Format::Spz { version } => format!("SPZ, version {version}"),
            Format::Splat => ".splat".into(),
            Format::Ksplat => ".ksplat".into(),
            Format::CompressedPly => "PlayCanvas compressed.ply".into(),
            Format::Sog => "SOG, version 2".into(),
            Format::Gltf => "glTF, KHR_gaussian_splatting".into(),
            other => format!("{other:?}"),
        };
        Self { scene, bytes, format, gaussians_in_file: report.gaussians_in_file, ply: None }
    }

    fn say_what_was_skipped(self) -> Self {
        for said in self.ply.iter().flat_map(|p| &p.notes) {
            note(format_args!("note: {said}"));
        }
        for property in self.ply.iter().flat_map(|p| &p.unknown_properties) {
            note(format_args!("skipped: property {property} is not part of a 3DGS model"));
        }
        let (kept, all) = (self.scene.len(), self.gaussians_in_file);
        if kept < all {
            note(format_args!(
                "skipped: {} of {all}",
                counted((all - kept) as u64, "invalid Gaussian")
            ));
        }
        self
    }
}

/// The whole of a file, or of standard input for `-`.
pub(crate) fn bytes(path: &Path) -> Result<Vec<u8>> {
    if is_stdio(path) {
        let mut all = Vec::new();
        std::io::stdin().lock().read_to_end(&mut all).context("standard input")?;
        return Ok(all);
    }
    no_folder(path)?;
    std::fs::read(path).with_context(|| format!("{}: cannot be read", path.display()))
}

fn no_folder(path: &Path) -> Result<()> {
    if path.is_dir() {
        bail!("{}: is a folder; name the model in it", path.display());
    }
    Ok(())
}

/// What a person calls the input.
pub(crate) fn name(path: &Path) -> String {
    if is_stdio(path) { "standard input".into() } else { path.display().to_string() }
}

impl Reading {
    fn options(&self) -> ReadOptions {
        let invalid = if self.drop_invalid { Invalid::Drop } else { Invalid::Error };
        ReadOptions { invalid, ..Default::default() }
    }

    /// A model that can be read some Gaussians at a time; `None` of any other.
    pub(crate) fn parts(&self, path: &Path) -> Result<Option<ply::Parts>> {
        if self.from.is_some() || starts_like_stream(path)? {
            return Ok(None);
        }
        ply::Parts::open(path, &self.options()).map_err(|e| explain(e, path))
    }

    /// The next Gaussians of a model.
    pub(crate) fn next_part(&self, parts: &mut ply::Parts, path: &Path) -> Result<Option<Scene>> {
        parts.next_part().map_err(|e| explain(e, path))
    }

    /// A model of any format that gs-model reads; a stream is refused. Says what it skipped, and
    /// looks for what a lossless stream would lose if `lost` is given.
    pub(crate) fn model(&self, path: &Path, lost: Option<&mut Lost>) -> Result<Loaded> {
        if self.from == Some(Source::Gsvx) {
            return Err(is_a_stream(path));
        }
        // A plain file need not be in memory whole.
        if self.from.is_none() && std::fs::metadata(path).is_ok_and(|m| m.is_file()) {
            if starts_like_stream(path)? {
                return Err(is_a_stream(path));
            }
            if let (Some(lost), Ok(file)) = (lost, File::open(path)) {
                *lost = lost_columns::find(file);
            }
            return self.file(path);
        }
        let all = bytes(path)?;
        if is_stream(&all) {
            return Err(is_a_stream(path));
        }
        if let Some(lost) = lost {
            *lost = lost_columns::find(&all[..]);
        }
        self.parse(path, &all)
    }

    /// A model in a plain file, whose name and content say what it is.
    fn file(&self, path: &Path) -> Result<Loaded> {
        let bytes = std::fs::metadata(path).map_or(0, |m| m.len());
        let (scene, report) = model::read(path, &self.options()).map_err(|e| explain(e, path))?;
        Ok(Loaded::of_model(scene, bytes, report).say_what_was_skipped())
    }

    /// A model in memory.
    fn parse(&self, path: &Path, all: &[u8]) -> Result<Loaded> {
        let (options, bytes) = (self.options(), all.len() as u64);
        let called = if is_stdio(path) { Path::new("standard input") } else { path };
        let kind = self.from.and_then(Source::kind).unwrap_or_else(|| Kind::of(called, all));
        let (scene, report) =
            model::read_as(kind, called, all, &options).map_err(|e| explain(e, path))?;
        Ok(Loaded::of_model(scene, bytes, report).say_what_was_skipped())
    }
}

/// A file that was opened: the bytes of a stream, or a model.
pub(crate) enum Opened {
    Stream(Vec<u8>),
    Model(Box<Loaded>),
}

impl ReadingAny {
    /// Reads a model, or the bytes of a stream.
    pub(crate) fn open(&self, path: &Path) -> Result<Opened> {
        let from = self.model.from;
        let is_file = std::fs::metadata(path).is_ok_and(|m| m.is_file());
        let loaded = if from.is_none() && is_file && !starts_like_stream(path)? {
            self.model.file(path)?
        } else {
            let all = bytes(path)?;
            let stream = from.is_none() && is_stream(&all);
            if stream || from == Some(Source::Gsvx) {
                return Ok(Opened::Stream(all));
            }
            self.model.parse(path, &all)?
        };
        self.limit.check(path, loaded.scene.len() as u64)?;
        Ok(Opened::Model(Box::new(loaded)))
    }

    /// A model of any format, streams included.
    pub(crate) fn any(&self, path: &Path) -> Result<Loaded> {
        match self.open(path)? {
            Opened::Stream(all) => self.stream(path, &all),
            Opened::Model(loaded) => Ok(*loaded),
        }
    }

    /// The limits on inputs.
    pub(crate) fn limit(&self) -> Limit {
        self.limit
    }

    fn stream(&self, path: &Path, all: &[u8]) -> Result<Loaded> {
        let mut options = gsvx::DecodeOptions::default();
        options.max_gaussians = self.limit.max_gaussians;
        let decoded = gsvx::decode_with(all, &options).map_err(|e| {
            explain_stream(e, path, "gsvx decode --allow-truncated writes what is there")
        })?;
        let (scene, bytes) = (decoded.scene, all.len() as u64);
        let gaussians_in_file = scene.len();
        Ok(Loaded { scene, bytes, format: "gsvx stream".into(), gaussians_in_file, ply: None })
    }
}

impl Limit {
    /// Refuses an input of more Gaussians than asked for.
    pub(crate) fn check(self, path: &Path, gaussians: u64) -> Result<()> {
        match self.max_gaussians {
            Some(limit) if gaussians > limit => {
                bail!("{}", over_the_limit(path, gaussians, limit))
            }
            _ => Ok(()),
        }
    }
}

fn over_the_limit(path: &Path, gaussians: u64, limit: u64) -> String {
    format!(
        "{}: {gaussians} Gaussians, more than the limit of {limit}; pass --max-gaussians \
         {gaussians} if you trust it",
        name(path)
    )
}

fn is_a_stream(path: &Path) -> anyhow::Error {
    anyhow!(
        "{}: is a gsvx stream already; to code it again, write it as a model with gsvx decode first",
        name(path)
    )
}

fn starts_like_stream(path: &Path) -> Result<bool> {
    let file = File::open(path).with_context(|| format!("{}: cannot be read", path.display()))?;
    let mut start = Vec::new();
    let most = gsvx::SIGNATURE.len() as u64;
    let read = file.take(most).read_to_end(&mut start);
    read.with_context(|| format!("{}: cannot be read", path.display()))?;
    Ok(is_stream(&start))
}

/// True for the bytes of a stream, also where it is cut within its signature.
fn is_stream(bytes: &[u8]) -> bool {
    let signature = &gsvx::SIGNATURE;
    bytes.starts_with(signature) || (!bytes.is_empty() && signature.starts_with(bytes))
}

/// An error of a model's reader, with its remedy.
fn explain(error: gs_model::Error, path: &Path) -> anyhow::Error {
    use gs_model::Error;
    match &error {
        Error::InvalidGaussian { .. } => {
            let said = error.to_string().replace("; what is invalid can be dropped on request", "");
            anyhow!("{}: pass --drop-invalid to leave them out", called(&said, path))
        }
        Error::SpzCompressedData { reason, .. } => {
            anyhow!("{}: its compressed data is {reason}; get it again", name(path))
        }
        Error::PlyMagic { found, .. } if found.is_empty() => anyhow!("{}: is empty", name(path)),
        Error::PlyMagic { .. } if is_stdio(path) => anyhow!(
            "{}; for a .splat or .ksplat from a pipe pass --from splat or --from ksplat",
            called(&error.to_string(), path)
        ),
        _ => anyhow!("{}", called(&error.to_string(), path)),
    }
}

/// The error text with the name that a person gave the input.
fn called(text: &str, path: &Path) -> String {
    text.replacen("<bytes>", &name(path), 1)
}

/// An error of the decoder, with its remedy; `truncated` is what to do about a stream that was cut.
pub(crate) fn explain_stream(error: gsvx::Error, path: &Path, truncated: &str) -> anyhow::Error {
    let name = name(path);
    match error {
        gsvx::Error::Limit { points, limit } => anyhow!("{}", over_the_limit(path, points, limit)),
        gsvx::Error::Truncated { .. } if !truncated.is_empty() => {
            anyhow!("{name}: {error}; {truncated}")
        }
        _ => anyhow::Error::new(error).context(name),
    }
}

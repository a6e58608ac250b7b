//! Reading models and streams, from files or standard input.

use crate::exit::{STDIN, note};
use crate::format::{self, STREAM};
use crate::output::{counted, is_stdio};
use crate::size;
use anyhow::{Context, Result, bail};
use gs_model::{Format, Invalid, ReadOptions, Report, Scene, model, ply};
use serde::{Deserialize, Serialize};
use std::fs::File;
use std::io::Read;
use std::path::Path;

/// How a model is read.
#[derive(clap::Args, Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Reading {
    /// Format of the input, where its name and content do not say: a .splat from a pipe, say.
    #[arg(long, value_name = "FORMAT", value_parser = format::read_name(), hide_short_help = true,
          help_heading = "Input")]
    from: Option<String>,
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
    /// Length of the file, and of what belongs to it.
    pub(crate) bytes: u64,
    /// None of a stream.
    pub(crate) report: Option<Report>,
}

impl Loaded {
    /// A model just read. Says what was skipped.
    fn of_model((scene, report): (Scene, Report), bytes: u64) -> Self {
        for said in &report.notes {
            note(format_args!("note: {said}"));
        }
        for property in &report.unknown_properties {
            note(format_args!("skipped: property {property} is not part of a 3DGS model"));
        }
        if report.dropped > 0 {
            let (dropped, all) = (report.dropped as u64, report.gaussians_in_file);
            note(format_args!("skipped: {} of {all}", counted(dropped, "invalid Gaussian")));
        }
        let bytes = bytes + report.bytes_beside;
        Self { scene, bytes, report: Some(report) }
    }

    /// The file's format, in words.
    pub(crate) fn form(&self) -> &str {
        self.report.as_ref().map_or("gsvx stream", |r| &r.form)
    }

    /// What a scene does not keep of the file, in words.
    pub(crate) fn lost(&self) -> &[String] {
        self.report.as_ref().map_or(&[], |r| &r.lost)
    }
}

/// The whole of a file, or of standard input for `-`.
pub(crate) fn bytes(path: &Path) -> Result<Vec<u8>> {
    if is_stdio(path) {
        let mut all = Vec::new();
        std::io::stdin().lock().read_to_end(&mut all).context(STDIN)?;
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
    if is_stdio(path) { STDIN.into() } else { path.display().to_string() }
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
        Ok(ply::Parts::open(path, &self.options())?)
    }

    /// A model of any format that gs-model reads; a stream is refused. Says what it skipped.
    pub(crate) fn model(&self, path: &Path) -> Result<Loaded> {
        match self.open(path)? {
            Opened::Model(loaded) => Ok(*loaded),
            Opened::Stream(_) => bail!(
                "{}: is a gsvx stream already; to code it again, write it as a model with gsvx decode first",
                name(path)
            ),
        }
    }

    /// Reads a model, or the bytes of a stream.
    fn open(&self, path: &Path) -> Result<Opened> {
        let from = self.from.as_deref();
        let (options, model) = (self.options(), |loaded| Opened::Model(Box::new(loaded)));
        let length = std::fs::metadata(path).ok().filter(|m| m.is_file()).map(|m| m.len());
        if let (None, Some(length)) = (from, length)
            && !starts_like_stream(path)?
        {
            // A plain file need not be in memory whole.
            return Ok(model(Loaded::of_model(model::read(path, &options)?, length)));
        }
        let all = bytes(path)?;
        if from == Some(STREAM) || (from.is_none() && is_stream(&all)) {
            return Ok(Opened::Stream(all));
        }
        let name = name(path);
        let read = match from.and_then(Format::named) {
            Some(format) => format.read(&name, &all, &options)?,
            None => model::read_named(&name, &all, &options)?,
        };
        Ok(model(Loaded::of_model(read, all.len() as u64)))
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
        let opened = self.model.open(path)?;
        if let Opened::Model(loaded) = &opened {
            self.limit.check(path, loaded.scene.len() as u64)?;
        }
        Ok(opened)
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
        let decoded = gsvx::decode_with(all, &options).with_context(|| name(path))?;
        Ok(Loaded { scene: decoded.scene, bytes: all.len() as u64, report: None })
    }
}

impl Limit {
    /// Refuses an input of more Gaussians than asked for.
    pub(crate) fn check(self, path: &Path, gaussians: u64) -> Result<()> {
        match self.max_gaussians {
            Some(limit) if gaussians > limit => {
                let error = gsvx::Error::Limit { points: gaussians, limit };
                Err(error).with_context(|| name(path))
            }
            _ => Ok(()),
        }
    }
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

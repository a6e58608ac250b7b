//! Reading models and streams, from files or standard input.

use crate::exit::{STDIN, note};
use crate::format::{self, STREAM};
use crate::output::is_stdio;
use crate::progress::Meter;
use crate::size;
use anyhow::{Context, Result, bail};
use gs_model::{FileAxes, Format, Invalid, ReadOptions, Report, Scene, model, ply};
use serde::{Deserialize, Serialize};
use std::fs::File;
use std::io::Read;
use std::path::Path;

/// Bytes of a file of which `gsvx info` reads all.
pub(crate) const LARGE: u64 = 2 << 30;

/// How a model is read.
#[derive(clap::Args, Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Reading {
    /// Format of the input, where its name and content do not say: a .splat from a pipe, say.
    #[arg(long, value_name = "FORMAT", value_parser = format::read_name(), hide_short_help = true,
          help_heading = "Input")]
    from: Option<String>,
    /// Leave out Gaussians with NaN, an infinite mean, scale or colour, or a zero quaternion instead of failing, and
    /// those with a log-scale or an SH coefficient beyond +-18900. Infinite opacities and scales of 0 are valid.
    #[arg(long, hide_short_help = true, help_heading = "Input")]
    drop_invalid: bool,
    /// What is done about the axes of SPZ files.
    #[arg(
        long,
        value_name = "HOW",
        default_value = "turn",
        hide_short_help = true,
        help_heading = "Input"
    )]
    pub(crate) axes: Axes,
}

/// What is done about the axes of SPZ files.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum, Serialize, Deserialize)]
pub(crate) enum Axes {
    /// Turned between SPZ (y up, or as the file declares) and the other formats (y down), as SPZ's specification
    /// asks.
    #[default]
    Turn,
    /// Numbers stay as they are, as in Niantic's ply_to_spz and spz_to_ply.
    Keep,
}

/// How a model or a stream is read.
#[derive(clap::Args, Clone, Debug)]
pub(crate) struct ReadingAny {
    #[command(flatten)]
    pub(crate) model: Reading,
    #[command(flatten)]
    pub(crate) limit: Limit,
}

/// How large an input may be.
#[derive(clap::Args, Clone, Copy, Debug, Default)]
pub(crate) struct Limit {
    /// Refuse inputs of more Gaussians than this [default for streams: as many as take 1024 bytes per byte, and 64 MiB more].
    #[arg(long, value_name = "N", value_parser = size::count, hide_short_help = true,
          help_heading = "Input")]
    pub(crate) max_gaussians: Option<u64>,
}

/// A model, and what its file said.
pub(crate) struct LoadedModel {
    pub(crate) scene: Scene,
    /// Length of the file, and of what belongs to it.
    pub(crate) bytes: u64,
    pub(crate) report: Report,
}

/// A file that was opened: the bytes of a stream, or a model.
pub(crate) enum OpenedInput {
    Stream(Vec<u8>),
    Model(Box<LoadedModel>),
}

/// Opens a file.
pub(crate) fn open(path: &Path) -> Result<File> {
    if path.is_dir() {
        let folder = path.display();
        match gs_model::dataset::find_model(path) {
            Ok(model) => bail!("{folder}: is a folder; its model is {}", model.display()),
            Err(_) => bail!(
                "{folder}: is a folder; name the model in it, or pass gsvx encode --fps to make its models a sequence"
            ),
        }
    }
    File::open(path).with_context(|| cannot_read(path))
}

/// The whole of a file, or of standard input for `-`.
pub(crate) fn bytes(path: &Path) -> Result<Vec<u8>> {
    let mut all = Vec::new();
    let read = match is_stdio(path) {
        true => std::io::stdin().lock().read_to_end(&mut all),
        false => open(path)?.read_to_end(&mut all),
    };
    read.with_context(|| cannot_read(path))?;
    Ok(all)
}

/// What a person calls the input.
pub(crate) fn name(path: &Path) -> String {
    if is_stdio(path) { STDIN.into() } else { path.display().to_string() }
}

/// What is said of an input that cannot be read.
pub(crate) fn cannot_read(path: &Path) -> String {
    format!("{}: cannot be read", name(path))
}

impl Reading {
    fn options(&self, max_gaussians: Option<u64>) -> ReadOptions {
        let invalid = if self.drop_invalid { Invalid::Drop } else { Invalid::Error };
        let codec = Some(&gsvx::gltf::CODEC);
        let axes = match self.axes {
            Axes::Turn => FileAxes::Turn,
            Axes::Keep => FileAxes::Keep,
        };
        ReadOptions { invalid, axes, codec, max_gaussians }
    }

    /// A model that can be read some Gaussians at a time; `None` of any other.
    pub(crate) fn parts(&self, path: &Path) -> Result<Option<ply::Parts>> {
        if self.from.is_some() || starts_like_stream(path)? {
            return Ok(None);
        }
        Ok(ply::Parts::open(path, &self.options(None))?)
    }

    /// A model that moves by formulas; `None` of any other.
    pub(crate) fn timed(&self, path: &Path) -> Result<Option<ply::TimedModel>> {
        Ok(ply::TimedModel::open(path, &self.options(None))?)
    }

    /// Whether this is a plain file that holds a stream.
    pub(crate) fn is_stream_file(&self, path: &Path) -> Result<bool> {
        let says = self.from.as_deref().is_none_or(|from| from == STREAM);
        Ok(says && path.is_file() && !is_stdio(path) && starts_like_stream(path)?)
    }

    /// A model of which only the head is to be described, because there is so much of it.
    pub(crate) fn large(&self, path: &Path) -> Result<Option<ply::Parts>> {
        let is_large = std::fs::metadata(path).is_ok_and(|m| m.is_file() && m.len() > LARGE);
        if is_large { self.parts(path) } else { Ok(None) }
    }

    /// A model of any format that gs-model reads; a stream is refused. Says what its file held if `say`.
    pub(crate) fn model(&self, path: &Path, say: bool) -> Result<LoadedModel> {
        self.only_model(path, &self.options(None), say)
    }

    /// As [`Reading::model`], with every value as it is in the file unless invalid Gaussians are left out.
    pub(crate) fn exact_model(&self, path: &Path) -> Result<LoadedModel> {
        let mut options = self.options(None);
        if !self.drop_invalid {
            options.invalid = Invalid::Keep;
        }
        self.only_model(path, &options, true)
    }

    fn only_model(&self, path: &Path, options: &ReadOptions, say: bool) -> Result<LoadedModel> {
        match self.open(path, options)? {
            OpenedInput::Model(loaded) => {
                if say {
                    say_notes(path, &loaded.report);
                }
                Ok(*loaded)
            }
            OpenedInput::Stream(_) => bail!(
                "{}: is a gsvx stream already; to code it again, write it as a model with gsvx decode first",
                name(path)
            ),
        }
    }

    /// Reads a model, or the bytes of a stream.
    fn open(&self, path: &Path, options: &ReadOptions) -> Result<OpenedInput> {
        let from = self.from.as_deref();
        let reading = Meter::spinner(format!("reading {}", name(path)));
        let length = std::fs::metadata(path).ok().filter(|m| m.is_file()).map(|m| m.len());
        let ((scene, report), bytes) = if let (None, Some(length)) = (from, length)
            && !starts_like_stream(path)?
        {
            // A plain file need not be in memory whole.
            (model::read(path, options)?, length)
        } else {
            let all = bytes(path)?;
            if from == Some(STREAM) || (from.is_none() && is_stream(&all)) {
                return Ok(OpenedInput::Stream(all));
            }
            let read = match from.and_then(Format::named) {
                Some(format) => format.read(name(path), &all, options)?,
                None => model::read_named(name(path), &all, options)?,
            };
            (read, all.len() as u64)
        };
        drop(reading);
        let bytes = bytes + report.bytes_beside;
        Ok(OpenedInput::Model(Box::new(LoadedModel { scene, bytes, report })))
    }
}

/// A model as every command reads it that is given no flags about that.
pub(crate) fn strict(path: &Path) -> Result<LoadedModel> {
    Reading::default().model(path, true)
}

/// Opens a file of any format, without its invalid Gaussians.
pub(crate) fn lenient(path: &Path) -> Result<OpenedInput> {
    let reading = Reading { drop_invalid: true, ..Reading::default() };
    reading.open(path, &reading.options(None))
}

/// Says what a file held that its model has not, and what was read as something else.
pub(crate) fn say_notes(path: &Path, report: &Report) {
    for said in &report.warnings {
        note(format_args!("warning: {}: {said}", name(path)));
    }
    for said in &report.notes {
        note(format_args!("note: {}: {said}", name(path)));
    }
}

impl ReadingAny {
    /// Reads a model, or the bytes of a stream.
    pub(crate) fn open(&self, path: &Path) -> Result<OpenedInput> {
        let opened = self.model.open(path, &self.model.options(self.limit.max_gaussians))?;
        if let OpenedInput::Model(loaded) = &opened {
            say_notes(path, &loaded.report);
            self.limit.check(path, loaded.scene.len() as u64)?;
        }
        Ok(opened)
    }

    /// A model of any format, streams included, and what its file held; nothing is said of a stream's.
    pub(crate) fn any(&self, path: &Path) -> Result<(Scene, Report)> {
        let bytes = match self.open(path)? {
            OpenedInput::Stream(bytes) => bytes,
            OpenedInput::Model(loaded) => return Ok((loaded.scene, loaded.report)),
        };
        let mut options = gsvx::DecodeOptions::default();
        options.max_gaussians = self.limit.max_gaussians;
        let decoded = gsvx::decode_with(&bytes, &options).with_context(|| name(path))?;
        Ok((decoded.scene, Report::default()))
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
    let mut start = Vec::new();
    let file = open(path)?.take(gsvx::SIGNATURE.len() as u64).read_to_end(&mut start);
    file.with_context(|| cannot_read(path))?;
    Ok(is_stream(&start))
}

/// True for the bytes of a stream, also where it is cut within its signature.
fn is_stream(bytes: &[u8]) -> bool {
    let signature = &gsvx::SIGNATURE;
    bytes.starts_with(signature) || (!bytes.is_empty() && signature.starts_with(bytes))
}

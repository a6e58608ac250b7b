//! The frames of a sequence: in a stream, or one model each.

use crate::exit::usage;
use crate::input::{self, LoadedModel, Reading, ReadingAny};
use crate::output::is_stdio;
use crate::stream_file::StreamBytes;
use anyhow::{Context, Result, ensure};
use gs_model::ply::TimedModel;
use gs_model::{Format, Scene};
use gsvx::Source;
use gsvx::sequence::{Frames, Sequence, is_sequence};
use std::path::{Path, PathBuf};

/// The models of frames in order: those of a folder, or those given, by the last number in their names.
pub(crate) fn frames(inputs: &[PathBuf]) -> Result<Vec<PathBuf>> {
    let mut all = Vec::new();
    for input in inputs {
        match folder(input)? {
            None => all.push(input.clone()),
            Some(models) => {
                ensure!(!models.is_empty(), "{}: holds no model", input.display());
                all.extend(models);
            }
        }
    }
    if all.iter().any(|path| is_stdio(path)) {
        return Err(usage("frames are files, not standard input"));
    }
    all.sort_by_cached_key(|path| (number(path), path.clone()));
    for pair in all.windows(2) {
        let [a, b] = [pair[0].display(), pair[1].display()];
        if let (Some(first), Some(next)) = (number(&pair[0]), number(&pair[1])) {
            ensure!(next != first, "{a} and {b} have the same number");
            let missing = first + 1;
            ensure!(
                next == missing,
                "frame {missing} is missing between {a} and {b}; number the frames without a gap"
            );
        }
        ensure!(
            pair[0].extension() == pair[1].extension(),
            "{a} and {b} are of different formats; the frames of a sequence are of one"
        );
    }
    Ok(all)
}

/// Whether models are numbered as frames are.
pub(crate) fn are_numbered(models: &[PathBuf]) -> bool {
    models.iter().all(|path| number(path).is_some()) && frames(models).is_ok()
}

/// What `gsvx encode` makes a sequence of.
pub(crate) enum EncodeFrames {
    /// A model for each frame.
    Models(Vec<PathBuf>),
    /// A model that moves, at so many times.
    Timed { path: PathBuf, model: Box<TimedModel>, count: u32 },
}

/// A frame to encode.
pub(crate) struct InputFrame {
    pub(crate) scene: Scene,
    /// Which Gaussians are there, where rows are the same Gaussians in all frames.
    pub(crate) there: Option<Vec<bool>>,
    /// Bytes of its file.
    pub(crate) bytes: u64,
}

impl EncodeFrames {
    /// Of a model that moves, of which `count` frames are wanted, or of models as [`frames`] finds them.
    pub(crate) fn open(inputs: &[PathBuf], reading: &Reading, count: Option<u32>) -> Result<Self> {
        if let [path] = inputs
            && path.is_file()
            && let Some(model) = reading.timed(path)?
        {
            let name = path.display();
            let Some(count) = count.or(model.frames).filter(|&count| count > 1) else {
                return Err(usage(format!(
                    "{name}: a sequence has two frames or more; pass their number as --frames"
                )));
            };
            return Ok(Self::Timed { path: path.clone(), model: Box::new(model), count });
        }
        if count.is_some() {
            return Err(usage("--frames is for one PLY of Gaussians that move by formulas"));
        }
        frames(inputs).map(Self::Models)
    }

    pub(crate) fn len(&self) -> usize {
        match self {
            Self::Models(models) => models.len(),
            Self::Timed { count, .. } => *count as usize,
        }
    }

    /// The files.
    pub(crate) fn paths(&self) -> &[PathBuf] {
        match self {
            Self::Models(models) => models,
            Self::Timed { path, .. } => std::slice::from_ref(path),
        }
    }

    /// What a person calls a frame.
    pub(crate) fn name(&self, number: usize) -> String {
        match self {
            Self::Models(models) => input::name(&models[number]),
            Self::Timed { path, .. } => format!("{}: frame {number}", path.display()),
        }
    }

    /// A frame. Says what its file held if `say`.
    pub(crate) fn frame(&self, number: usize, reading: &Reading, say: bool) -> Result<InputFrame> {
        match self {
            Self::Models(models) => {
                let LoadedModel { scene, bytes, .. } = reading.model(&models[number], say)?;
                Ok(InputFrame { scene, there: None, bytes })
            }
            Self::Timed { path, model, count } => {
                let (scene, there) = model.frame(number as u32, *count);
                let bytes = if number == 0 { path.metadata().map_or(0, |m| m.len()) } else { 0 };
                Ok(InputFrame { scene, there: Some(there), bytes })
            }
        }
    }
}

/// The Gaussians that are there.
pub(crate) fn only(mut scene: Scene, there: &[bool]) -> Scene {
    scene.keep(&(0..there.len()).filter(|&i| there[i]).collect::<Vec<_>>());
    scene
}

/// The last number in the name of a file.
fn number(path: &Path) -> Option<u64> {
    let name = path.file_name()?.to_str()?.split('.').next()?;
    let end = name.rfind(|c: char| c.is_ascii_digit())? + 1;
    let start = name[..end].rfind(|c: char| !c.is_ascii_digit()).map_or(0, |at| at + 1);
    name.get(start..end)?.parse().ok()
}

/// The models in a folder; `None` of anything else.
fn folder(path: &Path) -> Result<Option<Vec<PathBuf>>> {
    if !path.is_dir() {
        return Ok(None);
    }
    let list = std::fs::read_dir(path).with_context(|| input::cannot_read(path))?;
    let mut models = Vec::new();
    for entry in list {
        let path = entry.with_context(|| input::cannot_read(path))?.path();
        if Format::of_name(&path).is_some() {
            models.push(path);
        }
    }
    Ok(Some(models))
}

/// The files that a name with `*`, `?` or `[` stands for; none if it is that of a file.
fn globbed(path: &Path) -> Vec<PathBuf> {
    let pattern = path.to_str().filter(|name| name.contains(['*', '?', '[']) && !path.exists());
    let found = pattern.and_then(|pattern| glob::glob(pattern).ok());
    found.into_iter().flatten().filter_map(Result::ok).collect()
}

/// Whether a file holds a sequence.
pub(crate) fn is_file(path: &Path) -> bool {
    let file = path.is_file().then(|| StreamBytes::open(path).ok()).flatten();
    file.is_some_and(|file| file.read(0..file.len().min(9)).is_ok_and(|start| is_sequence(&start)))
}

/// Frames that can be had one by one.
pub(crate) struct FrameSource<'a> {
    path: &'a Path,
    reading: &'a ReadingAny,
    content: FrameContent,
}

enum FrameContent {
    /// A model that moves by formulas, at so many times.
    Timed {
        model: Box<TimedModel>,
        count: u64,
    },
    Stream {
        bytes: Vec<u8>,
        sequence: Sequence,
        /// The group that was decoded last.
        group: Option<Box<(usize, Frames)>>,
    },
    Models(Vec<PathBuf>),
}

/// Whether a path is that of a sequence: a stream of one, a model that moves, a folder with models, or a name that stands
/// for files.
pub(crate) fn is_sequence_path(path: &Path, reading: &Reading) -> Result<bool> {
    let models = folder(path)?.is_some_and(|models| !models.is_empty());
    let moves = path.is_file() && reading.timed(path)?.is_some();
    Ok(models || moves || is_file(path) || !globbed(path).is_empty())
}

impl<'a> FrameSource<'a> {
    /// Of a sequence, or of a single model or static stream as the only frame.
    pub(crate) fn open(path: &'a Path, reading: &'a ReadingAny) -> Result<Self> {
        let content = if is_file(path) {
            let bytes = input::bytes(path)?;
            let sequence = Sequence::parse(&bytes).with_context(|| input::name(path))?;
            FrameContent::Stream { bytes, sequence, group: None }
        } else if path.is_file()
            && let Some(model) = reading.model.timed(path)?
        {
            let count = model.frames.unwrap_or(0).into();
            FrameContent::Timed { model: Box::new(model), count }
        } else {
            let mut models = globbed(path);
            if models.is_empty() {
                models.push(path.to_owned());
            }
            if models.len() > 1 || path.is_dir() {
                models = frames(&models)?;
            }
            FrameContent::Models(models)
        };
        Ok(Self { path, reading, content })
    }

    /// Makes a model that moves have as many frames as `other`, which does not, or which knows their number.
    pub(crate) fn follow(&mut self, other: &Self) {
        let knows = !matches!(other.content, FrameContent::Timed { .. });
        if let FrameContent::Timed { count, .. } = &mut self.content
            && (knows || *count == 0)
        {
            *count = other.len();
        }
    }

    /// The number of frames; 0 of a model that moves and does not state it.
    pub(crate) fn len(&self) -> u64 {
        match &self.content {
            FrameContent::Timed { count, .. } => *count,
            FrameContent::Stream { sequence, .. } => sequence.frames(),
            FrameContent::Models(models) => models.len() as u64,
        }
    }

    /// What was opened.
    pub(crate) fn path(&self) -> &Path {
        self.path
    }

    /// A frame, from 0 to below [`FrameSource::len`].
    pub(crate) fn frame(&mut self, number: u64) -> Result<Scene> {
        let (bytes, sequence, last) = match &mut self.content {
            FrameContent::Timed { model, count } => {
                let (scene, there) = model.frame(number as u32, *count as u32);
                return Ok(only(scene, &there));
            }
            FrameContent::Models(models) => {
                return Ok(self.reading.any(&models[number as usize])?.0);
            }
            FrameContent::Stream { bytes, sequence, group } => (bytes, sequence, group),
        };
        let name = || input::name(self.path);
        let wanted = sequence.group_of(number).with_context(name)?;
        let group = match last.take() {
            Some(last) if last.0 == wanted => last,
            _ => {
                let most = self.reading.limit.max_gaussians;
                Box::new((wanted, sequence.group(bytes, wanted, most).with_context(name)?))
            }
        };
        let within = number - sequence.groups[wanted].frames.start;
        let group = last.insert(group);
        Ok(group.1.frame(within as usize))
    }
}

/// So many of `count` numbers from 0 on, evenly spaced; all if there are fewer.
pub(crate) fn evenly(count: u64, wanted: u64) -> Vec<u64> {
    let wanted = wanted.min(count);
    (0..wanted).map(|i| i * (count - 1) / (wanted - 1).max(1)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_spaced_evenly() {
        assert_eq!(evenly(59, 5), [0, 14, 29, 43, 58]);
        assert_eq!(evenly(3, 5), [0, 1, 2]);
        assert_eq!(evenly(1, 5), [0]);
        assert!(evenly(0, 5).is_empty());
    }
}

//! Checkpoints: everything that a run needs to go on to the same bytes.
//!
//! Little-endian: magic, version (u32), fingerprint (u32), then the sections of the stage under way,
//! each a length (u64) and its numbers; CRC-32C of all before it (u32). A file is written beside the old
//! one and renamed, so that an interruption leaves one of both.

use std::path::Path;

use finetune::optimiser::AdamMoments;
use gs_model::{Camera, Scene};

use crate::error::{Error, Result};

const MAGIC: [u8; 8] = *b"GSTUNECK";
const VERSION: u32 = 3;

/// A checksum of what a checkpoint must share with the run that goes on from it. `options` says in words what
/// else they share. A view is a camera and a photo.
pub(crate) fn fingerprint<'a>(
    scene: &Scene,
    views: impl IntoIterator<Item = (&'a Camera, &'a [u8])>,
    options: &str,
) -> u32 {
    let mut crc = 0;
    let mut add = |bytes: &[u8]| crc = crc32c::crc32c_append(crc, bytes);
    add(format!("{options} {}", scene.sh_degree).as_bytes());
    for array in [scene.means.as_flattened(), &scene.opacity_logits, scene.sh.as_flattened()] {
        array.iter().for_each(|v| add(&v.to_le_bytes()));
    }
    for (c, photo) in views {
        add(&[c.width.to_le_bytes(), c.height.to_le_bytes()].concat());
        let matrix = c.rotation.to_cols_array();
        let numbers = [c.fx, c.fy, c.cx, c.cy].into_iter().chain(matrix);
        numbers.chain(c.translation.to_array()).for_each(|v| add(&v.to_le_bytes()));
        photo.iter().step_by(97).for_each(|&v| add(&[v]));
    }
    crc
}

/// A checkpoint that is being put together.
pub(crate) struct StateWriter(Vec<u8>);

impl StateWriter {
    pub(crate) fn new(fingerprint: u32) -> Self {
        let mut out = MAGIC.to_vec();
        out.extend(VERSION.to_le_bytes());
        out.extend(fingerprint.to_le_bytes());
        Self(out)
    }

    fn list<const N: usize>(&mut self, values: impl ExactSizeIterator<Item = [u8; N]>) {
        self.0.extend((values.len() as u64).to_le_bytes());
        values.for_each(|v| self.0.extend(v));
    }

    pub(crate) fn numbers(&mut self, values: &[f64]) {
        self.list(values.iter().map(|v| v.to_le_bytes()));
    }

    pub(crate) fn integers(&mut self, values: &[u64]) {
        self.list(values.iter().map(|v| v.to_le_bytes()));
    }

    pub(crate) fn floats(&mut self, values: &[f32]) {
        self.list(values.iter().map(|v| v.to_le_bytes()));
    }

    pub(crate) fn moments(&mut self, moments: &AdamMoments) {
        self.floats(&moments.first);
        self.floats(&moments.second);
    }

    pub(crate) fn steps(&mut self, steps: &[u32]) {
        self.list(steps.iter().map(|v| v.to_le_bytes()));
    }

    pub(crate) fn scene(&mut self, scene: &Scene) {
        self.integers(&[scene.sh_degree.into(), scene.len() as u64, scene.antialiased.into()]);
        self.numbers(&scene.origin);
        for array in [
            scene.means.as_flattened(),
            scene.rotations.as_flattened(),
            scene.log_scales.as_flattened(),
            &scene.opacity_logits,
            scene.sh.as_flattened(),
        ] {
            self.floats(array);
        }
    }

    /// The file.
    pub(crate) fn finish(mut self) -> Vec<u8> {
        let crc = crc32c::crc32c(&self.0);
        self.0.extend(crc.to_le_bytes());
        self.0
    }
}

/// Writes a checkpoint.
pub(crate) fn save(path: &Path, bytes: &[u8]) -> Result<()> {
    let mut name = path.file_name().unwrap_or_default().to_os_string();
    name.push(".tmp");
    let temporary = path.with_file_name(name);
    let written = std::fs::write(&temporary, bytes)
        .map_err(io(&temporary, "write"))
        .and_then(|()| std::fs::rename(&temporary, path).map_err(io(path, "rename")));
    if written.is_err() {
        // A partial checkpoint is useless and takes space.
        let _ = std::fs::remove_file(&temporary);
    }
    written
}

fn io(file: &Path, action: &'static str) -> impl FnOnce(std::io::Error) -> Error {
    let file = file.to_owned();
    move |source| Error::Io { file, action, source }
}

/// A checkpoint that is being taken apart.
pub(crate) struct StateReader<'a> {
    path: &'a Path,
    bytes: Vec<u8>,
    at: usize,
}

impl<'a> StateReader<'a> {
    /// Opens a checkpoint of the run with this fingerprint.
    pub(crate) fn open(path: &'a Path, fingerprint: u32) -> Result<Self> {
        Self::new(path, std::fs::read(path).map_err(io(path, "read"))?, fingerprint)
    }

    /// As [`StateReader::open`], of what is in memory.
    pub(crate) fn new(path: &'a Path, bytes: Vec<u8>, fingerprint: u32) -> Result<Self> {
        let mut this = Self { path, bytes, at: 0 };
        if this.take::<8>()? != MAGIC || u32::from_le_bytes(this.take()?) != VERSION {
            return Err(this.error("it does not start as a checkpoint of a tune"));
        }
        let body = this.bytes.len().saturating_sub(4);
        let crc = crc32c::crc32c(&this.bytes[..body]);
        if this.bytes.split_off(body) != crc.to_le_bytes() {
            return Err(this.error("checksum does not match"));
        }
        if u32::from_le_bytes(this.take()?) != fingerprint {
            return Err(Error::OtherRun { file: path.into() });
        }
        Ok(this)
    }

    pub(crate) fn error(&self, reason: &'static str) -> Error {
        let (file, offset) = (self.path.into(), self.at as u64);
        Error::Checkpoint { file, offset, reason, source: None }
    }

    /// As [`StateReader::error`], of what was refused.
    pub(crate) fn refused(
        &self,
        reason: &'static str,
        cause: impl std::error::Error + Send + Sync + 'static,
    ) -> Error {
        let (file, offset) = (self.path.into(), self.at as u64);
        Error::Checkpoint { file, offset, reason, source: Some(Box::new(cause)) }
    }

    fn take<const N: usize>(&mut self) -> Result<[u8; N]> {
        match self.bytes.get(self.at..).and_then(|rest| rest.first_chunk::<N>()) {
            Some(chunk) => {
                self.at += N;
                Ok(*chunk)
            }
            None => Err(self.error("truncated")),
        }
    }

    fn list<const N: usize, T>(&mut self, of: impl Fn([u8; N]) -> T) -> Result<Vec<T>> {
        let n = u64::from_le_bytes(self.take()?);
        if n > ((self.bytes.len() - self.at) / N) as u64 {
            return Err(self.error("list longer than the file"));
        }
        (0..n).map(|_| self.take().map(&of)).collect()
    }

    pub(crate) fn numbers(&mut self) -> Result<Vec<f64>> {
        self.list(f64::from_le_bytes)
    }

    pub(crate) fn integers(&mut self) -> Result<Vec<u64>> {
        self.list(u64::from_le_bytes)
    }

    pub(crate) fn floats(&mut self) -> Result<Vec<f32>> {
        self.list(f32::from_le_bytes)
    }

    fn rows<const N: usize>(&mut self) -> Result<Vec<[f32; N]>> {
        Ok(self.floats()?.as_chunks::<N>().0.to_vec())
    }

    pub(crate) fn scene(&mut self) -> Result<Scene> {
        let head = self.integers()?;
        let [degree @ 0..=3, n, antialiased] = head[..] else {
            return Err(self.error("head of a scene"));
        };
        let [x, y, z] = self.numbers()?[..] else {
            return Err(self.error("origin of a scene"));
        };
        let scene = Scene {
            sh_degree: degree as u8,
            means: self.rows()?,
            rotations: self.rows()?,
            log_scales: self.rows()?,
            opacity_logits: self.floats()?,
            sh: self.rows()?,
            antialiased: antialiased != 0,
            origin: [x, y, z],
        };
        scene.validate().map_err(|e| self.refused("a scene that is not valid", e))?;
        if scene.len() as u64 == n { Ok(scene) } else { Err(self.error("length of a scene")) }
    }

    /// Reads `len` numbers of steps.
    pub(crate) fn steps(&mut self, len: usize) -> Result<Vec<u32>> {
        let read = self.list(u32::from_le_bytes)?;
        if read.len() == len { Ok(read) } else { Err(self.error("steps differ in number")) }
    }

    /// Moments of so many parameters.
    pub(crate) fn moments(&mut self, len: usize) -> Result<AdamMoments> {
        let read = AdamMoments { first: self.floats()?, second: self.floats()? };
        if [read.first.len(), read.second.len()] != [len; 2] {
            return Err(self.error("moments differ in number"));
        }
        Ok(read)
    }
}

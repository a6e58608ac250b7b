//! Checkpoints: everything that a run needs to continue with the same result, bit for bit.
//!
//! Little-endian: magic, version (u32), fingerprint (u64), Gaussians (u64), SH degree (u32),
//! step (u64), epochs (u32) and their PSNRs (f64), steps of the epoch under way (u32) and their
//! PSNRs (f64); then f32 arrays: means, rotations, log-scales, opacity logits, SH, and the two
//! moments of SH, opacity, log-scale, rotation; CRC-32C of all before it (u32).

use std::path::Path;

use gs_model::Scene;

use super::progress::Tracker;
use super::view::TrainView;
use crate::error::{Error, Result};
use crate::stages::adam::Moments;

const MAGIC: [u8; 8] = *b"GSFTCKPT";
const VERSION: u32 = 1;

/// State of a run between two steps.
#[derive(Clone)]
pub(crate) struct Checkpoint {
    pub(crate) step: u64,
    pub(crate) tracker: Tracker,
    pub(crate) moments: Moments,
    pub(crate) scene: Scene,
}

/// FNV-1a over what a checkpoint must share with the run that continues it: the means, the SH
/// degree, and the cameras. Options may differ.
pub(crate) fn fingerprint(scene: &Scene, views: &[TrainView]) -> u64 {
    let mut hash = 0xcbf2_9ce4_8422_2325u64;
    let mut add = |bits: u64| {
        for byte in bits.to_le_bytes() {
            hash = (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3);
        }
    };
    add(scene.len() as u64);
    add(u64::from(scene.sh_degree));
    for v in scene.means.as_flattened() {
        add(u64::from(v.to_bits()));
    }
    for v in views {
        let c = &v.camera;
        add((u64::from(c.width) << 32) | u64::from(c.height));
        for p in [c.fx, c.fy, c.cx, c.cy].iter().chain(&c.rotation.to_cols_array()) {
            add(p.to_bits());
        }
        for p in c.translation.to_array() {
            add(p.to_bits());
        }
    }
    hash
}

impl Checkpoint {
    /// A run on `scene` with `views` views that has not begun.
    pub(crate) fn start(scene: Scene, views: usize) -> Self {
        let moments = Moments::zeros(&scene);
        Self { step: 0, tracker: Tracker::new(views), moments, scene }
    }

    /// Writes to a temporary file beside `path` and renames it, so that an interruption leaves the
    /// previous checkpoint or the new one.
    pub(crate) fn write(&self, path: &Path, fingerprint: u64) -> Result<()> {
        let mut out = Vec::new();
        out.extend(MAGIC);
        out.extend(VERSION.to_le_bytes());
        out.extend(fingerprint.to_le_bytes());
        out.extend((self.scene.len() as u64).to_le_bytes());
        out.extend(u32::from(self.scene.sh_degree).to_le_bytes());
        out.extend(self.step.to_le_bytes());
        for list in [&self.tracker.epochs, &self.tracker.current] {
            out.extend((list.len() as u32).to_le_bytes());
            list.iter().for_each(|v| out.extend(v.to_le_bytes()));
        }
        let s = &self.scene;
        let scene: [&[f32]; 5] = [
            s.means.as_flattened(),
            s.rotations.as_flattened(),
            s.log_scales.as_flattened(),
            &s.opacity_logits,
            s.sh.as_flattened(),
        ];
        for array in scene.into_iter().chain(self.moments.arrays().map(Vec::as_slice)) {
            array.iter().for_each(|v| out.extend(v.to_le_bytes()));
        }
        let crc = crc32c::crc32c(&out);
        out.extend(crc.to_le_bytes());
        let mut name = path.file_name().unwrap_or_default().to_os_string();
        name.push(".tmp");
        let temporary = path.with_file_name(name);
        let written = std::fs::write(&temporary, &out)
            .map_err(Error::io(&temporary, "write"))
            .and_then(|()| std::fs::rename(&temporary, path).map_err(Error::io(path, "rename")));
        if written.is_err() {
            // A partial checkpoint is useless and takes space.
            let _ = std::fs::remove_file(&temporary);
        }
        written
    }

    /// Reads a checkpoint of the run that would otherwise begin at `start`; its arrays have the
    /// lengths to expect, so that the file's counts are never trusted with an allocation.
    pub(crate) fn read(path: &Path, fingerprint: u64, start: Self) -> Result<Self> {
        let bytes = std::fs::read(path).map_err(Error::io(path, "read"))?;
        Self::parse(path, &bytes, fingerprint, start)
    }

    /// As [`Checkpoint::read`], of a file that is in memory.
    pub(crate) fn parse(
        path: &Path,
        bytes: &[u8],
        fingerprint: u64,
        mut start: Self,
    ) -> Result<Self> {
        let mut r = Reader { path, bytes, at: 0 };
        if r.take::<8>()? != MAGIC {
            return Err(r.error("it does not start as a checkpoint"));
        }
        if r.u32()? != VERSION {
            return Err(r.error("unknown version"));
        }
        let body = bytes.len().saturating_sub(4);
        let stored = bytes[body..].iter().rev().fold(0u32, |a, &b| (a << 8) | u32::from(b));
        if crc32c::crc32c(&bytes[..body]) != stored {
            return Err(Error::Checkpoint {
                file: path.into(),
                offset: body as u64,
                reason: "checksum does not match",
            });
        }
        if r.u64()? != fingerprint {
            let reason = format!("{} has other means or other cameras", path.display());
            return Err(Error::CheckpointMismatch { reason });
        }
        let (n, degree) = (r.u64()?, r.u32()?);
        if n != start.scene.len() as u64 || degree != u32::from(start.scene.sh_degree) {
            return Err(r.error("other number of Gaussians or SH degree"));
        }
        start.step = r.u64()?;
        let epochs = r.f64_list()?;
        let current = r.f64_list()?;
        // An epoch ends when its length is reached, so a longer one would never end.
        if current.len() >= start.tracker.views {
            return Err(r.error("more steps in an epoch than views"));
        }
        start.tracker.resume(epochs, current);
        let s = &mut start.scene;
        let scene: [&mut [f32]; 5] = [
            s.means.as_flattened_mut(),
            s.rotations.as_flattened_mut(),
            s.log_scales.as_flattened_mut(),
            &mut s.opacity_logits,
            s.sh.as_flattened_mut(),
        ];
        for array in scene {
            r.f32_array(array)?;
        }
        for array in start.moments.arrays_mut() {
            r.f32_array(array)?;
        }
        if r.at != body {
            return Err(r.error("bytes left over"));
        }
        start.scene.validate()?;
        Ok(start)
    }
}

struct Reader<'a> {
    path: &'a Path,
    bytes: &'a [u8],
    at: usize,
}

impl Reader<'_> {
    fn error(&self, reason: &'static str) -> Error {
        Error::Checkpoint { file: self.path.into(), offset: self.at as u64, reason }
    }

    fn take<const N: usize>(&mut self) -> Result<[u8; N]> {
        match self.bytes[self.at..].first_chunk::<N>() {
            Some(chunk) => {
                self.at += N;
                Ok(*chunk)
            }
            None => Err(self.error("truncated")),
        }
    }

    fn u32(&mut self) -> Result<u32> {
        self.take().map(u32::from_le_bytes)
    }

    fn u64(&mut self) -> Result<u64> {
        self.take().map(u64::from_le_bytes)
    }

    fn f64_list(&mut self) -> Result<Vec<f64>> {
        let n = self.u32()? as usize;
        if n > (self.bytes.len() - self.at) / 8 {
            return Err(self.error("list longer than the file"));
        }
        (0..n).map(|_| self.take().map(f64::from_le_bytes)).collect()
    }

    fn f32_array(&mut self, out: &mut [f32]) -> Result<()> {
        for v in out {
            *v = f32::from_le_bytes(self.take()?);
        }
        Ok(())
    }
}

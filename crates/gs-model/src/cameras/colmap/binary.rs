//! The `.bin` files: little-endian, packed, each a `u64` count and its entries.

use std::path::Path;

use super::entries::{CameraModel, Intrinsics, MODELS, Point, PosedImage, unknown_model};
use crate::cameras::camera;
use crate::error::{Error, Result, excerpt};

/// A position in a file whose numbers of entries are promises.
struct Cursor<'a> {
    file: &'a Path,
    bytes: &'a [u8],
    at: usize,
    promised: u64,
}

impl<'a> Cursor<'a> {
    /// Reads the count at the start of a file, and an empty vector for the entries.
    ///
    /// The vector has room for no more entries than fit in the file at `least` bytes each.
    fn open<T>(file: &'a Path, bytes: &'a [u8], least: usize) -> Result<(Self, Vec<T>)> {
        let mut cursor = Self { file, bytes, at: 0, promised: 0 };
        cursor.promised = u64::from_le_bytes(cursor.take("the number of entries")?);
        let fitting = (bytes.len() - cursor.at) / least;
        let room = usize::try_from(cursor.promised).unwrap_or(usize::MAX).min(fitting);
        Ok((cursor, Vec::with_capacity(room)))
    }

    fn take<const N: usize>(&mut self, what: &'static str) -> Result<[u8; N]> {
        let mut out = [0; N];
        out.copy_from_slice(self.slice(N, what)?);
        Ok(out)
    }

    fn slice(&mut self, len: usize, what: &'static str) -> Result<&'a [u8]> {
        let rest = &self.bytes[self.at..];
        let Some(found) = rest.get(..len) else { return Err(self.truncated(what)) };
        self.at += len;
        Ok(found)
    }

    /// Skips `count` entries of `size` bytes.
    fn skip(&mut self, count: u64, size: usize, what: &'static str) -> Result<()> {
        // A length that overflows cannot fit either.
        let len = usize::try_from(count).ok().and_then(|c| c.checked_mul(size));
        self.slice(len.unwrap_or(usize::MAX), what).map(|_| ())
    }

    fn u32(&mut self, what: &'static str) -> Result<u32> {
        self.take(what).map(u32::from_le_bytes)
    }

    fn u64(&mut self, what: &'static str) -> Result<u64> {
        self.take(what).map(u64::from_le_bytes)
    }

    fn f64(&mut self, what: &'static str) -> Result<f64> {
        self.take(what).map(f64::from_le_bytes)
    }

    fn f64s<const N: usize>(&mut self, what: &'static str) -> Result<[f64; N]> {
        let mut out = [0.0; N];
        for v in &mut out {
            *v = self.f64(what)?;
        }
        Ok(out)
    }

    /// A string that ends with a zero byte.
    fn string(&mut self, what: &'static str) -> Result<&'a [u8]> {
        let rest = &self.bytes[self.at..];
        let Some(len) = rest.iter().position(|&b| b == 0) else { return Err(self.truncated(what)) };
        self.at += len + 1;
        Ok(&rest[..len])
    }

    fn truncated(&self, what: &'static str) -> Error {
        let Self { file, bytes, at, promised } = self;
        let missing =
            format!("the header promises {promised} entries, but {what} at byte {at} is missing");
        Error::truncated(file, bytes.len(), missing)
    }
}

pub(super) fn cameras(file: &Path, bytes: &[u8]) -> Result<Vec<Intrinsics>> {
    let (mut cursor, mut cameras) = Cursor::open(file, bytes, 48)?;
    for _ in 0..cursor.promised {
        let id = cursor.u32("a camera id")?;
        let model = cursor.u32("a camera model")?;
        let Some(model) = Some(model as usize).filter(|&m| m < MODELS.len()).map(CameraModel)
        else {
            // The number of its parameters is not known, so nothing after it can be read.
            return Err(unknown_model(file, id, &model.to_string()));
        };
        let width = cursor.u64("a camera's width")?;
        let height = cursor.u64("a camera's height")?;
        let params = (0..model.params()).map(|_| cursor.f64("a camera's parameters"));
        let params = params.collect::<Result<_>>()?;
        cameras.push(Intrinsics { id, model, width, height, params });
    }
    Ok(cameras)
}

pub(super) fn images(file: &Path, bytes: &[u8]) -> Result<Vec<PosedImage>> {
    let (mut cursor, mut images) = Cursor::open(file, bytes, 73)?;
    for _ in 0..cursor.promised {
        cursor.u32("an image id")?;
        let rotation = cursor.f64s("an image's rotation")?;
        let translation = cursor.f64s("an image's translation")?;
        let camera = cursor.u32("an image's camera id")?;
        let name = cursor.string("an image's name")?;
        let Ok(name) = std::str::from_utf8(name).map(str::to_owned) else {
            return Err(camera::bad(file, excerpt(name), "name is not UTF-8"));
        };
        let observations = cursor.u64("an image's number of points")?;
        cursor.skip(observations, 24, "an image's points")?;
        images.push(PosedImage { name, camera, rotation, translation });
    }
    Ok(images)
}

pub(super) fn points(file: &Path, bytes: &[u8]) -> Result<Vec<Point>> {
    let (mut cursor, mut points) = Cursor::open(file, bytes, 51)?;
    for _ in 0..cursor.promised {
        cursor.u64("a point's id")?;
        let position = cursor.f64s("a point's position")?;
        let colour = cursor.take("a point's colour")?;
        cursor.f64s::<1>("a point's error")?;
        let observations = cursor.u64("a point's number of images")?;
        cursor.skip(observations, 8, "a point's images")?;
        points.push(Point { position, colour });
    }
    Ok(points)
}

//! The `.txt` files: words separated by white space, `#` starts a comment line.

use std::path::Path;
use std::str::FromStr;

use super::entries::{CameraModel, Intrinsics, MODELS, Point, PosedImage, unknown_model};
use crate::error::{Error, Result, excerpt};

/// One line, taken apart word by word.
struct Line<'a> {
    file: &'a Path,
    number: usize,
    whole: &'a [u8],
    rest: &'a [u8],
}

impl<'a> Line<'a> {
    fn word(&mut self) -> &'a [u8] {
        let text = self.rest.trim_ascii_start();
        let end = text.iter().position(u8::is_ascii_whitespace).unwrap_or(text.len());
        self.rest = &text[end..];
        &text[..end]
    }

    fn next<T: FromStr>(&mut self, what: &'static str) -> Result<T> {
        let word = std::str::from_utf8(self.word()).ok();
        word.and_then(|w| w.parse().ok()).ok_or_else(|| self.error(what))
    }

    fn f64s<const N: usize>(&mut self, what: &'static str) -> Result<[f64; N]> {
        let mut out = [0.0; N];
        for v in &mut out {
            *v = self.next(what)?;
        }
        Ok(out)
    }

    fn error(&self, what: &'static str) -> Error {
        let reason = format!("bad {what}: {:?}", excerpt(self.whole));
        Error::malformed(self.file, &format!("line {}", self.number), reason)
    }
}

/// All lines, with their numbers.
fn lines<'a>(file: &'a Path, bytes: &'a [u8]) -> impl Iterator<Item = Line<'a>> {
    bytes.split(|&b| b == b'\n').enumerate().map(move |(i, line)| {
        let whole = line.trim_ascii();
        Line { file, number: i + 1, whole, rest: whole }
    })
}

fn holds_data(line: &Line) -> bool {
    !line.whole.is_empty() && !line.whole.starts_with(b"#")
}

pub(super) fn cameras(file: &Path, bytes: &[u8]) -> Result<Vec<Intrinsics>> {
    let mut cameras = Vec::new();
    for mut line in lines(file, bytes).filter(holds_data) {
        let id = line.next("camera id")?;
        let name: String = line.next("camera model")?;
        let Some(model) = MODELS.iter().position(|m| m.0 == name).map(CameraModel) else {
            return Err(unknown_model(file, id, &name));
        };
        let width = line.next("width")?;
        let height = line.next("height")?;
        let params = (0..model.params()).map(|_| line.next("camera parameter"));
        let params = params.collect::<Result<_>>()?;
        if !line.word().is_empty() {
            return Err(line.error("number of camera parameters"));
        }
        cameras.push(Intrinsics { id, model, width, height, params });
    }
    Ok(cameras)
}

/// Whether a line lists points: three numbers for each. The tenth word of an image is its name.
fn lists_points(line: &Line) -> bool {
    let mut words = 0;
    let mut rest = Line { rest: line.whole, ..*line };
    loop {
        let word = rest.word();
        if word.is_empty() {
            return words % 3 == 0;
        }
        words += 1;
        let number = || std::str::from_utf8(word).is_ok_and(|w| w.parse::<f64>().is_ok());
        if (words == 1 || words == 10) && !number() {
            return false;
        }
    }
}

/// Two lines per image; the second lists its points, and is empty if it has none. Some tools leave that one out.
pub(super) fn images(file: &Path, bytes: &[u8]) -> Result<Vec<PosedImage>> {
    let mut images = Vec::new();
    let mut all = lines(file, bytes).peekable();
    while let Some(line) = all.next() {
        if !holds_data(&line) {
            continue;
        }
        let number = line.number;
        images.push(image(line).map_err(|error| match error {
            Error::Malformed { file, place, reason } if !images.is_empty() => {
                let reason =
                    format!("{reason}; nor does line {number} list points, three numbers each");
                Error::Malformed { file, place, reason }
            }
            other => other,
        })?);
        // A line that is neither is read as an image, whose error names it.
        all.next_if(|next| next.whole.is_empty() || lists_points(next));
    }
    Ok(images)
}

fn image(mut line: Line<'_>) -> Result<PosedImage> {
    let _id: u32 = line.next("image id")?;
    let rotation = line.f64s("rotation")?;
    let translation = line.f64s("translation")?;
    let camera = line.next("camera id")?;
    // The name is the rest of the line: it may hold spaces.
    let name = std::str::from_utf8(line.rest.trim_ascii()).unwrap_or_default().to_owned();
    if name.is_empty() {
        return Err(line.error("image name"));
    }
    Ok(PosedImage { name, camera, rotation, translation })
}

pub(super) fn points(file: &Path, bytes: &[u8]) -> Result<Vec<Point>> {
    let point = |mut line: Line<'_>| {
        let _id: u64 = line.next("point id")?;
        let position = line.f64s("position")?;
        let mut colour = [0; 3];
        for v in &mut colour {
            *v = line.next("colour")?;
        }
        Ok(Point { position, colour })
    };
    lines(file, bytes).filter(holds_data).map(point).collect()
}

//! Models that move by formulas: SpaceTime Gaussians (lite) and FreeTimeGS.
//!
//! Time goes from 0 to 1. A Gaussian has a centre `c` and a width `s` in time. At time `t`, `d = t - c` away, its mean is
//! `x + v d + a d^2 + j d^3`, its quaternion `q + w d`, and its opacity is multiplied by `exp(-k (d / s)^2)`.
//!
//! - *SpaceTime Gaussians*: `c` is `trbf_center`, `ln s` is `trbf_scale`, `v a j` are `motion_0..8`, `w` is `omega_0..3`,
//!   `k` is 1. `f_dc` is a colour from 0 to 1. Frame `i` of `n` is at `i / n`.
//! - *FreeTimeGS* (version 1): `c` is `time`, `ln s` is `log_duration`, `v` is `velocity_0..2`, `k` is 1/2. Frame `i` is
//!   at `i / (n - 1)`. Comments bound `s` (`min_duration`) and opacity (`opacity_floor`) from below.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use super::binary::{self, BinaryBody};
use super::columns::Columns;
use super::header::{self, Encoding, MAX_HEADER_BYTES, PlyElement, PlyHeader};
use super::variants::dimmed;
use crate::error::{Error, Result};
use crate::formats::foreign;
use crate::fs;
use crate::limits::CLAMPED_OPACITY_LOGIT;
use crate::report::{Invalid, ReadOptions};
use crate::scene::{LEAST_DRAWN_LOGIT, SH_C0, Scene};

/// What every time-dependent Gaussian has beside a still one: centre, logarithm of the width, `v a j`, `w`.
const NUMBERS: usize = 15;

/// A model whose Gaussians move and fade in time.
#[derive(Debug)]
pub struct TimedModel {
    /// At the centre in time of each Gaussian.
    still: Scene,
    courses: Vec<Course>,
    is_spacetime: bool,
    /// Least logit.
    floor: f32,
    /// The number of frames that the file states.
    pub frames: Option<u32>,
}

/// How a Gaussian moves.
#[derive(Clone, Debug)]
struct Course {
    centre: f64,
    width: f64,
    motion: [[f32; 3]; 3],
    omega: [f32; 4],
}

impl TimedModel {
    /// Reads a model that moves; `None` if the file is any other.
    ///
    /// # Errors
    /// As [`super::read`].
    pub fn open(path: impl AsRef<Path>, options: &ReadOptions) -> Result<Option<Self>> {
        let path = path.as_ref();
        let io = |e| Error::io(path, "read", e);
        let opened = File::open(path).map_err(io)?;
        let mut start = Vec::new();
        if opened.metadata().map_err(io)?.is_file() {
            opened.take(MAX_HEADER_BYTES as u64).read_to_end(&mut start).map_err(io)?;
        }
        let moves = |h: &PlyHeader| h.elements.iter().any(|e| e.name == "vertex" && e.moves());
        if !start.starts_with(b"ply") || !header::parse(path, &start).is_ok_and(|h| moves(&h)) {
            return Ok(None);
        }
        Self::read(path, &fs::read(path)?, options).map(Some)
    }

    fn read(file: &Path, bytes: &[u8], options: &ReadOptions) -> Result<Self> {
        let header = header::parse(file, bytes)?;
        let [vertex] = &header.elements[..] else {
            return Err(Error::malformed(file, "header", "other elements beside \"vertex\""));
        };
        if header.encoding == Encoding::Ascii {
            return Err(Error::malformed(file, "header", "ASCII; models that move are binary"));
        }
        let is_spacetime = vertex.properties.iter().any(|p| p.name.starts_with("trbf_"));
        if vertex.properties.iter().any(|p| p.name == "f_t_0") {
            let what = "a full model of SpaceTime Gaussians: a neural network, which is not in the file, makes its \
                        colours; gsvx reads lite models";
            return Err(foreign::is(file, what));
        }
        let mut columns = Columns::of(file, vertex)?;
        let body =
            BinaryBody { file, bytes, big_endian: header.encoding == Encoding::BinaryBigEndian };
        let (mut still, _) = body.vertices(vertex, &mut columns, header.len)?;
        still.origin = columns.scene_origin(&header);
        let settings = Settings::of(file, &header)?;
        let mut courses = courses(&body, vertex, header.len, is_spacetime)?;
        for course in &mut courses {
            course.width = course.width.max(settings.min_duration);
            if !settings.use_velocity {
                course.motion = Default::default();
            }
        }
        if is_spacetime {
            still.sh.as_flattened_mut().iter_mut().for_each(|v| *v = (*v - 0.5) / SH_C0);
        }
        still.clamp_limits();
        let Settings { floor, frames, .. } = settings;
        let mut model = Self { still, courses, is_spacetime, floor, frames };
        model.clean(file, options)?;
        Ok(model)
    }

    /// Refuses or drops Gaussians that are invalid.
    fn clean(&mut self, file: &Path, options: &ReadOptions) -> Result<()> {
        if options.invalid == Invalid::Drop {
            let mut sound = self.still.sound_indices();
            sound.retain(|&i| self.courses[i].fault().is_none());
            self.courses = sound.iter().map(|&i| self.courses[i].clone()).collect();
            self.still.keep(&sound);
            return Ok(());
        }
        self.still.refuse_invalid(file)?;
        let faults = self.courses.iter().map(Course::fault);
        match faults.enumerate().find_map(|(i, fault)| Some((i, fault?))) {
            Some((i, fault)) => Err(Error::malformed(file, &format!("Gaussian {i}"), fault)),
            None => Ok(()),
        }
    }

    /// The Gaussians at frame `number` of `count`, and which of them a rasterizer may draw.
    #[must_use]
    pub fn frame(&self, number: u32, count: u32) -> (Scene, Vec<bool>) {
        let last = if self.is_spacetime { count } else { count.saturating_sub(1) };
        let time = f64::from(number) / f64::from(last.max(1));
        let sharpness = if self.is_spacetime { 1.0 } else { 0.5 };
        let mut scene = self.still.clone();
        for (i, course) in self.courses.iter().enumerate() {
            let d = time - course.centre;
            for (k, mean) in scene.means[i].iter_mut().enumerate() {
                let [v, a, j] = course.motion.map(|row| f64::from(row[k]));
                *mean = (f64::from(*mean) + d * (v + d * (a + d * j))) as f32;
            }
            for (q, w) in scene.rotations[i].iter_mut().zip(course.omega) {
                *q = (f64::from(*q) + d * f64::from(w)) as f32;
            }
            let widths = d / course.width;
            let logit = dimmed(scene.opacity_logits[i], -sharpness * widths * widths);
            scene.opacity_logits[i] = logit.max(self.floor);
        }
        let there = scene.opacity_logits.iter().map(|&logit| logit >= LEAST_DRAWN_LOGIT).collect();
        (scene, there)
    }
}

impl Course {
    /// What is wrong with it.
    fn fault(&self) -> Option<&'static str> {
        let numbers = self.motion.as_flattened().iter().chain(&self.omega);
        if !(self.centre.is_finite()
            && self.width.is_finite()
            && numbers.into_iter().all(|v| v.is_finite()))
        {
            return Some("a number of its motion or its window in time is not finite");
        }
        (self.width < f64::from(f32::MIN_POSITIVE)).then_some("its window in time has no length")
    }
}

/// The properties of a course in order; those that the file's kind does not have are absent, and 0.
fn names(is_spacetime: bool) -> [Option<String>; NUMBERS] {
    std::array::from_fn(|i| match (i, is_spacetime) {
        (0, true) => Some("trbf_center".into()),
        (1, true) => Some("trbf_scale".into()),
        (2..11, true) => Some(format!("motion_{}", i - 2)),
        (11.., true) => Some(format!("omega_{}", i - 11)),
        (0, false) => Some("time".into()),
        (1, false) => Some("log_duration".into()),
        (2..5, false) => Some(format!("velocity_{}", i - 2)),
        _ => None,
    })
}

/// How the Gaussians of a body move, whose rows, which fit, start at `at`.
fn courses(
    body: &BinaryBody<'_>,
    vertex: &PlyElement,
    at: usize,
    is_spacetime: bool,
) -> Result<Vec<Course>> {
    let places = binary::offsets_and_types(vertex);
    let mut columns = [None; NUMBERS];
    for (column, name) in columns.iter_mut().zip(names(is_spacetime)) {
        let Some(name) = name else { continue };
        let found = vertex.properties.iter().position(|p| p.name == name);
        let missing =
            || Error::malformed(body.file, "element \"vertex\"", format!("no property {name}"));
        *column = Some(places[found.ok_or_else(missing)?]);
    }
    let stride = vertex.least_row_bytes();
    let rows = body.bytes[at..].chunks_exact(stride).take(vertex.count as usize);
    let course = |row: &[u8]| {
        let read = |(offset, scalar)| binary::number(row, offset, scalar, body.big_endian);
        let v = columns.map(|column| column.map_or(0.0, read));
        let f = v.map(|v| v as f32);
        Course {
            centre: v[0],
            width: libm::exp(v[1]),
            motion: [[f[2], f[3], f[4]], [f[5], f[6], f[7]], [f[8], f[9], f[10]]],
            omega: [f[11], f[12], f[13], f[14]],
        }
    };
    Ok(rows.map(course).collect())
}

/// What the comments of a file of FreeTimeGS set.
struct Settings {
    use_velocity: bool,
    min_duration: f64,
    floor: f32,
    frames: Option<u32>,
}

impl Settings {
    fn of(file: &Path, header: &PlyHeader) -> Result<Self> {
        let number = |key: &str, default: f64, fits: fn(f64) -> bool| {
            let value =
                |comment: &String| comment.strip_prefix(key)?.strip_prefix(' ').map(str::to_owned);
            let Some(text) = header.comments.iter().find_map(value) else { return Ok(default) };
            let number = text.trim().parse().ok().filter(|&v| fits(v));
            let reason = || format!("comment {key} {text} is not a value that it can have");
            number.ok_or_else(|| Error::malformed(file, "header", reason()))
        };
        number("ftgs_version", 1.0, |v| v == 1.0)?;
        let floor = number("opacity_floor", 0.0, |v| (0.0..1.0).contains(&v))?;
        let frames = number("n_frames", 0.0, |v| v.fract() == 0.0 && (1.0..=1e6).contains(&v))?;
        Ok(Self {
            use_velocity: number("use_velocity", 1.0, |v| v == 0.0 || v == 1.0)? == 1.0,
            min_duration: number("min_duration", 0.0, |v| v > 0.0 && v.is_finite())?,
            floor: (libm::log(floor / (1.0 - floor)) as f32).max(-CLAMPED_OPACITY_LOGIT),
            frames: (frames > 0.0).then_some(frames as u32),
        })
    }
}

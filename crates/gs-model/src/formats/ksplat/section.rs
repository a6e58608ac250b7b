//! One section: where its rows are, and how a Gaussian is decoded from its row.

use std::path::Path;

use super::KsplatHeader;
use crate::bytes::{float, half, half_word, word};
use crate::error::Result;
use crate::formats::splat::opacity_logit;
use crate::rows::{self, SH};
use crate::scene::{SH_C0, Scene, sh_len};

/// Bytes of a section's header.
pub(super) const SECTION_HEADER: usize = 1024;
/// Bytes of a bucket: its centre.
const BUCKET: usize = 12;
/// Half of the 16-bit range of means, where the section does not say it.
const DEFAULT_RANGE: u32 = 32767;
/// A half float holds no standard deviation below this; zero stands for what was rounded to it.
const LEAST_HALF: f32 = 1.0 / (1 << 25) as f32;

/// A section whose rows are all in the file.
pub(super) struct KsplatSection<'a> {
    level: u16,
    sh_bounds: [f32; 2],
    pub(super) sh_degree: u8,
    /// Gaussians.
    rows: usize,
    row_bytes: usize,
    data: &'a [u8],
    buckets: Buckets<'a>,
    /// World units per step of a mean, and the step of the bucket's centre.
    unit: f64,
    range: f64,
}

/// The centres of buckets, and which rows are in which. The full buckets come first.
struct Buckets<'a> {
    centres: &'a [u8],
    full: usize,
    full_size: usize,
    /// For each bucket that is not full, the row after its last.
    partial_ends: Vec<u64>,
}

impl<'a> KsplatSection<'a> {
    /// The section with that header at the start of `data`, and what follows it.
    pub(super) fn parse(
        head: &[u8],
        data: &'a [u8],
        header: &KsplatHeader,
    ) -> Result<(Self, &'a [u8]), &'static str> {
        let [rows, most_rows, full_size, buckets] = [0, 4, 8, 12].map(|at| word(head, at) as usize);
        let (full, partial) = (word(head, 32) as usize, word(head, 36) as usize);
        let sh_degree = half_word(head, 40);
        if sh_degree > 3 {
            return Err("an SH degree above 3");
        }
        if rows > most_rows {
            return Err("more Gaussians than room for them");
        }
        let stored = usize::from(half_word(head, 20));
        if buckets > 0 && stored != BUCKET {
            return Err("buckets of another size than 12 bytes");
        }
        let level = header.level;
        if level > 0 && full.checked_add(partial) != Some(buckets) {
            return Err("not as many full and partial buckets as buckets");
        }
        let sh_degree = sh_degree as u8;
        let row_bytes = row_bytes(level, sh_degree);
        const SHORT: &str = "not whole: the file is cut short; get it again";
        let take = |data: &'a [u8], count: usize, size: usize| {
            count.checked_mul(size).and_then(|len| data.split_at_checked(len)).ok_or(SHORT)
        };
        let (sizes, data) = take(data, partial, 4)?;
        let (centres, data) = take(data, buckets, BUCKET)?;
        let (data, rest) = take(data, most_rows, row_bytes)?;
        let mut end = full as u64 * full_size as u64;
        let ends = sizes.chunks_exact(4).map(|size| {
            end = end.saturating_add(u64::from(word(size, 0)));
            end
        });
        let partial_ends: Vec<u64> = ends.collect();
        let buckets = Buckets { centres, full, full_size, partial_ends };
        if level > 0 && buckets.of(rows.saturating_sub(1)).is_none() && rows > 0 {
            return Err("Gaussians in no bucket");
        }
        let range = f64::from(match word(head, 24) {
            0 => DEFAULT_RANGE,
            range => range,
        });
        let unit = f64::from(float(head, 16)) / 2.0 / range;
        let sh_bounds = header.sh_bounds;
        Ok((
            Self { level, sh_bounds, sh_degree, rows, row_bytes, data, buckets, unit, range },
            rest,
        ))
    }

    /// The Gaussians, all of whose rows are in the file.
    pub(super) fn scene(&self, file: &Path) -> Result<Scene> {
        let colours = 10 * number_bytes(self.level);
        rows::scene_of(file, self.rows, self.sh_degree, |i| {
            let row = &self.data[i * self.row_bytes..(i + 1) * self.row_bytes];
            let centre = if self.level == 0 { None } else { self.buckets.of(i) };
            let centre = centre.unwrap_or_default();
            move |c| match c {
                0..3 if self.level == 0 => float(row, 4 * c),
                0..3 => {
                    let steps = f64::from(half_word(row, 2 * c)) - self.range;
                    (steps * self.unit + f64::from(centre[c])) as f32
                }
                // Scales come before quaternions in the file, after them in a scene.
                3..7 => self.float(row, c + 3),
                7..10 => {
                    let scale = self.float(row, c - 4);
                    let least = if self.level == 0 { 0.0 } else { LEAST_HALF };
                    libm::logf(if scale >= 0.0 { scale.max(least) } else { scale })
                }
                10 => opacity_logit(row[colours + 3]),
                11..14 => (f32::from(row[colours + c - SH]) / 255.0 - 0.5) / SH_C0,
                _ => self.sh(&row[colours + 4..], (c - SH) / 3, (c - SH) % 3),
            }
        })
    }

    /// Number `i` of scales and quaternion, counted from the start of a row.
    fn float(&self, row: &[u8], i: usize) -> f32 {
        match self.level {
            0 => float(row, 4 * i),
            _ => half(row, 2 * i),
        }
    }

    /// The coefficient of basis function `k` among the higher ones.
    fn sh(&self, higher: &[u8], k: usize, channel: usize) -> f32 {
        let degree = k.isqrt();
        let (first, width) = (degree * degree, 2 * degree + 1);
        let i = 3 * (first - 1) + channel * width + k - first;
        match self.level {
            0 => float(higher, 4 * i),
            1 => half(higher, 2 * i),
            _ => {
                let [low, high] = self.sh_bounds;
                low + f32::from(higher[i]) / 255.0 * (high - low)
            }
        }
    }
}

impl Buckets<'_> {
    /// The centre of the bucket of a row.
    fn of(&self, row: usize) -> Option<[f32; 3]> {
        let bucket = if (row as u64) < self.full as u64 * self.full_size as u64 {
            row / self.full_size
        } else {
            self.full + self.partial_ends.partition_point(|&end| end <= row as u64)
        };
        let centre = self.centres.chunks_exact(BUCKET).nth(bucket)?;
        Some([0, 4, 8].map(|at| float(centre, at)))
    }
}

/// Bytes of a number of a mean, scale or quaternion.
fn number_bytes(level: u16) -> usize {
    if level == 0 { 4 } else { 2 }
}

fn row_bytes(level: u16, sh_degree: u8) -> usize {
    let sh_bytes = [4, 2, 1][usize::from(level)];
    10 * number_bytes(level) + 4 + 3 * (sh_len(sh_degree) - 1) * sh_bytes
}

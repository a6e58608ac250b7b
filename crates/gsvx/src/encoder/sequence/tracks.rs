//! [`Tracks`]: which Gaussian of a frame is which of the frames before.
//!
//! Rows that correspond are taken as they are. Else a Gaussian is one of before that is equal but for place and
//! rotation, or the nearest alike one; all others are born. What no frame continues is dead, and may come back.

use gs_model::Scene;
use std::collections::BTreeMap;

/// No Gaussian of a frame.
const NONE: u32 = u32::MAX;
/// Share of the rows that must be near and like those of the frame before, or equal but for place and rotation, for all
/// rows to correspond.
const TRACKED: f64 = 0.75;
/// Share of the Gaussians that must go on for frames to share a group.
const GOING_ON: f64 = 0.7;
/// Most tracks that are equal but for place and rotation, or in a cell, with which a Gaussian is compared.
const MOST: usize = 64;
/// Gaussians are alike if they differ by less than this in all log-scales, colours and the logit.
const ALIKE: f32 = 0.5;

/// The Gaussians of a group of frames.
#[derive(Debug, Default)]
pub(super) struct Tracks {
    frames: Vec<Scene>,
    /// Of each track the row in each frame, or [`NONE`].
    rows: Vec<Vec<u32>>,
    /// The frame in which each track was last.
    last: Vec<usize>,
}

/// What two Gaussians have in common wherever they are: the bits of scales, opacity and colour.
type Key = Vec<u32>;

fn key(scene: &Scene, i: usize) -> Key {
    let floats =
        [&scene.log_scales[i][..], &[scene.opacity_logits[i]], scene.sh_of(i).as_flattened()];
    floats.concat().iter().map(|v| v.to_bits()).collect()
}

/// Half-width of the largest axis.
fn size(scene: &Scene, i: usize) -> f32 {
    let s = scene.log_scales[i];
    libm::expf(s[0].max(s[1]).max(s[2]))
}

fn distance(a: [f32; 3], b: [f32; 3]) -> f32 {
    let d: [f32; 3] = std::array::from_fn(|k| a[k] - b[k]);
    (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).sqrt()
}

/// Whether two Gaussians differ little in all but place and rotation.
fn alike(a: &Scene, i: usize, b: &Scene, j: usize) -> bool {
    let near = |x: f32, y: f32| (x - y).abs() < ALIKE;
    near(a.opacity_logits[i], b.opacity_logits[j])
        && a.log_scales[i].iter().zip(&b.log_scales[j]).all(|(&x, &y)| near(x, y))
        && a.sh_of(i)
            .as_flattened()
            .iter()
            .zip(b.sh_of(j).as_flattened())
            .all(|(&x, &y)| near(x, y))
}

impl Tracks {
    pub(super) fn len(&self) -> usize {
        self.frames.len()
    }

    /// Rows of the frames so far; none without frames.
    pub(super) fn rows(&self) -> Option<usize> {
        (self.len() > 0).then_some(self.rows.len())
    }

    /// Adds a frame. One that does not go on from those before is given back.
    pub(super) fn push(&mut self, frame: Scene) -> Option<Scene> {
        let time = self.frames.len();
        let matches = match self.frames.last() {
            None => vec![NONE; frame.len()],
            Some(before) if corresponds(before, &frame) && self.rows.len() == frame.len() => {
                (0..frame.len() as u32).collect()
            }
            Some(_) => self.matches(&frame),
        };
        let found = matches.iter().filter(|&&track| track != NONE).count();
        if time > 0 && (found as f64) < GOING_ON * frame.len() as f64 {
            return Some(frame);
        }
        self.rows.iter_mut().for_each(|rows| rows.push(NONE));
        for (row, &track) in (0..).zip(&matches) {
            let track = if track == NONE { self.begin(time) } else { track as usize };
            self.rows[track][time] = row;
            self.last[track] = time;
        }
        self.frames.push(frame);
        None
    }

    /// Adds a frame whose rows are the Gaussians of those before, of which some are not there.
    pub(super) fn push_known(&mut self, frame: Scene, there: &[bool]) {
        let time = self.frames.len();
        self.rows.resize(there.len(), vec![NONE; time]);
        self.last.resize(there.len(), time);
        for (row, (rows, there)) in (0..).zip(self.rows.iter_mut().zip(there)) {
            rows.push(if *there { row } else { NONE });
        }
        self.frames.push(frame);
    }

    /// A track that begins at a time.
    fn begin(&mut self, time: usize) -> usize {
        self.rows.push(vec![NONE; time + 1]);
        self.last.push(time);
        self.rows.len() - 1
    }

    /// Where a track was last.
    fn latest(&self, track: usize) -> (&Scene, usize) {
        let time = self.last[track];
        (&self.frames[time], self.rows[track][time] as usize)
    }

    /// The track of each row of the next frame.
    fn matches(&self, frame: &Scene) -> Vec<u32> {
        let mut found = vec![NONE; frame.len()];
        let mut taken = vec![false; self.rows.len()];
        let mut equal: BTreeMap<Key, Vec<u32>> = BTreeMap::new();
        for track in 0..self.rows.len() {
            let (scene, i) = self.latest(track);
            equal.entry(key(scene, i)).or_default().push(track as u32);
        }
        let at = |track: u32| {
            let (scene, i) = self.latest(track as usize);
            scene.means[i]
        };
        for row in 0..frame.len() {
            // Of more, the nearest is found cell by cell.
            let tracks = equal.get(&key(frame, row)).filter(|tracks| tracks.len() <= MOST);
            let Some(tracks) = tracks else { continue };
            let free = tracks.iter().copied().filter(|&track| !taken[track as usize]);
            let place = frame.means[row];
            let nearest =
                free.min_by(|&a, &b| distance(at(a), place).total_cmp(&distance(at(b), place)));
            if let Some(track) = nearest {
                found[row] = track;
                taken[track as usize] = true;
            }
        }
        self.match_near(frame, &mut found, &mut taken);
        found
    }

    /// Matches rows that are left to the nearest track that is alike and was there in the frame before.
    fn match_near(&self, frame: &Scene, found: &mut [u32], taken: &mut [bool]) {
        let free: Vec<usize> = (0..frame.len()).filter(|&row| found[row] == NONE).collect();
        let mut sizes: Vec<f32> = free.iter().map(|&row| size(frame, row)).collect();
        sizes.sort_by(f32::total_cmp);
        let Some(&side) = sizes.get(sizes.len() / 2).filter(|side| side.is_normal()) else {
            return;
        };
        let cell = |mean: [f32; 3]| mean.map(|v| (v / side).floor() as i64);
        let mut cells: BTreeMap<[i64; 3], Vec<u32>> = BTreeMap::new();
        for track in (0..self.rows.len()).filter(|&track| !taken[track]) {
            let (scene, i) = self.latest(track);
            if self.last[track] + 1 == self.frames.len() {
                cells.entry(cell(scene.means[i])).or_default().push(track as u32);
            }
        }
        let mut pairs = Vec::new();
        for row in free {
            let place = frame.means[row];
            let middle = cell(place);
            for offset in 0..27 {
                let by = [offset / 9 - 1, offset / 3 % 3 - 1, offset % 3 - 1];
                let near = std::array::from_fn(|k| middle[k].saturating_add(by[k]));
                for &track in cells.get(&near).into_iter().flatten().take(MOST) {
                    let (scene, i) = self.latest(track as usize);
                    if alike(scene, i, frame, row) {
                        pairs.push((distance(scene.means[i], place), row, track));
                    }
                }
            }
        }
        pairs.sort_by(|a, b| a.0.total_cmp(&b.0).then((a.1, a.2).cmp(&(b.1, b.2))));
        for (_, row, track) in pairs {
            if found[row] == NONE && !taken[track as usize] {
                found[row] = track;
                taken[track as usize] = true;
            }
        }
    }

    /// The frames with a Gaussian for each track, and whether it is there, track by track; nothing if all always are. One
    /// that is not is as it was last, or will be first.
    pub(super) fn into_frames(self) -> (Vec<Scene>, Vec<bool>) {
        let Self { frames, mut rows, .. } = self;
        rows.retain(|rows| rows.iter().any(|&row| row != NONE));
        let alive: Vec<bool> = rows.iter().flatten().map(|&row| row != NONE).collect();
        if !alive.contains(&false)
            && rows.iter().enumerate().all(|(i, r)| r.iter().all(|&r| r as usize == i))
        {
            return (frames, Vec::new());
        }
        let aligned = |time: usize| {
            let mut out = frames[time].emptied(frames[time].sh_degree);
            for rows in &rows {
                let there = |t: &usize| rows[*t] != NONE;
                let before = (0..=time).rev().find(there);
                let time = before.or_else(|| (time..rows.len()).find(there)).unwrap_or(time);
                let row = rows[time] as usize;
                out.append_range(&frames[time], row..row + 1);
            }
            out
        };
        let aligned = (0..frames.len()).map(aligned).collect();
        (aligned, if alive.contains(&false) { alive } else { Vec::new() })
    }
}

/// Whether the rows of two frames are the same Gaussians.
fn corresponds(before: &Scene, frame: &Scene) -> bool {
    let same = |&i: &usize| {
        let reach = size(before, i).max(size(frame, i));
        let near = distance(before.means[i], frame.means[i]) <= reach;
        near && alike(before, i, frame, i) || key(before, i) == key(frame, i)
    };
    before.len() == frame.len()
        && (0..frame.len()).filter(same).count() as f64 >= TRACKED * frame.len() as f64
}

//! `gsvx compare` of sequences: some frames of both, and how what changes between frames differs.

use super::{CompareArgs, finite, render_both, scores_json, words};
use crate::exit::usage;
use crate::frame_source::{FrameSource, evenly};
use crate::input;
use crate::output::counted;
use crate::progress::Meter;
use crate::report::Reporter;
use crate::views::{Origin, PlacedCameras};
use anyhow::{Result, ensure};
use finetune::metrics::{Scores, decibels, flicker};
use gs_model::{Camera, Scene};
use serde_json::{Value, json};

/// Frames that are compared if none are named.
const FRAMES: u64 = 5;

/// Compares frames of two sequences from the same views. Scores are those of the frames; flicker is the PSNR of the changes
/// to their successors, of the mean squared error of all views.
pub(super) fn run(args: &CompareArgs, report: Reporter) -> Result<()> {
    if args.output.is_some() {
        return Err(usage("--output: pictures are made of two models, not of sequences"));
    }
    let mut a = FrameSource::open(&args.reference, &args.reading)?;
    let mut b = FrameSource::open(&args.model, &args.reading)?;
    a.follow(&b);
    b.follow(&a);
    let [names, counts] = [[a.name(), b.name()], [a.count(), b.count()]];
    let [reference, model] = &names;
    let frames = a.len();
    ensure!(
        frames > 0,
        "{reference} and {model} move and state no number of frames; compare one with a sequence"
    );
    ensure!(frames == b.len(), "{reference} has {}, {model} {}", counts[0], counts[1]);
    let chosen = chosen(&args.frames, frames)?;
    let mut both = |number: u64| -> Result<[Scene; 2]> {
        let (a, mut b) = (a.frame(number)?, b.frame(number)?);
        b.move_origin(a.origin);
        Ok([a, b])
    };
    let mut now = both(chosen[0])?;
    let PlacedCameras { cameras, origin } = args.views.cameras(&now[0], &args.reference)?;
    let place = now[0].origin;
    let steps = Meter::new("compare", chosen.len() * cameras.len());
    let (mut scores, mut changes) = (Vec::new(), Vec::new());
    for (i, &number) in chosen.iter().enumerate() {
        if i > 0 {
            now = both(number)?;
        }
        let mut next = if number + 1 < frames { Some(both(number + 1)?) } else { None };
        now.iter_mut().chain(next.iter_mut().flatten()).for_each(|scene| scene.move_origin(place));
        let mut of_frame = Vec::with_capacity(cameras.len());
        for camera in &cameras {
            let [r, m] = render_both(&now[0], &now[1], camera);
            of_frame.push(Scores::of(&m, &r));
            if let Some(next) = &next {
                let [r1, m1] = render_both(&next[0], &next[1], camera);
                changes.push(flicker([&m, &m1], [&r, &r1]));
            }
            steps.inc();
        }
        scores.push(of_frame);
    }
    drop(steps);
    let result = SequenceScores { chosen, scores, changes };
    let mut human = format!("{reference}: {}\n{model}: {}\n", counts[0], counts[1]);
    if let Some(origin) = &origin {
        human += &format!("{}\n", origin.human());
    }
    human += &result.human();
    let mut json = result.json(&cameras);
    json["frame_count"] = json!(frames);
    json["cameras"] = origin.as_ref().map_or(Value::Null, Origin::json);
    report.say(false, &human, &json)
}

/// The frames to compare: those that were named, or some.
fn chosen(named: &[u64], frames: u64) -> Result<Vec<u64>> {
    if let Some(number) = named.iter().find(|number| **number >= frames) {
        let last = frames.saturating_sub(1);
        return Err(usage(format!("--frames: there is no frame {number}, only 0 to {last}")));
    }
    let mut chosen = named.to_vec();
    if chosen.is_empty() {
        // Each with a successor, if there are two.
        chosen = evenly(frames.saturating_sub(1).max(1), FRAMES);
    }
    chosen.sort_unstable();
    chosen.dedup();
    Ok(chosen)
}

/// What was measured.
struct SequenceScores {
    chosen: Vec<u64>,
    /// By frame, then view.
    scores: Vec<Vec<Scores>>,
    /// Mean squared errors of changes.
    changes: Vec<f64>,
}

impl SequenceScores {
    fn mean(&self) -> Scores {
        Scores::mean(&self.scores.concat())
    }

    /// The means of the frames.
    fn frames(&self) -> impl Iterator<Item = (u64, Scores)> {
        self.chosen.iter().zip(&self.scores).map(|(number, of)| (*number, Scores::mean(of)))
    }

    /// dB; `None` if no frame has a successor.
    fn flicker(&self) -> Option<f64> {
        let mean = self.changes.iter().sum::<f64>() / self.changes.len() as f64;
        (!self.changes.is_empty()).then(|| decibels(mean))
    }

    fn human(&self) -> String {
        let (frames, views) = (self.chosen.len(), self.scores.first().map_or(0, Vec::len));
        let mut human = format!(
            "renders, mean over {} in {}: {}\n",
            counted(frames, "frame"),
            counted(views, "view"),
            words(&self.mean())
        );
        if let Some((number, worst)) = self.frames().min_by(|a, b| a.1.psnr.total_cmp(&b.1.psnr)) {
            human += &format!("  worst: frame {number} with {}\n", words(&worst));
        }
        human
            + &match self.flicker() {
                Some(flicker) => {
                    format!("flicker: PSNR {flicker:.3} dB of the changes between frames")
                }
                None => "flicker: none of these frames has one after it".into(),
            }
    }

    fn json(&self, cameras: &[Camera]) -> Value {
        let frame = |(number, scores): (u64, Scores)| {
            let mut frame = scores_json(&scores);
            frame["frame"] = json!(number);
            frame
        };
        let view = |(i, camera): (usize, &Camera)| {
            let of: Vec<Scores> = self.scores.iter().map(|frame| frame[i]).collect();
            let mut view = scores_json(&Scores::mean(&of));
            view["name"] = json!(camera.name);
            view
        };
        let mut json = scores_json(&self.mean());
        json["flicker"] = self.flicker().map_or(Value::Null, finite);
        json["frames"] = self.frames().map(frame).collect();
        json["views"] = cameras.iter().enumerate().map(view).collect();
        json
    }
}

impl FrameSource<'_> {
    fn name(&self) -> String {
        input::name(self.path())
    }

    fn count(&self) -> String {
        counted(self.len() as usize, "frame")
    }
}

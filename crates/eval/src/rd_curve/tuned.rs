//! The curve of `gsvx tune`: pruned and tuned with the codec in the loop, by the library that the command calls.

use std::cell::OnceCell;
use std::ops::ControlFlow;

use anyhow::{Context, Result};
use gs_model::Scene;
use tune::{Progress, Target, Targets, Tune, TuneEffort, TuneOptions};

use super::options::TUNED_QUALITIES;
use super::plan::TUNED;
use crate::bd::Point;
use crate::measure::Metric;
use crate::progress::Bar;
use crate::record::{Curve, Record, rates};
use crate::study::{StreamRecord, Study, slug};

/// The points at these qualities.
pub(super) fn curve(study: &Study, effort: TuneEffort, qualities: &[f32]) -> Result<Curve> {
    let points = qualities.iter().map(|&quality| point(study, effort, quality));
    let points = points.collect::<Result<_>>()?;
    let what = format!("pruned and tuned with the codec in the loop, effort {}", effort.name());
    Ok(Curve { name: TUNED.into(), what, points, ..Curve::default() })
}

fn point(study: &Study, effort: TuneEffort, quality: f32) -> Result<Record> {
    let name = format!("{}-{}-q{quality:.0}", slug(TUNED), effort.name());
    let encode = || Ok(streams(study, &name, effort, &[quality])?.swap_remove(0));
    let encode = || StreamRecord::timed(encode);
    let record = study.point(&study.cache, &name, "gsvx", &quality, encode, decode)?;
    Ok(Record { quality, setting: format!("{quality:.0}"), ..record })
}

fn decode(bytes: &[u8]) -> Result<Scene> {
    Ok(gsvx::decode(bytes)?)
}

/// A stream, and the bytes of its parts.
type Stream = (Vec<u8>, Vec<(&'static str, u64)>);

/// The streams of one run, at descending qualities.
fn streams(
    study: &Study,
    name: &str,
    effort: TuneEffort,
    qualities: &[f32],
) -> Result<Vec<Stream>> {
    let [first, further @ ..] = qualities else { return Ok(Vec::new()) };
    let mut options = TuneOptions::new(Target::Quality(*first));
    (options.effort, options.further) = (effort, further.to_vec());
    let photos = Targets::Photos(study.photos()?.to_vec());
    let run = Tune::new(study.test.model.clone(), photos, options)?;
    let (bar, mut done) = (Bar::new(&format!("tune {name}"), run.steps()), 0);
    let see = |progress: &Progress<'_>| {
        bar.step(progress.step - done);
        done = progress.step;
    };
    let mut made = Vec::new();
    run.run_all(see, |outcome| {
        let parts = outcome.encoded.parts();
        made.push((outcome.encoded.bytes, parts));
        ControlFlow::Continue(())
    })?;
    bar.done();
    Ok(made)
}

/// Points of one run for all qualities, and of a run for each.
pub(crate) fn one_tune(study: &Study) -> Result<[Vec<Point>; 2]> {
    let effort = TuneEffort::Quick;
    let each = curve(study, effort, &TUNED_QUALITIES)?;
    let mut descending = TUNED_QUALITIES;
    descending.reverse();
    let run = OnceCell::new();
    let point = |(i, quality): (usize, f32)| {
        let name = format!("one-tune-q{quality:.0}");
        let encode = || {
            if run.get().is_none() {
                let _ = run.set(streams(study, "one-tune", effort, &descending)?);
            }
            run.get().and_then(|made| made.get(i).cloned()).context("a stream is missing")
        };
        let encode = || StreamRecord::timed(encode);
        study.point(&study.cache, &name, "gsvx", &descending, encode, decode)
    };
    let one = descending.into_iter().enumerate().map(point).collect::<Result<Vec<Record>>>()?;
    Ok([rates(&one, Metric::Psnr), each.rates(Metric::Psnr)])
}

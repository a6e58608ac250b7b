//! The curve of `gsvx tune`: pruned and tuned with the codec in the loop, by the library that the command calls.

use anyhow::{Context, Result};
use tune::{Target, Targets, Tune, TuneEffort, TuneOptions};

use super::plan::{TUNED, slug};
use super::record::{Coded, Curve};
use super::study::Study;
use crate::cache::Cache;
use crate::progress::Bar;
use crate::round_trip::round_trip;

/// The points at these qualities.
pub(super) fn curve(study: &Study, effort: TuneEffort, qualities: &[f32]) -> Result<Curve> {
    let cache = study.cache_of(&std::env::current_exe().context("find this program")?)?;
    let point = |&quality: &f32| point(study, &cache, effort, quality);
    let points = qualities.iter().map(point).collect::<Result<_>>()?;
    let what = format!("pruned and tuned with the codec in the loop, effort {}", effort.name());
    Ok(Curve { name: TUNED.into(), what, voxelized: Vec::new(), points })
}

fn point(study: &Study, cache: &Cache, effort: TuneEffort, quality: f32) -> Result<Coded> {
    let name = format!("{}-{}-q{quality:.0}", slug(TUNED), effort.name());
    let stage = format!("code-{name}");
    if let Some(record) = cache.find(&stage, &quality, |r| study.has_stream(r))? {
        return Ok(record);
    }
    let mut parts = Vec::new();
    let encode = || {
        let mut options = TuneOptions::new(Target::Quality(quality));
        options.effort = effort;
        let photos = Targets::Photos(study.photos()?.to_vec());
        let run = Tune::new(study.test.model.clone(), photos, options)?;
        let (bar, mut done) = (Bar::new(&format!("tune {name}"), run.plan().steps()), 0);
        let outcome = run.run(|progress| {
            bar.step(progress.step - done);
            done = progress.step;
        })?;
        bar.done();
        parts = outcome.encoded.parts();
        Ok(outcome.encoded.bytes)
    };
    let decode = |bytes: &[u8]| Ok(gsvx::decode(bytes)?);
    let trip = round_trip(&name, &study.test.held_out, encode, decode)?;
    let stream = study.keep(&name, "gsvx", &trip.stream)?;
    let record = Coded { quality, ..Coded::of(trip, stream, parts) };
    cache.store(&stage, &quality, &record)?;
    Ok(record)
}

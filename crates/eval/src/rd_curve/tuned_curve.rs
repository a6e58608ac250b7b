//! The curve of `gsvx tune`: pruned and tuned with the codec in the loop, by the library that the command calls.

use anyhow::{Context, Result};
use gsvx::EncodeOptions;
use tune::{Target, Targets, Tune, TuneEffort, TuneOptions};

use super::plan::{TUNED, slug};
use super::record::{Coded, Curve};
use super::streams::QUALITIES;
use super::study::Study;
use crate::bd::Point;
use crate::cache::Cache;
use crate::measure::Metric;
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

/// The quality at which one tune serves all rates.
const ONE_TUNE: f32 = 66.0;

/// Points of one tune, whose model is coded at all qualities, and of a tune for each.
pub(crate) fn one_tune(study: &Study) -> Result<[Vec<Point>; 2]> {
    let each = curve(study, TuneEffort::Quick, &QUALITIES)?;
    let tuned = each.points.iter().find(|p| p.quality == ONE_TUNE).context("no such tune")?;
    let stream = std::fs::read(study.out.join(&tuned.stream)).context("read the tuned stream")?;
    let model = gsvx::decode(&stream)?;
    let seen = finetune::saliency(&model, &study.test.training).squared;
    let again = QUALITIES.map(|quality| -> Result<Point> {
        let mut options = EncodeOptions::from_quality(quality)?;
        (options.importance, options.drop_unseen) = (Some(seen.clone()), true);
        let encode = || {
            let made = gsvx::prepare(&model, &options)?;
            options.importance = Some(made.importance);
            Ok(gsvx::encode_voxels(&made.scene, made.voxels.octree(), None, &options)?.bytes)
        };
        let decode = |bytes: &[u8]| Ok(gsvx::decode(bytes)?);
        let trip =
            round_trip(&format!("one tune, {quality}"), &study.test.held_out, encode, decode)?;
        Ok(Point { rate: trip.stream.len() as f64, score: trip.score.psnr_db })
    });
    let one = again.into_iter().collect::<Result<Vec<Point>>>()?;
    Ok([one, each.rates(Metric::Psnr)])
}

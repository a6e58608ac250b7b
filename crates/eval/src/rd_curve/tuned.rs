//! The curve of `gsvx tune`: pruned and tuned with the codec in the loop, by the library that the command calls.

use anyhow::{Context, Result};
use gsvx::EncodeOptions;
use tune::{Target, Targets, Tune, TuneEffort, TuneOptions};

use super::options::TUNED_QUALITIES;
use super::plan::TUNED;
use crate::bd::Point;
use crate::measure::Metric;
use crate::progress::Bar;
use crate::record::{Curve, Record, rates};
use crate::study::{Encoded, Study, slug};

/// The points at these qualities.
pub(super) fn curve(study: &Study, effort: TuneEffort, qualities: &[f32]) -> Result<Curve> {
    let points = qualities.iter().map(|&quality| point(study, effort, quality));
    let points = points.collect::<Result<_>>()?;
    let what = format!("pruned and tuned with the codec in the loop, effort {}", effort.name());
    Ok(Curve { name: TUNED.into(), what, points, ..Curve::default() })
}

fn point(study: &Study, effort: TuneEffort, quality: f32) -> Result<Record> {
    let name = format!("{}-{}-q{quality:.0}", slug(TUNED), effort.name());
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
        let parts = outcome.encoded.parts();
        Ok((outcome.encoded.bytes, parts))
    };
    let decode = |bytes: &[u8]| Ok(gsvx::decode(bytes)?);
    let encode = || Encoded::timed(encode);
    let record = study.point(&study.cache, &name, "gsvx", &quality, encode, decode)?;
    Ok(Record { quality, setting: format!("{quality:.0}"), ..record })
}

/// The quality at which one tune serves all rates.
const ONE_TUNE: f32 = 66.0;

/// Points of one tune, whose model is coded at all qualities, and of a tune for each.
pub(crate) fn one_tune(study: &Study) -> Result<[Vec<Point>; 2]> {
    let each = curve(study, TuneEffort::Quick, &TUNED_QUALITIES)?;
    let tuned = each.points.iter().find(|p| p.quality == ONE_TUNE).context("no such tune")?;
    let stream = std::fs::read(study.out.join(&tuned.stream)).context("read the tuned stream")?;
    let model = gsvx::decode(&stream)?;
    let seen = finetune::Visibility::of_all(&model, &study.test.training).squared;
    let again = TUNED_QUALITIES.map(|quality| {
        let encode = || {
            let mut options = EncodeOptions::default();
            options.prepare.drop_unseen = true;
            let encoded = gsvx::encode(&model, Some(&seen), quality, &options)?;
            let parts = encoded.parts();
            Ok((encoded.bytes, parts))
        };
        let decode = |bytes: &[u8]| Ok(gsvx::decode(bytes)?);
        let name = format!("one-tune-q{quality:.0}");
        let encode = || Encoded::timed(encode);
        study.point(&study.cache, &name, "gsvx", &(), encode, decode)
    });
    let one = again.into_iter().collect::<Result<Vec<Record>>>()?;
    Ok([rates(&one, Metric::Psnr), each.rates(Metric::Psnr)])
}

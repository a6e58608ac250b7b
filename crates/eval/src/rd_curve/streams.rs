//! Streams that the `gsvx` command makes of a scene, tuned or not: points of a curve, measured with
//! processes of their own.
//!
//! A tune takes minutes, so a point is recorded by the hash of the command: it is measured once for one
//! build of `gsvx`, whatever becomes of this program.

use std::cell::OnceCell;
use std::ffi::OsStr;
use std::fs;

use anyhow::{Context, Result, ensure};
use finetune::{TrainView, framing};
use serde::{Deserialize, Serialize, Serializer};
use tune::TuneEffort;

use super::record::Coded;
use super::study::Study;
use crate::cache::Cache;
use crate::measure;
use crate::process::GsvxCommand;
use crate::progress::Bar;
use crate::scenes::TestScene;

/// How the command makes a stream.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub(crate) enum StreamKind {
    /// `gsvx encode`, with cameras.
    Encode {
        /// Without what the cameras do not see.
        drop_unseen: bool,
    },
    /// `gsvx tune`.
    Tune {
        /// How long.
        #[serde(serialize_with = "by_name")]
        effort: TuneEffort,
        /// To the renders of the model instead of the photos.
        distil: bool,
    },
}

/// As the enumeration names it.
fn by_name<S: Serializer>(effort: &TuneEffort, to: S) -> Result<S::Ok, S::Error> {
    to.collect_str(&format_args!("{effort:?}"))
}

impl StreamKind {
    /// For tables and file names.
    pub(crate) fn name(self) -> String {
        let (effort, distil) = match self {
            Self::Encode { drop_unseen: true } => return "untuned".into(),
            Self::Encode { drop_unseen: false } => return "untuned-all".into(),
            Self::Tune { effort, distil } => (effort, distil),
        };
        let distil = if distil { "-distil" } else { "" };
        format!("{}{distil}", effort.name())
    }

    /// Words of the command, but for quality and paths.
    fn words(self) -> Vec<String> {
        let (effort, distil) = match self {
            Self::Encode { drop_unseen: true } => {
                return vec!["encode".into(), "--drop-unseen".into()];
            }
            Self::Encode { drop_unseen: false } => return vec!["encode".into()],
            Self::Tune { effort, distil } => (effort, distil),
        };
        let mut out = vec!["tune".into(), "--effort".into(), effort.name().into()];
        if distil {
            out.push("--distil".into());
        }
        out
    }
}

/// One stream.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct StreamPoint {
    /// Size and quality.
    pub(crate) coded: Coded,
    /// Processor seconds of the command, all threads.
    pub(crate) user_seconds: f64,
    /// Greatest memory of the command, MB.
    pub(crate) peak_mb: f64,
    /// PSNR against renders of the model as it was trained, at views off the path of the cameras, dB.
    pub(crate) elsewhere_db: f64,
}

/// Views off the path of the cameras.
const ELSEWHERE: usize = 16;
/// Which of them: others than those that a tune visits or tells of.
const ELSEWHERE_SET: u32 = 2;

/// Streams of one scene by one build of the command.
pub(crate) struct Streams<'a> {
    study: &'a Study,
    gsvx: &'a GsvxCommand,
    cache: Cache,
    elsewhere: OnceCell<Vec<TrainView>>,
}

impl<'a> Streams<'a> {
    pub(crate) fn open(study: &'a Study, gsvx: &'a GsvxCommand) -> Result<Self> {
        let cache = study.cache_of(gsvx.path())?;
        Ok(Self { study, gsvx, cache, elsewhere: OnceCell::new() })
    }

    /// The point, if it was measured before.
    pub(crate) fn find(&self, how: StreamKind, quality: f32) -> Result<Option<StreamPoint>> {
        let usable = |p: &StreamPoint| self.study.has_stream(&p.coded);
        self.cache.find(&stage(how, quality), &(how, quality), usable)
    }

    /// The point, measured unless that was done before.
    pub(crate) fn point(&self, how: StreamKind, quality: f32) -> Result<StreamPoint> {
        if let Some(point) = self.find(how, quality)? {
            return Ok(point);
        }
        let point = self.measure(how, quality)?;
        self.cache.store(&stage(how, quality), &(how, quality), &point)?;
        Ok(point)
    }

    fn measure(&self, how: StreamKind, quality: f32) -> Result<StreamPoint> {
        let Self { study, gsvx, .. } = self;
        let dataset = &study.test.files.dataset;
        let name = stage(how, quality);
        println!("{}: {name} ...", study.test.files.name);
        let stream = format!("streams/{name}.gsvx");
        fs::create_dir_all(study.out.join("streams")).context("create streams/")?;
        let path = study.out.join(&stream);
        let mut words = how.words();
        words.extend([format!("--quality={quality}"), "--cameras".into()]);
        let words = words.iter().map(|w| w as &dyn AsRef<OsStr>);
        let words: Vec<_> = words.chain([&dataset.dir as _, &dataset.model_path as _]).collect();
        let cost = gsvx.make(&words, &path)?;
        let said: serde_json::Value = cost.json()?;
        let bytes = fs::metadata(&path).with_context(|| format!("{}", path.display()))?.len();
        ensure!(said["bytes"] == bytes, "gsvx says {} bytes, the file has {bytes}", said["bytes"]);

        let folder = tempfile::tempdir().context("make a temporary folder")?;
        let back = folder.path().join("back.ply");
        let decode_seconds = gsvx.make(&[&"decode", &path], &back)?.wall;
        let (scene, _) = gs_model::ply::read(&back)?;
        let bar = Bar::new(&format!("render {name}"), study.test.held_out.len() as u64);
        let (score, _) = measure::score(&scene, &study.test.held_out, &bar);
        let render_seconds = bar.done();
        let parts = said["parts"].as_object().into_iter().flatten();
        let parts = parts.filter_map(|(part, n)| Some((part.clone(), n.as_u64()?)));
        let coded = Coded {
            voxels: String::new(),
            quality,
            paper: None,
            bytes,
            parts: parts.collect(),
            gaussians: scene.len(),
            score,
            encode_seconds: cost.wall,
            decode_seconds,
            render_seconds,
            stream,
        };
        let elsewhere_db = measure::psnr_db(&scene, self.elsewhere());
        Ok(StreamPoint { coded, user_seconds: cost.user, peak_mb: cost.peak_mb, elsewhere_db })
    }

    /// Renders of the model off the path of the cameras.
    fn elsewhere(&self) -> &[TrainView] {
        let TestScene { model, training, .. } = &self.study.test;
        let cameras = || framing::nearby(model, training, ELSEWHERE, ELSEWHERE_SET);
        self.elsewhere
            .get_or_init(|| cameras().into_iter().map(|c| TrainView::rendered(model, c)).collect())
    }
}

fn stage(how: StreamKind, quality: f32) -> String {
    format!("{}-q{quality:.0}", how.name())
}

/// Qualities of tuned curves: from 2 dB or more below the model as it was trained to above it or near it.
pub(crate) const QUALITIES: [f32; 6] = [42.0, 50.0, 58.0, 66.0, 78.0, 90.0];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_way_has_its_words() {
        let encode = |drop_unseen| StreamKind::Encode { drop_unseen };
        assert_eq!(encode(true).words(), ["encode", "--drop-unseen"]);
        assert_eq!(encode(false).words(), ["encode"]);
        let distil = StreamKind::Tune { effort: TuneEffort::Quick, distil: true };
        assert_eq!(distil.words(), ["tune", "--effort", "quick", "--distil"]);
        assert_eq!(distil.name(), "quick-distil");
        let normal = StreamKind::Tune { effort: TuneEffort::Normal, distil: false };
        assert_eq!(normal.name(), "normal");
    }
}

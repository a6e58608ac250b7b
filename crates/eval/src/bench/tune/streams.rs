//! Streams that the `gsvx` command makes of a scene, tuned or not, measured with processes of their own.
//!
//! A tune takes minutes, so a point is recorded by the hash of the command: it is measured once for one
//! build of `gsvx`, whatever becomes of this program.

use std::cell::OnceCell;
use std::fs;

use anyhow::{Context, Result, ensure};
use finetune::{TrainView, framing};

use crate::cache::Cache;
use crate::measure;
use crate::process::GsvxCommand;
use crate::record::Record;
use crate::scenes::TestScene;
use crate::study::{StreamRecord, Study};

/// How the command makes a stream: a name for tables and files, and the words but for quality and paths.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct StreamKind {
    pub(crate) name: &'static str,
    words: &'static [&'static str],
}

impl StreamKind {
    pub(crate) const UNTUNED: Self = Self { name: "untuned", words: &["encode", "--drop-unseen"] };
    /// Streams that keep what the cameras do not see.
    pub(crate) const ALL_KEPT: Self = Self { name: "untuned-all", words: &["encode"] };
    pub(crate) const NORMAL: Self = Self { name: "normal", words: &["tune", "--effort", "normal"] };
    pub(crate) const QUICK: Self = Self { name: "quick", words: &["tune", "--effort", "quick"] };
    /// To the renders of the model instead of the photos.
    pub(crate) const DISTIL: Self =
        Self { name: "normal-distil", words: &["tune", "--effort", "normal", "--distil"] };
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
        let cache = study.cache_of(&gsvx.0)?;
        Ok(Self { study, gsvx, cache, elsewhere: OnceCell::new() })
    }

    /// The point, if it was measured before.
    pub(crate) fn find(&self, how: StreamKind, quality: f32) -> Result<Option<Record>> {
        self.cache.find(&stage(how, quality), &how.words, |r| self.study.has_stream(r))
    }

    /// The point, measured unless that was done before.
    pub(crate) fn point(&self, how: StreamKind, quality: f32) -> Result<Record> {
        if let Some(point) = self.find(how, quality)? {
            return Ok(point);
        }
        let Self { study, gsvx, cache, .. } = self;
        let name = stage(how, quality);
        println!("{}: {name} ...", study.test.files.name);
        let encode = || {
            let path = study.out.join(study.stream(&name, "gsvx")?);
            let dataset = &study.test.files.dataset;
            let mut command = gsvx.words(how.words);
            command.arg(format!("--quality={quality}")).arg("--cameras");
            let output = gsvx.make(command.arg(&dataset.dir).arg(&dataset.model_path), &path)?;
            let said: serde_json::Value = output.json()?;
            let bytes = fs::read(&path).with_context(|| format!("read {}", path.display()))?;
            let told = &said["bytes"];
            ensure!(*told == bytes.len(), "gsvx says {told} bytes, the file has {}", bytes.len());
            let parts = said["parts"].as_object().into_iter().flatten();
            let parts = parts.filter_map(|(part, n)| Some((part.clone(), n.as_u64()?))).collect();
            Ok(StreamRecord { bytes, parts, usage: output.usage })
        };
        let decode = |bytes: &[u8]| Ok(gsvx::decode(bytes)?);
        let record = study.point(cache, &name, "gsvx", &how.words, encode, decode)?;
        let decoded = decode(&fs::read(study.out.join(&record.stream))?)?;
        let elsewhere_db = Some(measure::psnr_db(&decoded, self.elsewhere()));
        let record = Record { quality, elsewhere_db, ..record };
        cache.store(&name, &how.words, &record)?;
        Ok(record)
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
    format!("{}-q{quality:.0}", how.name)
}

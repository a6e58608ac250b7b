//! [`StreamMaker`]: streams of a model at the qualities that the page asks for.

use super::ViewArgs;
use super::answer::Answer;
use crate::output::{self, Output, is_stdio};
use crate::report::Reporter;
use crate::{content, doubts, encode, exit, input, loss, views};
use anyhow::{Result, bail};
use finetune::{LossViews, Outlook};
use gs_model::{Camera, View};
use gsvx::{Aim, DEFAULT_QUALITY};
use indicatif::DecimalBytes;
use serde_json::{Value, json};
use std::borrow::Cow;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};
use tune::{EncodeInput, EncodeOutcome, EncodeRecipe};

/// Encodes one stream at a time, the newest that was asked for, and keeps it to be judged and saved.
pub(super) struct StreamMaker {
    model: PathBuf,
    cameras_path: Option<PathBuf>,
    output: Option<PathBuf>,
    force: bool,
    report: Reporter,
    input: EncodeInput,
    cameras: Option<Vec<Camera>>,
    /// Pictures of the model, once a stream was compared with it.
    loss_views: OnceLock<LossViews>,
    /// How many streams were asked for.
    asked: AtomicU64,
    last: Mutex<Option<Arc<MadeStream>>>,
}

struct MadeStream {
    wanted: Wanted,
    outcome: EncodeOutcome,
}

/// Which stream is asked for.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Wanted {
    quality: f32,
    by_cameras: bool,
}

impl Wanted {
    fn of(query: &str) -> Result<Self, String> {
        let value = |name: &str| {
            query.split('&').find_map(|part| part.strip_prefix(name)?.strip_prefix('='))
        };
        let quality = content::quality(value("quality").unwrap_or_default())?;
        Ok(Self { quality, by_cameras: value("cameras") == Some("true") })
    }
}

/// A newer stream was asked for meanwhile.
#[derive(Debug, thiserror::Error)]
#[error("a stream of another quality was asked for meanwhile")]
struct Superseded;

impl StreamMaker {
    /// Reads the model, and finds what the cameras see.
    pub(super) fn new(args: &ViewArgs, report: Reporter) -> Result<Self> {
        let ViewArgs { files, cameras: cameras_path, output, force, .. } = args;
        let [model] = &files[..] else { bail!(exit::usage("--encode takes one model")) };
        if let Some(output) = output {
            if is_stdio(output) {
                bail!(exit::usage("-o -: the page saves streams as files"));
            }
            output::check(output, *force, &[model])?;
        }
        let scene = input::strict(model)?.scene;
        let (photos, placed) = views::with_photos(cameras_path.as_deref(), &scene)?;
        let cameras = placed.map(|placed| placed.cameras);
        let recipe = recipe(DEFAULT_QUALITY, cameras.as_deref(), &photos);
        let path = cameras_path.as_deref().unwrap_or(Path::new(""));
        let input = EncodeInput::new(scene, &recipe, encode::meters(recipe.cameras))
            .map_err(|error| encode::explained(error, path, &input::name(model)))?;
        input.doubts.iter().for_each(|doubt| doubts::warn(path, doubt));
        Ok(Self {
            model: model.clone(),
            cameras_path: cameras_path.clone(),
            output: output.clone(),
            force: *force,
            report,
            input,
            cameras,
            loss_views: OnceLock::new(),
            asked: AtomicU64::new(0),
            last: Mutex::new(None),
        })
    }

    /// What the page is told in its address.
    pub(super) fn query(&self) -> String {
        let cameras = if self.cameras.is_some() { "&cameras=true" } else { "" };
        format!("&encode={DEFAULT_QUALITY}{cameras}")
    }

    /// Answers a request of the page.
    pub(super) fn answer(&self, path: &str, query: &str) -> Answer {
        let answer = match path {
            "/encode" => Self::encode,
            "/estimate" => Self::estimate,
            "/save" => Self::save,
            _ => return Answer::refused(404, "not here"),
        };
        match Wanted::of(query) {
            Err(why) => Answer::refused(400, &format!("quality: {why}")),
            Ok(wanted) => answer(self, wanted).unwrap_or_else(|error| {
                let status = if error.is::<Superseded>() { 409 } else { 500 };
                Answer::refused(status, &exit::line(&error))
            }),
        }
    }

    /// The bytes of a stream.
    fn encode(&self, wanted: Wanted) -> Result<Answer> {
        let number = self.asked.fetch_add(1, Ordering::Relaxed) + 1;
        let mut last = self.last();
        let made = match last.take().filter(|made| made.wanted == wanted) {
            Some(made) => made,
            None => {
                let cameras = self.cameras.as_deref().filter(|_| wanted.by_cameras);
                let outcome = self.input.encode(&recipe(wanted.quality, cameras, &[]), |_| {
                    let flow = self.is_newest(number);
                    if flow.is_ok() { ControlFlow::Continue(()) } else { ControlFlow::Break(()) }
                });
                self.is_newest(number)?;
                Arc::new(MadeStream { wanted, outcome: outcome? })
            }
        };
        let bytes = made.outcome.output.encoded.bytes.clone();
        *last = Some(made);
        Ok(Answer::of(bytes, "model/vnd.gsvx"))
    }

    /// How much less the last stream shows than the model, and where.
    fn estimate(&self, wanted: Wanted) -> Result<Answer> {
        let number = self.asked.load(Ordering::Relaxed);
        let made = self.made(wanted)?;
        let EncodeOutcome { output, doubts, .. } = &made.outcome;
        let views = || LossViews::new(self.input.scene(), self.cameras.as_deref());
        let views = self.loss_views.get_or_init(views);
        let loss = views.estimate(&output.encoded.decode()?, || self.is_newest(number))?;
        let mut json = loss::json(&loss);
        let cameras = self.cameras_path.as_deref().unwrap_or(Path::new(""));
        let warnings = output.warnings.iter().map(ToString::to_string);
        let doubts = doubts.iter().map(|doubt| doubts::words(cameras, doubt, ""));
        let loss_warning = loss::warning(&loss, false, wanted.by_cameras);
        json["warnings"] = warnings.chain(doubts).chain(loss_warning).collect();
        json["words"] = loss::human(&loss).into();
        json["worst"] = loss.worst.map_or(
            Value::Null,
            |Outlook { eye, ahead, angle }| json!({ "eye": eye, "ahead": ahead, "angle": angle }),
        );
        Ok(Answer::of(json.to_string().into_bytes(), "application/json"))
    }

    /// Writes the last stream, and says what makes it again.
    fn save(&self, wanted: Wanted) -> Result<Answer> {
        let made = self.made(wanted)?;
        let bytes = &made.outcome.output.encoded.bytes;
        let path = self.output.clone().unwrap_or_else(|| {
            let stem = self.model.file_stem().unwrap_or_default().to_string_lossy();
            self.model.with_file_name(format!("{stem}-q{}.gsvx", wanted.quality))
        });
        let output = Output::open(&path, self.force, &[&self.model])?;
        let written = output.write(|out| Ok(out.write_all(bytes)?))?;
        let command = self.command(wanted, &path);
        let human = format!("{}, made again by\n{command}", DecimalBytes(written.bytes));
        let json = json!({ "output": written.name, "bytes": written.bytes, "command": command });
        self.report.wrote(&written, &human, json.clone())?;
        Ok(Answer::of(json.to_string().into_bytes(), "application/json"))
    }

    /// The command that makes a stream.
    fn command(&self, wanted: Wanted, path: &Path) -> String {
        let quality = wanted.quality.to_string();
        let mut words: Vec<Cow<'_, str>> =
            vec!["gsvx".into(), "encode".into(), self.model.to_string_lossy()];
        words.extend(["-o".into(), path.to_string_lossy(), "-q".into(), quality.into()]);
        if let Some(cameras) = self.cameras_path.as_ref().filter(|_| wanted.by_cameras) {
            words.extend(["--cameras".into(), cameras.to_string_lossy()]);
        }
        shlex::try_join(words.iter().map(AsRef::as_ref)).unwrap_or_else(|_| words.join(" "))
    }

    /// The last stream, if it is this one.
    fn made(&self, wanted: Wanted) -> Result<Arc<MadeStream>> {
        let made = self.last().clone().filter(|made| made.wanted == wanted);
        Ok(made.ok_or(Superseded)?)
    }

    fn last(&self) -> MutexGuard<'_, Option<Arc<MadeStream>>> {
        self.last.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Whether no stream was asked for after this one.
    fn is_newest(&self, number: u64) -> Result<(), Superseded> {
        if self.asked.load(Ordering::Relaxed) == number { Ok(()) } else { Err(Superseded) }
    }
}

/// As `gsvx encode` encodes, without the estimate.
fn recipe<'a>(quality: f32, cameras: Option<&'a [Camera]>, photos: &'a [View]) -> EncodeRecipe<'a> {
    let aim = Aim::Quality(quality);
    EncodeRecipe { aim, cameras, photos, ..EncodeRecipe::default() }
}

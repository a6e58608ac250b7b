//! [`StreamMaker`]: streams of a model at the qualities that the page asks for.

use super::answer::Answer;
use crate::commands::encode;
use crate::output::{self, Output, is_stdio};
use crate::report::Reporter;
use crate::{content, doubts, exit, format, input, loss, views};
use anyhow::{Context, Result, anyhow, bail};
use finetune::{LossViews, Viewpoint};
use gs_model::{Camera, View};
use gsvx::{Aim, DEFAULT_QUALITY};
use indicatif::DecimalBytes;
use serde_json::{Value, json};
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};
use tune::{EncodeEvent, EncodeInput, EncodeOutcome, EncodeRecipe};

/// What `gsvx view --encode` makes.
#[derive(clap::Args, Clone, Debug)]
pub(super) struct EncodeArgs {
    /// Encode the model: the page has a slider for the quality, shows model and stream side by side with the loss, leads to
    /// where they differ most, and saves the stream.
    ///
    /// Beside the saved stream it gives the command that makes the same one.
    #[arg(long)]
    pub(super) encode: bool,
    /// With --encode: cameras of the training photos; what they see gets more bits, unless a switch in the page is off.
    #[arg(long, value_name = "PATH", requires = "encode")]
    cameras: Option<PathBuf>,
    /// With --encode: the stream that the page saves [default: beside the model, NAME-qQUALITY.gsvx].
    #[arg(short, long, value_name = "PATH", requires = "encode")]
    output: Option<PathBuf>,
    /// With --encode: replace an existing stream.
    #[arg(long, requires = "encode")]
    force: bool,
}

/// Encodes one stream at a time, the newest that was asked for, and keeps it to be judged and saved.
pub(super) struct StreamMaker {
    args: EncodeArgs,
    model: PathBuf,
    report: Reporter,
    input: EncodeInput,
    cameras: Option<Vec<Camera>>,
    /// Pictures of the model, once a stream was compared with it.
    loss_views: OnceLock<LossViews>,
    /// How many streams were asked for.
    asked: AtomicU64,
    last: Mutex<Option<(StreamRequest, Arc<EncodeOutcome>)>>,
}

/// Which stream is asked for.
#[derive(Clone, Copy, Debug, PartialEq)]
struct StreamRequest {
    quality: f32,
    by_cameras: bool,
}

impl StreamRequest {
    fn of(query: &str) -> Result<Self, String> {
        let value = |name: &str| {
            query.split('&').find_map(|part| part.strip_prefix(name)?.strip_prefix('='))
        };
        let quality = content::quality(value("quality").unwrap_or_default())?;
        Ok(Self { quality, by_cameras: value("cameras") == Some("true") })
    }
}

/// Why a stream is not made, judged or saved.
const SUPERSEDED: &str = "another stream was asked for meanwhile";

impl StreamMaker {
    /// Reads the model, and finds what the cameras see.
    pub(super) fn new(args: &EncodeArgs, files: &[PathBuf], report: Reporter) -> Result<Self> {
        let [model] = files else { bail!(exit::usage("--encode takes one model")) };
        if let Some(output) = &args.output {
            if is_stdio(output) {
                bail!(exit::usage("-o -: the page saves streams as files"));
            }
            format::check_stream_name(output)?;
            output::folder_of(&output::check(output, args.force, &[model])?)?;
        }
        let scene = input::strict(model)?.scene;
        let (photos, placed) = views::with_photos(args.cameras.as_deref(), &scene)?;
        let cameras = placed.map(|placed| placed.cameras);
        let recipe = recipe(DEFAULT_QUALITY, cameras.as_deref(), &photos);
        let path = args.cameras.as_deref().unwrap_or(Path::new(""));
        let input = EncodeInput::new(scene, &recipe, encode::meters(recipe.cameras))
            .map_err(|error| encode::explained(error, path, &input::name(model)))?;
        input.doubts.iter().for_each(|doubt| doubts::warn(path, doubt));
        let (args, model, asked) = (args.clone(), model.clone(), AtomicU64::new(0));
        let (loss_views, last) = (OnceLock::new(), Mutex::new(None));
        Ok(Self { args, model, report, input, cameras, loss_views, asked, last })
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
        match StreamRequest::of(query) {
            Err(why) => Answer::refused(400, &format!("quality: {why}")),
            Ok(wanted) => answer(self, wanted)
                .unwrap_or_else(|error| Answer::refused(409, &exit::line(&error))),
        }
    }

    /// The bytes of a stream.
    fn encode(&self, wanted: StreamRequest) -> Result<Answer> {
        let number = self.asked.fetch_add(1, Ordering::Relaxed) + 1;
        let mut last = self.last();
        let made = match last.take().filter(|last| last.0 == wanted) {
            Some((_, made)) => made,
            None => {
                let cameras = self.cameras.as_deref().filter(|_| wanted.by_cameras);
                let flow = |_: EncodeEvent<'_>| match self.is_newest(number) {
                    true => ControlFlow::Continue(()),
                    false => ControlFlow::Break(()),
                };
                Arc::new(self.input.encode(&recipe(wanted.quality, cameras, &[]), flow)?)
            }
        };
        let bytes = made.output.encoded.bytes.clone();
        *last = Some((wanted, made));
        Ok(Answer::of(bytes, "model/vnd.gsvx"))
    }

    /// How much less the last stream shows than the model, and where.
    fn estimate(&self, wanted: StreamRequest) -> Result<Answer> {
        let number = self.asked.load(Ordering::Relaxed);
        let made = self.made(wanted)?;
        let views = || LossViews::new(self.input.scene(), self.cameras.as_deref());
        let loss =
            self.loss_views.get_or_init(views).estimate(&made.output.encoded.decode()?, || {
                if self.is_newest(number) { Ok(()) } else { Err(anyhow!(SUPERSEDED)) }
            })?;
        let path = self.args.cameras.as_deref().unwrap_or(Path::new(""));
        let doubts = self.input.doubts.iter().filter(|_| wanted.by_cameras).chain(&made.doubts);
        let doubts = doubts.map(|doubt| doubts::words(path, doubt, ""));
        let warnings = made.output.warnings.iter().map(ToString::to_string).chain(doubts);
        let mut json = loss::json(&loss);
        json["warnings"] = warnings.collect();
        json["words"] = loss::human(&loss).into();
        json["worst"] = loss
            .worst
            .map_or(Value::Null, |Viewpoint { eye, ahead }| json!({ "eye": eye, "ahead": ahead }));
        Ok(Answer::of(json.to_string().into_bytes(), "application/json"))
    }

    /// Writes the last stream, and says what makes it again.
    fn save(&self, wanted: StreamRequest) -> Result<Answer> {
        let made = self.made(wanted)?;
        let path = self.args.output.clone().unwrap_or_else(|| {
            let stem = self.model.file_stem().unwrap_or_default().to_string_lossy();
            self.model.with_file_name(format!("{stem}-q{}.gsvx", wanted.quality))
        });
        let output = Output::open(&path, self.args.force, &[&self.model])?;
        let written = output.write(|out| Ok(out.write_all(&made.output.encoded.bytes)?))?;
        let command = self.command(wanted, &path);
        let human = format!("{}, made again by\n{command}", DecimalBytes(written.bytes));
        let json = json!({ "output": written.name, "bytes": written.bytes, "command": command });
        self.report.wrote(&written, &human, json.clone())?;
        Ok(Answer::of(json.to_string().into_bytes(), "application/json"))
    }

    /// The command that makes a stream.
    fn command(&self, wanted: StreamRequest, path: &Path) -> String {
        let [model, path] = [self.model.as_path(), path].map(Path::to_string_lossy);
        let quality = wanted.quality.to_string();
        let mut words = vec!["gsvx", "encode", &model, "-o", &path, "-q", &quality];
        let cameras = self.args.cameras.as_ref().map(|path| path.to_string_lossy());
        if let Some(cameras) = cameras.as_ref().filter(|_| wanted.by_cameras) {
            words.extend(["--cameras", cameras]);
        }
        shlex::try_join(words.iter().copied()).unwrap_or_else(|_| words.join(" "))
    }

    /// The last stream, if it is this one.
    fn made(&self, wanted: StreamRequest) -> Result<Arc<EncodeOutcome>> {
        let last = self.last().clone().filter(|last| last.0 == wanted);
        Ok(last.context(SUPERSEDED)?.1)
    }

    fn last(&self) -> MutexGuard<'_, Option<(StreamRequest, Arc<EncodeOutcome>)>> {
        self.last.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Whether no stream was asked for after this one.
    fn is_newest(&self, number: u64) -> bool {
        self.asked.load(Ordering::Relaxed) == number
    }
}

/// As `gsvx encode` encodes, without the estimate.
fn recipe<'a>(quality: f32, cameras: Option<&'a [Camera]>, photos: &'a [View]) -> EncodeRecipe<'a> {
    let aim = Aim::Quality(quality);
    EncodeRecipe { aim, cameras, photos, ..EncodeRecipe::default() }
}

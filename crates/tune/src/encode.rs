//! [`encode`]: from a model, with cameras or without, to a stream and what is to be said of it.

use finetune::{
    LossEstimate, References, Visibility, cut_sh_as_seen, doubt_about_share, doubted_loss,
    estimate_loss,
};
use gs_model::{Camera, Scene, View};
use gsvx::importance::with_unseen;
use gsvx::{
    Aim, EncodeOptions, EncodeProgress, EncodedStream, Encoder, EncoderOutput, LEFT_OUT, Measure,
};
use std::fmt;
use std::ops::ControlFlow;

use crate::error::{Error, Result};
use crate::photos::check_photos;
use crate::trainer::Clock;

/// How a model is encoded. The default aims at [`gsvx::DEFAULT_QUALITY`], without cameras and estimate.
#[derive(Clone, Copy, Debug)]
pub struct EncodeRecipe<'a> {
    /// What the stream aims for. PSNR and SSIMULACRA2 are those of renders against renders of the model, and need cameras.
    pub aim: Aim,
    /// What is kept, and the layout of the stream.
    pub options: EncodeOptions,
    /// The training cameras, as pinholes: what they see gets more bits.
    pub cameras: Option<&'a [Camera]>,
    /// Views with photos that prove the cameras; none if that is not asked for.
    pub photos: &'a [View],
    /// Estimate how much less the stream shows than the model.
    pub estimate: bool,
}

impl Default for EncodeRecipe<'_> {
    fn default() -> Self {
        let (aim, options) = (Aim::Quality(gsvx::DEFAULT_QUALITY), EncodeOptions::default());
        Self { aim, options, cameras: None, photos: &[], estimate: false }
    }
}

/// How far [`encode`] is.
#[derive(Clone, Copy, Debug)]
pub enum EncodeEvent<'a> {
    /// Cameras from which the model has been seen, and their number.
    Visibility(usize, usize),
    /// Renders of the model that have been made for the aim, and their number.
    References(usize, usize),
    /// A stream.
    Encoder(EncodeProgress<'a>),
}

/// A stream, and what is to be said of it.
#[derive(Debug)]
pub struct EncodeOutcome {
    /// The stream. Its rows and counts are those of the whole model.
    pub output: EncoderOutput,
    /// What the cameras see; `None` without cameras, or if [`CameraDoubt::Photos`] kept them out.
    pub seen: Option<VisibilityCount>,
    /// Why the cameras may not be the model's own.
    pub doubts: Vec<CameraDoubt>,
    /// How much less the stream shows than the model, if that was asked for.
    pub loss: Option<LossEstimate>,
    /// How long the estimate took.
    pub estimate_seconds: f64,
}

impl EncodeOutcome {
    /// Whether there were cameras that decided nothing.
    #[must_use]
    pub fn cameras_ignored(&self) -> bool {
        self.doubts.iter().any(CameraDoubt::is_decisive)
    }
}

/// How much of a model cameras see.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct VisibilityCount {
    /// [`Visibility::share`].
    pub share: f64,
    /// Gaussians that no camera sees.
    pub unseen: usize,
    /// Gaussians that cameras see, but too little to pay for their bits.
    pub hardly_seen: usize,
    /// Of both, those in the stream.
    pub kept: usize,
}

/// Why cameras may not be those of a model.
#[derive(Debug)]
pub enum CameraDoubt {
    /// The photos show something else than the model. The cameras decide nothing.
    Photos(Error),
    /// They see only this share of the model's opacity. They are used.
    Share(f64),
    /// A stream by their importances shows well to them and badly around the model. They decide nothing.
    Misfit(LossEstimate),
}

impl CameraDoubt {
    /// Whether the cameras decide nothing because of it.
    #[must_use]
    pub fn is_decisive(&self) -> bool {
        !matches!(self, Self::Share(_))
    }
}

impl fmt::Display for CameraDoubt {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let LossEstimate { at_cameras, around, .. } = match self {
            Self::Photos(error) => return f.write_str(&gs_model::chain(error)),
            Self::Share(share) => {
                return f.write_str(&doubt_about_share(*share).unwrap_or_default());
            }
            Self::Misfit(loss) => loss,
        };
        let around = around.map_or(f64::NAN, |l| l.psnr);
        match at_cameras {
            Some(at) => write!(
                f,
                "where these cameras look, a stream by their importances has {:.0} dB, but around the model \
                 {around:.0} dB",
                at.psnr
            ),
            None => write!(
                f,
                "these cameras show nothing of the model, and a stream by their importances has {around:.0} dB around it"
            ),
        }?;
        write!(f, "; are they its own? {}", finetune::MISFIT_CAUSES)
    }
}

/// Encodes a model as `gsvx encode` does:
///
/// 1. What no rasterizer draws is left out, unless it is to be kept.
/// 2. If the photos show the model at their cameras, what the cameras see becomes importance.
/// 3. The stream of the aim is made; for a PSNR or SSIMULACRA2, streams are compared with renders of the model.
/// 4. If no photos prove the cameras, and the stream shows well to them and badly to views that do not depend on them,
///    these are not the model's own, and importances from them would destroy it. It is encoded once more without them,
///    unless what they do not see is to be dropped.
///
/// `progress` ends the work where it breaks.
///
/// # Errors
/// Those of the encoder; [`Error::NothingSeen`] if the cameras see nothing; [`Error::OtherPhotos`] if what cameras do not
/// see is to be dropped, and the photos show something else.
pub fn encode(
    scene: Scene,
    recipe: &EncodeRecipe<'_>,
    mut progress: impl FnMut(EncodeEvent<'_>) -> ControlFlow<()>,
) -> Result<EncodeOutcome> {
    let mut input = EncodeInput::new(scene, recipe, &mut progress)?;
    let doubts = std::mem::take(&mut input.doubts);
    let mut outcome = input.encode(recipe, progress)?;
    outcome.doubts.splice(0..0, doubts);
    Ok(outcome)
}

/// A model with what cameras see of it, for streams of several qualities.
#[derive(Debug)]
pub struct EncodeInput {
    /// Without what no rasterizer draws.
    scene: Scene,
    /// The number of Gaussians of the whole model, and the indices of those here, if these are fewer.
    drawn: Option<(usize, Vec<usize>)>,
    /// The scene with SH of the degree that is asked for, fitted to what the cameras see.
    reduced: Option<Scene>,
    importance: Option<Vec<f32>>,
    seen: Option<VisibilityCount>,
    proven: bool,
    /// Why the cameras may not be the model's own.
    pub doubts: Vec<CameraDoubt>,
}

impl EncodeInput {
    /// The first two steps of [`encode`].
    ///
    /// # Errors
    /// As [`encode`].
    pub fn new(
        mut scene: Scene,
        recipe: &EncodeRecipe<'_>,
        mut progress: impl FnMut(EncodeEvent<'_>) -> ControlFlow<()>,
    ) -> Result<Self> {
        let EncodeRecipe { options, cameras, photos, .. } = *recipe;
        let drawn = leave_out_transparent(&mut scene, recipe)?;
        let mut tell = |event: EncodeEvent<'_>| go_on(progress(event));
        let drop_unseen = options.prepare.drop_unseen;
        let CameraEvidence { importance, count: seen, doubts, proven } =
            CameraEvidence::of(&scene, cameras, photos, drop_unseen, &mut tell)?;
        let degree = options.code.max_sh_degree;
        let is_fitted =
            importance.is_some() && scene.sh_degree > degree && !is_bounded(&recipe.aim);
        let reduced =
            is_fitted.then(|| cut_sh_as_seen(&scene, degree, cameras.unwrap_or_default()));
        Ok(Self { scene, drawn, reduced, importance, seen, proven, doubts })
    }

    /// The model without what no rasterizer draws.
    #[must_use]
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// The last two steps of [`encode`]. The recipe is that of [`EncodeInput::new`], but for a quality, a size or a
    /// likeness of its own; without cameras, what they see does not count.
    ///
    /// # Errors
    /// As [`encode`].
    pub fn encode(
        &self,
        recipe: &EncodeRecipe<'_>,
        mut progress: impl FnMut(EncodeEvent<'_>) -> ControlFlow<()>,
    ) -> Result<EncodeOutcome> {
        let EncodeRecipe { aim, options, cameras, .. } = *recipe;
        let Self { scene, drawn, .. } = self;
        let importance = self.importance.as_deref().filter(|_| cameras.is_some());
        // The likeness is to the model before pruning.
        let likeness = cameras.filter(|_| matches!(aim, Aim::Alike { .. }));
        let step = |done, all| go_on(progress(EncodeEvent::References(done, all)));
        let references =
            likeness.map(|cameras| References::new(scene, cameras, step)).transpose()?;
        let mut encoder = Encoder::new(aim);
        encoder.options = options;
        if let Some(references) = &references {
            encoder.measure_by(|measure, scene| match measure {
                Measure::Psnr => references.psnr(scene),
                Measure::Ssimulacra2 => references.ssimulacra2(scene),
            });
        }
        encoder.on_progress(move |event| progress(EncodeEvent::Encoder(event)));
        let Judgement { mut output, misfit, loss, seconds: estimate_seconds } =
            judged(&mut encoder, self, importance, recipe)?;
        let mut seen = self.seen.filter(|_| cameras.is_some());
        if let (Some(seen), Some(weights), None) = (&mut seen, importance, misfit) {
            let least = match options.prepare.drop_unseen {
                true => weights.to_vec(),
                false => with_unseen(scene, weights, output.quality.unwrap_or_default()),
            };
            seen.count(weights, &least, &output.encoded.rows);
        }
        if let Some((all, drawn)) = drawn {
            add_transparent(&mut output.encoded, *all, drawn);
        }
        let doubts = misfit.map(CameraDoubt::Misfit).into_iter().collect();
        Ok(EncodeOutcome { output, seen, doubts, loss, estimate_seconds })
    }
}

/// Whether a caller that was told of progress lets the work go on.
pub(crate) fn go_on(flow: ControlFlow<()>) -> Result<()> {
    match flow {
        ControlFlow::Continue(()) => Ok(()),
        ControlFlow::Break(()) => Err(gsvx::Error::Cancelled.into()),
    }
}

/// What cameras see of a model, and whether they are its own.
pub(crate) struct CameraEvidence {
    /// Of each Gaussian; `None` without cameras, or if photos kept them out.
    pub(crate) importance: Option<Vec<f32>>,
    count: Option<VisibilityCount>,
    pub(crate) doubts: Vec<CameraDoubt>,
    /// Whether photos prove the cameras.
    pub(crate) proven: bool,
}

impl CameraEvidence {
    /// By cameras, if there are any, which photos may prove.
    pub(crate) fn of(
        scene: &Scene,
        cameras: Option<&[Camera]>,
        photos: &[View],
        drop_unseen: bool,
        tell: &mut dyn FnMut(EncodeEvent<'_>) -> Result<()>,
    ) -> Result<Self> {
        let mut seen = Self { importance: None, count: None, doubts: Vec::new(), proven: false };
        match check_photos(scene, photos) {
            Err(error) if drop_unseen => return Err(error),
            Err(error) => seen.doubts.push(CameraDoubt::Photos(error)),
            Ok(proven) => seen.proven = proven,
        }
        if let Some(cameras) = cameras.filter(|_| seen.doubts.is_empty()) {
            let step = |done| tell(EncodeEvent::Visibility(done, cameras.len()));
            let visibility = Visibility::of(scene, cameras, step)?;
            let (share, unseen) = (visibility.share(scene), visibility.unseen());
            if share == 0.0 {
                return Err(Error::NothingSeen);
            }
            seen.doubts.extend(doubt_about_share(share).map(|_| CameraDoubt::Share(share)));
            seen.count = Some(VisibilityCount { share, unseen, ..VisibilityCount::default() });
            seen.importance = Some(visibility.squared);
        }
        Ok(seen)
    }
}

/// A stream, and how much less it shows than its model.
struct Judgement {
    output: EncoderOutput,
    /// The loss of a stream by the cameras' importances, if that is why they were not used.
    misfit: Option<LossEstimate>,
    loss: Option<LossEstimate>,
    seconds: f64,
}

/// The stream by these importances, or without them if it [casts doubt](LossEstimate::doubts_cameras) on cameras that
/// are not proven.
fn judged(
    encoder: &mut Encoder<'_>,
    EncodeInput { scene, reduced, proven, .. }: &EncodeInput,
    importance: Option<&[f32]>,
    recipe: &EncodeRecipe<'_>,
) -> gsvx::Result<Judgement> {
    let told = recipe.estimate && recipe.aim != Aim::Lossless;
    let reduced = reduced.as_ref().filter(|_| importance.is_some());
    // No cameras can harm lossless streams and bounds on errors, which have no quality.
    let doubted = importance.is_some() && !proven && !recipe.options.prepare.drop_unseen;
    encoder.keep_decoded = told || doubted;
    let mut output = encoder.encode(reduced.unwrap_or(scene), importance)?;
    let clock = Clock::start();
    let refusable = doubted && output.quality.is_some();
    let decoded = if told || refusable { Some(decoded_of(&mut output.encoded)?) } else { None };
    let loss_of = |decoded: &Scene| estimate_loss(scene, decoded, recipe.cameras);
    let loss = decoded.as_ref().filter(|_| told).map(loss_of);
    let misfit = match (&decoded, loss) {
        _ if !refusable => None,
        (_, Some(loss)) => Some(loss).filter(LossEstimate::doubts_cameras),
        (Some(decoded), None) => doubted_loss(scene, decoded, recipe.cameras.unwrap_or_default()),
        (None, None) => None,
    };
    drop(decoded);
    let mut judgement = Judgement { output, misfit, loss, seconds: clock.seconds() };
    if misfit.is_some() {
        encoder.keep_decoded = told;
        judgement.output = encoder.encode(scene, None)?;
        let clock = Clock::start();
        let decoded = if told { Some(decoded_of(&mut judgement.output.encoded)?) } else { None };
        judgement.loss = decoded.as_ref().map(loss_of);
        judgement.seconds += clock.seconds();
    }
    Ok(judgement)
}

/// The decoded scene, taken from the stream if it was kept.
fn decoded_of(encoded: &mut EncodedStream) -> gsvx::Result<Scene> {
    encoded.decoded.take().map_or_else(|| encoded.decode(), Ok)
}

impl VisibilityCount {
    /// Counts what became of what cameras see too little of. `least` has the importances by which it was kept.
    fn count(&mut self, weights: &[f32], least: &[f32], rows: &[u32]) {
        for ((&seen, &least), &row) in weights.iter().zip(least).zip(rows) {
            let kept = row != LEFT_OUT;
            let hardly = !kept || least > seen;
            self.hardly_seen += usize::from(hardly && seen > 0.0);
            self.kept += usize::from(hardly && kept);
        }
    }
}

/// Whether an aim bounds the error of each value, so that nothing is left out or fitted.
fn is_bounded(aim: &Aim) -> bool {
    matches!(aim, Aim::Lossless | Aim::MaxError(_))
}

/// Leaves out what no rasterizer draws. Returns how many Gaussians there were, and the indices of those that are left.
/// The encoder does it too, in a copy.
fn leave_out_transparent(
    scene: &mut Scene,
    recipe: &EncodeRecipe<'_>,
) -> gsvx::Result<Option<(usize, Vec<usize>)>> {
    let (all, drawn) = (scene.len(), scene.drawn().unwrap_or_default());
    if is_bounded(&recipe.aim) || drawn.is_empty() {
        return Ok(None);
    }
    // An error names the Gaussian of the model.
    gsvx::check_values(scene, recipe.options.code.max_sh_degree, 0)?;
    scene.keep(&drawn);
    Ok(Some((all, drawn)))
}

/// Counts the Gaussians that [`leave_out_transparent`] left out.
fn add_transparent(encoded: &mut EncodedStream, all: usize, drawn: &[usize]) {
    encoded.transparent += all - drawn.len();
    let rows = std::mem::replace(&mut encoded.rows, vec![LEFT_OUT; all]);
    drawn.iter().zip(rows).for_each(|(&i, row)| encoded.rows[i] = row);
}

/// Cameras that [`misfit`] looks from, and their greatest size, pixels.
const TRIED: usize = 24;
const TRIED_PIXELS: u32 = 120_000;

/// Whether cameras seem not to be those of a model: a stream of this quality by their importances shows well to them and
/// badly to views that do not depend on them.
///
/// # Errors
/// Those of the encoder.
pub fn misfit(
    scene: &Scene,
    cameras: &[Camera],
    quality: f32,
) -> gsvx::Result<Option<CameraDoubt>> {
    let (cameras, _) = finetune::that_see(scene, cameras);
    let step = cameras.len().div_ceil(TRIED).max(1);
    let cameras: Vec<Camera> =
        cameras.into_iter().step_by(step).map(|c| c.within(TRIED_PIXELS)).collect();
    let importance = Visibility::of_all(scene, &cameras).squared;
    let encoded = gsvx::encode(scene, Some(&importance), quality, &EncodeOptions::default())?;
    Ok(doubted_loss(scene, &encoded.decode()?, &cameras).map(CameraDoubt::Misfit))
}

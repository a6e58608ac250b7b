//! The views of a run: those that gradients come from, in their order, and those kept aside.
//!
//! A photo that the input model matches far worse than it does most photos shows something that the model
//! cannot: another exposure, a lens out of focus, a person who walked by. Its squared error is so large that it
//! would outweigh all others, so it counts less: see [`weights`].
//!
//! A viewer lets people walk anywhere. So some steps are made at views near the path of the photos, with renders of the
//! input model as targets, and what these views see counts in pruning and in the codec.

use finetune::framing::{around, nearby};
use finetune::metrics::Scores;
use finetune::optimiser::permutation;
use finetune::{Loss, Photo, Removal, RenderOptions, TrainView, ViewGradients, ViewLoss};
use gs_model::{Camera, Scene};

use crate::error::{Error, Result};
use crate::options::TuneOptions;
use crate::summed::DeviceSums;
use crate::targets::Targets;

/// One of this many training views is kept aside; with fewer views, none.
const ASIDE: usize = 16;
/// A photo counts in full up to this many times the median of the squared errors (3 dB).
const FULL_WEIGHT: f64 = 2.0;
/// Most nearby views, and the longest edge of their pictures.
const MOST_NEARBY: usize = 64;
const NEARBY_EDGE: f64 = 320.0;
/// Nearby views that judge the result, views around what matters in the model, and the longest edge of their pictures.
const JUDGED: usize = 12;
const JUDGED_AROUND: u32 = 4;
const JUDGED_EDGE: f64 = 320.0;

/// What a run minimises. SSIM keeps structure that the squared error blurs; `plan` has what it saves and costs.
const LOSS: Loss = Loss::mse_ssim(0.01);

/// How much nearby views count.
#[derive(Clone, Copy)]
struct Share {
    /// Part of the steps that are made at nearby views.
    of_steps: f64,
    /// What the gradients at a nearby view count, over those at another view.
    of_gradients: f32,
    /// What a pixel of a nearby view counts in pruning and in the codec, over one of another view.
    of_pixels: f32,
}

/// Beside renders of the input model, nearby views count the same.
const BESIDE_RENDERS: Share = Share { of_steps: 0.5, of_gradients: 1.0, of_pixels: 1.0 };
/// Beside photos they count less, because photos are better targets than renders. At a high quality the codec loses
/// little, and a stream differs from its input mostly because it follows the photos. So the share grows between the two
/// qualities of `GROWS_BETWEEN`: see `plan`.
const BESIDE_PHOTOS: Share = Share { of_steps: 0.125, of_gradients: 0.1, of_pixels: 0.1 };
const BESIDE_PHOTOS_AT_HIGH: Share = Share { of_steps: 0.5, of_gradients: 3.0, ..BESIDE_PHOTOS };
const GROWS_BETWEEN: [f32; 2] = [50.0, 90.0];

impl Share {
    /// The share of nearby views in a run to photos at a quality.
    fn at(quality: f32) -> Self {
        let (few, many) = (BESIDE_PHOTOS, BESIDE_PHOTOS_AT_HIGH);
        let [from, to] = GROWS_BETWEEN.map(f64::from);
        let part = ((f64::from(quality) - from) / (to - from)).clamp(0.0, 1.0);
        // Each point of quality multiplies the share by the same factor.
        let between = |a: f64, b: f64| a * libm::pow(b / a, part);
        let of_gradients = between(few.of_gradients.into(), many.of_gradients.into()) as f32;
        Self { of_steps: between(few.of_steps, many.of_steps), of_gradients, ..few }
    }
}

/// The views of a run.
pub(crate) struct Views {
    /// All cameras, for importance.
    pub(crate) cameras: Vec<Camera>,
    pub(crate) gradients: ViewGradients,
    pub(crate) aside: Vec<TrainView>,
    /// Cameras near the others. Their views are the last ones of `gradients`.
    nearby: Vec<Camera>,
    share: Share,
    /// The targets are renders of the input model.
    renders: bool,
    /// Renders of the input model, to compare the result with.
    judged: Option<JudgeViews>,
    seed: u64,
    order: Vec<u32>,
    /// Of removal effects and importances.
    pub(crate) summed: DeviceSums,
}

/// The views, and what they show of the input model.
pub(crate) struct FirstLook {
    pub(crate) views: Views,
    pub(crate) removal: Removal,
    /// Scores at the views kept aside.
    pub(crate) input_scores: Scores,
}

/// Small renders of the input model.
struct JudgeViews {
    /// At the views kept aside.
    aside: Vec<TrainView>,
    /// At cameras near the path, which no step visits.
    nearby: Vec<TrainView>,
    /// At places that depend on the model alone.
    around: Vec<TrainView>,
}

/// How well a scene shows what the input model shows: mean PSNR against its renders, dB.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AgainstInput {
    /// At the views kept aside.
    pub aside: f64,
    /// At views that no photo shows: between the cameras, beside them and farther back.
    pub nearby: f64,
    /// At views around what matters in the model, wherever the cameras stand.
    pub around: f64,
}

impl AgainstInput {
    /// The worse of [`AgainstInput::nearby`] and [`AgainstInput::around`].
    #[must_use]
    pub fn elsewhere(&self) -> f64 {
        self.nearby.min(self.around)
    }
}

impl JudgeViews {
    fn of(scene: &Scene, aside: &[TrainView], cameras: &[Camera]) -> Self {
        let render = |camera: &Camera| TrainView::rendered(scene, within(camera, JUDGED_EDGE));
        let aside = aside.iter().map(|v| render(&v.camera)).collect();
        let nearby = nearby(scene, cameras, JUDGED, 1).iter().map(render).collect();
        let around = around(scene, JUDGED_AROUND).iter().map(render).collect();
        Self { aside, nearby, around }
    }
}

impl Views {
    /// Gradients of `loss` come from all views, which all count the same.
    pub(crate) fn all(views: Vec<TrainView>, loss: Loss, seed: u64) -> Result<Self> {
        let cameras = cameras_of(&views);
        let gradients = ViewGradients::new(views, loss, &RenderOptions::default())?;
        Ok(Self {
            cameras,
            gradients,
            aside: Vec::new(),
            nearby: Vec::new(),
            share: BESIDE_PHOTOS,
            renders: false,
            judged: None,
            seed,
            order: Vec::new(),
            summed: DeviceSums::default(),
        })
    }

    /// Looks at `scene`, the input model, from all views. Some views are kept aside, and photos that it matches badly
    /// count less. There are nearby views unless what no photo shows is left out.
    ///
    /// `seen` is told how many views are done, and how many there are.
    pub(crate) fn look(
        scene: &Scene,
        targets: Targets,
        options: &TuneOptions,
        mut seen: impl FnMut(usize, usize),
    ) -> Result<FirstLook> {
        let share = if targets.are_renders() { BESIDE_RENDERS } else { BESIDE_PHOTOS };
        let (cameras, mut photos) = targets.into_parts()?;
        let renders = photos.is_empty();
        let training = cameras.len() - kept_aside(cameras.len());
        let count = if options.drop_unseen { 0 } else { training.min(MOST_NEARBY) };
        let nearby = nearby(scene, &cameras, count, 0);
        let nearby: Vec<Camera> = nearby.iter().map(|c| within(c, NEARBY_EDGE)).collect();

        let (mut done, all) = (0, cameras.len() + nearby.len());
        let mut one_more = || {
            done += 1;
            seen(done.min(all), all);
        };
        let mut summed = DeviceSums::on(options.backend)?;
        let mut psnr = vec![0.0; cameras.len()];
        let at_views = summed.removal(
            scene,
            &cameras,
            Some(&mut |i, image| {
                if renders {
                    photos.truncate(i);
                    photos.push(Photo::from(&image));
                }
                psnr[i] = photos[i].psnr_of(&image);
                one_more();
            }),
        )?;
        let mut renders_nearby = Vec::with_capacity(nearby.len());
        let at_nearby = summed.removal(
            scene,
            &nearby,
            Some(&mut |i, image| {
                renders_nearby.truncate(i);
                renders_nearby.push(Photo::from(&image));
                one_more();
            }),
        )?;

        let views = cameras.iter().cloned().zip(photos);
        let views = views.map(|(camera, photo)| TrainView { camera, photo }).collect();
        let (photos, aside) = divided(views, psnr);
        let errors: Vec<f64> = photos.psnr.iter().map(|db| libm::exp10(-0.1 * db)).collect();
        let mut gradients = ViewGradients::new(photos.views, LOSS, &RenderOptions::default())?;
        weights(&errors).iter().enumerate().for_each(|(i, w)| gradients.weigh(i, *w as f32));
        for (camera, photo) in nearby.iter().zip(renders_nearby) {
            gradients.add(TrainView { camera: camera.clone(), photo }, share.of_gradients)?;
        }
        let judged = Some(JudgeViews::of(scene, &aside, &cameras));
        let (seed, order) = (options.seed, Vec::new());
        let this =
            Self { cameras, gradients, aside, nearby, share, renders, judged, seed, order, summed };
        let removal = this.together(at_views, &at_nearby)?;
        let input_scores = this.scores(scene);
        Ok(FirstLook { views: this, removal, input_scores })
    }

    /// Makes the steps of a run to photos those of a quality.
    pub(crate) fn of_quality(&mut self, quality: f32) {
        if self.renders {
            return;
        }
        // A run that goes on from a checkpoint here has the order of this pass too.
        self.order.clear();
        self.share = Share::at(quality);
        let nearby = self.photos()..self.gradients.views();
        nearby.for_each(|view| self.gradients.weigh(view, self.share.of_gradients));
    }

    /// Number of views whose photos the steps visit.
    pub(crate) fn photos(&self) -> usize {
        self.gradients.views() - self.nearby.len()
    }

    /// The view of a step, counted from 0. Each photo is visited once before any is visited again.
    pub(crate) fn at(&mut self, step: u64) -> usize {
        let n = self.photos() as u64;
        let mut step = step;
        if !self.nearby.is_empty() {
            let nearby_before = |step: u64| (step as f64 * self.share.of_steps) as u64;
            let visited = nearby_before(step);
            if nearby_before(step + 1) > visited {
                return (n + visited % self.nearby.len() as u64) as usize;
            }
            step -= visited;
        }
        let (epoch, within) = (step / n, step % n);
        if self.order.is_empty() || within == 0 {
            self.order = permutation(self.seed, epoch, n as usize);
        }
        self.order[within as usize] as usize
    }

    /// The mean loss and the mean PSNR, dB, at the views kept aside.
    pub(crate) fn at_aside(&self, scene: &Scene) -> (f64, f64) {
        let all: Vec<ViewLoss> = self.aside.iter().map(|v| v.loss(scene, LOSS)).collect();
        let mean =
            |of: fn(&ViewLoss) -> f64| all.iter().map(of).sum::<f64>() / all.len().max(1) as f64;
        (mean(|l| l.loss), mean(ViewLoss::psnr))
    }

    /// The mean scores at the views kept aside.
    pub(crate) fn scores(&self, scene: &Scene) -> Scores {
        Scores::mean(&self.aside.iter().map(|v| v.scores(scene)).collect::<Vec<_>>())
    }

    /// Compares a scene with the input model; `None` without a single view of it.
    pub(crate) fn against_input(&self, scene: &Scene) -> Option<AgainstInput> {
        let JudgeViews { aside, nearby, around } = self.judged.as_ref()?;
        let mean = |views: &[TrainView]| {
            views.iter().map(|v| v.psnr(scene)).sum::<f64>() / views.len() as f64
        };
        let [aside, nearby, around] = [aside, nearby, around].map(|views| mean(views));
        (!nearby.is_nan()).then_some(AgainstInput { aside, nearby, around })
    }

    /// Pixels of all cameras, as they count in importances.
    pub(crate) fn pixels(&self) -> f64 {
        let nearby = if self.nearby.is_empty() { 0.0 } else { self.share.of_pixels };
        pixels(&self.cameras) * f64::from(1.0 + nearby)
    }

    /// The sum of squared blending weights of each Gaussian.
    pub(crate) fn importance(&mut self, scene: &Scene) -> Result<Vec<f32>> {
        let mut sum = self.summed.squared_weights(scene, &self.cameras)?;
        let near = self.summed.squared_weights(scene, &self.nearby)?;
        self.add_nearby(&mut sum, &near);
        Ok(sum)
    }

    /// The removal effects of all Gaussians.
    pub(crate) fn removal(&mut self, scene: &Scene) -> Result<Removal> {
        let all = self.summed.removal(scene, &self.cameras, None)?;
        let near = self.summed.removal(scene, &self.nearby, None)?;
        self.together(all, &near)
    }

    /// The removal effects in all views. The effect is the greatest number for a Gaussian that no view sees, as nothing
    /// is known of it, unless it is to be left out.
    fn together(&self, mut all: Removal, near: &Removal) -> Result<Removal> {
        self.add_nearby(&mut all.effects, &near.effects);
        self.add_nearby(&mut all.squared, &near.squared);
        if all.effects.iter().all(|&effect| effect <= 0.0) {
            return Err(Error::NothingSeen);
        }
        if !self.drop_unseen() {
            let unseen = all.effects.iter_mut().filter(|effect| **effect <= 0.0);
            unseen.for_each(|effect| *effect = f32::MAX);
        }
        Ok(all)
    }

    /// Adds to sums over the cameras those over the nearby ones, which count less.
    fn add_nearby(&self, sum: &mut [f32], near: &[f32]) {
        if !self.nearby.is_empty() {
            let pixels = pixels(&self.cameras) / pixels(&self.nearby);
            let weight = self.share.of_pixels * pixels as f32;
            sum.iter_mut().zip(near).for_each(|(all, near)| *all += weight * near);
        }
    }

    /// Whether what no view sees is left out.
    pub(crate) fn drop_unseen(&self) -> bool {
        self.nearby.is_empty()
    }
}

/// Views, and the PSNR of the input model at each, dB.
#[derive(Default)]
struct ScoredViews {
    views: Vec<TrainView>,
    psnr: Vec<f64>,
}

/// Whether a view is kept aside.
fn is_aside(view: usize) -> bool {
    view % ASIDE == ASIDE / 2
}

/// How many of so many views are kept aside.
pub(crate) fn kept_aside(views: usize) -> usize {
    (0..views).filter(|&view| is_aside(view)).count()
}

/// The views of the steps, and those kept aside. If there are too few to keep one aside, the first view judges.
fn divided(views: Vec<TrainView>, psnr: Vec<f64>) -> (ScoredViews, Vec<TrainView>) {
    let (mut photos, mut aside) = (ScoredViews::default(), Vec::new());
    for (i, (view, db)) in views.into_iter().zip(psnr).enumerate() {
        if is_aside(i) {
            aside.push(view);
        } else {
            photos.views.push(view);
            photos.psnr.push(db);
        }
    }
    if aside.is_empty() {
        aside.extend(photos.views.first().cloned());
    }
    (photos, aside)
}

/// The same view with no edge longer than `most` pixels.
fn within(camera: &Camera, most: f64) -> Camera {
    let factor = (most / f64::from(camera.width.max(camera.height))).min(1.0);
    let edge = |pixels: u32| ((f64::from(pixels) * factor).round() as u32).max(1);
    camera.scaled_to(edge(camera.width), edge(camera.height)).unwrap_or_else(|| camera.clone())
}

/// Pixels of all cameras.
fn pixels(cameras: &[Camera]) -> f64 {
    cameras.iter().map(|c| f64::from(c.width) * f64::from(c.height)).sum()
}

fn cameras_of(views: &[TrainView]) -> Vec<Camera> {
    views.iter().map(|v| v.camera.clone()).collect()
}

/// Weights of photos with these mean squared errors.
fn weights(errors: &[f64]) -> Vec<f64> {
    let mut sorted = errors.to_vec();
    sorted.sort_by(f64::total_cmp);
    let full = sorted.get(sorted.len() / 2).map_or(0.0, |median| FULL_WEIGHT * median);
    errors.iter().map(|&e| if e > full { full / e } else { 1.0 }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nearby_views_count_more_at_high_qualities() {
        let [low, middle, high] = [40.0, 70.0, 90.0].map(Share::at);
        assert_eq!((low.of_steps, low.of_gradients), (0.125, 0.1));
        assert!((middle.of_steps - 0.25).abs() < 1e-9);
        assert!((middle.of_gradients - 0.3f32.sqrt()).abs() < 1e-6);
        assert_eq!((high.of_steps, high.of_gradients), (0.5, 3.0));
    }

    #[test]
    fn only_photos_that_match_far_worse_than_most_count_less() {
        assert_eq!(weights(&[1.0, 2.0, 1.5, 0.1, 1.0]), [1.0; 5]);
        assert_eq!(weights(&[1.0, 8.0, 1.0, 1.0]), [1.0, 0.25, 1.0, 1.0]);
        assert_eq!(weights(&[0.0; 3]), [1.0; 3]);
        assert!(weights(&[]).is_empty());
    }
}

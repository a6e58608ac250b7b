//! What cameras see of each Gaussian: its blending weights.
//!
//! Importances from cameras of another scene destroy a model without an error. [`doubt_about_share`] lets a caller warn before that.

use gs_model::{Camera, Scene};

use crate::forward::Forward;
use crate::frustum::that_see;
use crate::options::RenderOptions;
use crate::stages::blend::blend_weights;
use crate::stages::gather::gather;
use crate::stages::opacity_of;
use crate::stages::project::RenderView;

/// What a set of views shows of each Gaussian; unit: pixels. Of a view of more than 30,000 pixels a part is sampled, at
/// least as many, and each of them stands for several.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Visibility {
    /// Sum over all pixels of all views of alpha T. Zero means that no view would change without the Gaussian, but for a
    /// few pixels between the sampled ones.
    pub total: Vec<f32>,
    /// Sum over all pixels of all views of (alpha T)^2: how much the squared error of the views
    /// grows with an error of this Gaussian's colour.
    pub squared: Vec<f32>,
}

/// Most pixels of a view. At full size the PSNR of office (112 views of 0.75 megapixels) at three qualities differs by
/// -0.10 to 0.07 dB.
const PIXELS: u32 = 250_000;
/// One in so many of them is sampled: every other one of every other row. The blur of a rasterizer makes a Gaussian wider
/// than two pixels unless it is faint, so a sample hardly misses one. On fox and bonsai 90 % of the sums of squares are
/// within 0.3 octaves of those over all pixels, and importance is coded in classes of half an octave.
const ONE_IN: u32 = 4;
/// All pixels of a view are sampled if it has no more than these; at least so many of a larger one.
const LEAST: u32 = 30_000;

impl Visibility {
    /// Renders `scene` from each camera that can see it; if these are more than 256, from as many of them, which stand
    /// for all. `step` is called after each with the number of cameras that are done. An error from it ends the
    /// work.
    ///
    /// # Errors
    /// Those of `step`.
    pub fn of<E>(
        scene: &Scene,
        cameras: &[Camera],
        mut step: impl FnMut(usize) -> Result<(), E>,
    ) -> Result<Self, E> {
        let (chosen, each) = that_see(scene, cameras);
        let (shapes, mut sum) = (ColourlessScene::of(scene), WeightSums::default());
        sum.start(scene.len());
        for (i, camera) in chosen.iter().enumerate() {
            sum.add(&shapes, camera);
            step((i + 1) * cameras.len() / chosen.len())?;
        }
        let mut all = sum.visibility;
        if each > 1.0 {
            let weights = all.total.iter_mut().chain(&mut all.squared);
            weights.for_each(|w| *w = (f64::from(*w) * each) as f32);
        }
        Ok(all)
    }

    /// Renders `scene` from every camera; views are summed in the order given.
    ///
    /// ```
    /// use finetune::Visibility;
    /// use gs_model::{Camera, Scene};
    ///
    /// let scene = Scene {
    ///     means: vec![[0.0, 0.0, 0.0], [0.0, 0.0, -9.0]],
    ///     rotations: vec![[1.0, 0.0, 0.0, 0.0]; 2],
    ///     log_scales: vec![[-2.0; 3]; 2],
    ///     opacity_logits: vec![1.0; 2],
    ///     sh_degree: 0,
    ///     sh: vec![[0.0; 3]; 2],
    ///     ..Scene::default()
    /// };
    /// // The camera looks at the first Gaussian; the second is behind it.
    /// let (eye, up) = ([0.0, 0.0, -2.0], [0.0, -1.0, 0.0]);
    /// let camera = Camera::looking_at("front".into(), eye, [0.0; 3], up, [32, 24], 30.0);
    /// let seen = Visibility::of_all(&scene, &[camera]);
    /// assert_eq!((seen.unseen(), seen.share(&scene)), (1, 0.5));
    /// ```
    #[must_use]
    pub fn of_all(scene: &Scene, cameras: &[Camera]) -> Self {
        let (shapes, mut sum) = (ColourlessScene::of(scene), WeightSums::default());
        sum.start(scene.len());
        cameras.iter().for_each(|camera| sum.add(&shapes, camera));
        sum.visibility
    }

    /// Number of Gaussians that no camera sees.
    #[must_use]
    pub fn unseen(&self) -> usize {
        self.squared.iter().filter(|&&w| w <= 0.0).count()
    }

    /// Share of the opacity of `scene` that is seen: the sum of the opacities of the Gaussians whose weight is above
    /// zero, over the sum of all opacities. It is 0 if the cameras see nothing, and 1 if they see every Gaussian, or if
    /// the scene has no opacity at all. A Gaussian without a weight counts as unseen.
    #[must_use]
    pub fn share(&self, scene: &Scene) -> f64 {
        let (mut seen, mut all) = (0.0, 0.0);
        for (i, &logit) in scene.opacity_logits.iter().enumerate() {
            let opacity = f64::from(opacity_of(logit));
            if opacity.is_finite() {
                all += opacity;
                seen += if self.squared.get(i).is_some_and(|&w| w > 0.0) { opacity } else { 0.0 };
            }
        }
        if all > 0.0 { seen / all } else { 1.0 }
    }
}

/// A scene without colours, along a Morton curve: what lies beside a view is skipped in groups.
pub(crate) struct ColourlessScene {
    scene: Scene,
    /// The index of each Gaussian in the scene that this was made of.
    order: Vec<usize>,
}

impl ColourlessScene {
    pub(crate) fn of(scene: &Scene) -> Self {
        // Arrays of inconsistent lengths: nothing can be drawn.
        let drawable = scene.check_shape().is_ok();
        let order = if drawable { gs_model::morton_order(&scene.means) } else { Vec::new() };
        let mut shapes = scene.emptied(0);
        for &i in &order {
            shapes.means.push(scene.means[i]);
            shapes.rotations.push(scene.rotations[i]);
            shapes.log_scales.push(scene.log_scales[i]);
            shapes.opacity_logits.push(scene.opacity_logits[i]);
        }
        shapes.sh.resize(order.len(), [0.0; 3]);
        Self { scene: shapes, order }
    }
}

/// Blending weights over the views so far.
#[derive(Default)]
pub(crate) struct WeightSums {
    pub(crate) visibility: Visibility,
    views: u32,
    forward: Forward,
    weights: Vec<[f32; 2]>,
    sums: Vec<[f32; 2]>,
}

impl WeightSums {
    /// Of so many Gaussians, without views. It may have been of others before.
    pub(crate) fn start(&mut self, gaussians: usize) {
        for weights in [&mut self.visibility.total, &mut self.visibility.squared] {
            weights.clear();
            weights.resize(gaussians, 0.0);
        }
        self.views = 0;
    }

    /// Adds a view.
    pub(crate) fn add(
        &mut self,
        ColourlessScene { scene, order }: &ColourlessScene,
        camera: &Camera,
    ) {
        let Self { visibility, forward: f, weights, sums, .. } = self;
        let (view, each) = sampled(camera, self.views);
        self.views += 1;
        f.lists(scene, &view);
        blend_weights(&view, &f.projected.seen.splats, &f.lists, weights);
        gather(&f.lists, weights, f.order.len(), sums, |_, _| ());
        for (i, &[w, w2]) in f.projected.gaussians().zip(&*sums) {
            visibility.total[order[i]] += each * w;
            visibility.squared[order[i]] += each * w2;
        }
    }
}

/// The `n`-th view with a part of its pixels, and the pixels that each of them stands for. A smaller camera whose blur is
/// smaller likewise has at each pixel what the larger one has at one point. The points follow the sequence R2 (Roberts
/// 2018: multiples of 1/p and 1/p^2, p^3 = p + 1), so that those of one view lie between those of another.
pub(crate) fn sampled(camera: &Camera, n: u32) -> (RenderView, f32) {
    let whole = camera.within(PIXELS);
    let mut part = whole.within((whole.width * whole.height / ONE_IN).max(LEAST));
    let area = |c: &Camera| c.width as f32 * c.height as f32;
    let points = area(&whole) / area(&part);
    if points > 1.0 {
        let shift = |multiple: f64| (f64::from(n + 1) * multiple).fract() - 0.5;
        part.cx += shift(0.754_877_666_246_692_7);
        part.cy += shift(0.569_840_290_998_053_2);
    }
    let mut view = RenderView::new(&part, &RenderOptions::default());
    view.lens.blur /= points;
    (view, area(camera) / area(&part))
}

/// Cameras that see less than this share of a scene's opacity may be those of another scene.
const LEAST_SEEN: f64 = 0.5;

/// Why cameras do not fit their model, most often.
pub const MISFIT_CAUSES: &str = "Most often nerfstudio's dataparser_transforms.json is not beside transforms.json, the \
    trainer moved the scene (gsplat without --no-normalize-world-space), or the axes (y or z up) or the units differ";

/// A sentence, if cameras that see this [share](Visibility::share) of a scene may be those of another: they see nothing,
/// or less than half of the opacity.
#[must_use]
pub fn doubt_about_share(share: f64) -> Option<String> {
    let part = match share {
        s if s >= LEAST_SEEN => return None,
        0.0 => "nothing of the model".into(),
        s if s < 0.01 => "less than 1 % of the model's opacity".into(),
        s => format!("{:.0} % of the model's opacity", 100.0 * s),
    };
    Some(format!("these cameras see {part}; are they its own? {MISFIT_CAUSES}"))
}

//! Gradients of one view after another, for optimisers of other parameters than a scene's arrays.

use gs_model::Scene;

use crate::backward::{Backward, planes_of};
use crate::error::Result;
use crate::options::{Loss, RenderOptions};
use crate::stages::blend_adjoint::{FROZEN, MOVING};
use crate::stages::loss::ViewLoss;
use crate::stages::project::{RenderView, project};
use crate::stages::project_adjoint::{Gaussian, ParameterGradient, parameter_gradient};
use crate::train_view::{TrainView, check_views};

/// Renders views, compares them with their photos and gives gradients. Buffers are used again from view
/// to view.
pub struct ViewGradients {
    pub(crate) views: Vec<PreparedView>,
    options: RenderOptions,
    pub(crate) loss: Loss,
    pass: Pass,
    last: usize,
    /// Planes of the photo of the last view.
    planes: Vec<f32>,
}

impl TrainView {
    /// The loss of a scene's render against the photo.
    #[must_use]
    pub fn loss(&self, scene: &Scene, loss: Loss) -> ViewLoss {
        let prepared = PreparedView::new(self.clone(), &RenderOptions::default());
        let (mut pass, mut photo) = (Backward::<FROZEN>::default(), Vec::new());
        prepared.planes(&mut photo);
        pass.forward.run(scene, &prepared.view);
        pass.loss(&prepared.view, &photo, loss)
    }
}

/// A view and the planes of its photo.
pub(crate) struct PreparedView {
    pub(crate) view: RenderView,
    planes: Vec<u8>,
    /// Its gradients are multiplied by it.
    pub(crate) weight: f32,
}

impl PreparedView {
    pub(crate) fn new(TrainView { camera, photo }: TrainView, options: &RenderOptions) -> Self {
        let planes = planes_of(&photo.rgb);
        Self { view: RenderView::new(&camera, options), planes, weight: 1.0 }
    }

    /// The view in windows of at most so many pixels, each as the whole view shows it.
    fn in_windows(self, most: u32) -> impl Iterator<Item = Self> {
        let (w, h) = (self.view.width, self.view.height);
        let [columns, rows] = grid([w, h], most);
        let cells = (0..rows).flat_map(move |row| (0..columns).map(move |column| (column, row)));
        cells.map(move |(column, row)| {
            let edge = |i: u32, n: u32, size: u32| i * size / n;
            let x = edge(column, columns, w)..edge(column + 1, columns, w);
            let y = edge(row, rows, h)..edge(row + 1, rows, h);
            let lines = (0..3).flat_map(|plane| y.clone().map(move |y| plane * h + y));
            let line = |line: u32| {
                let start = line as usize * w as usize;
                &self.planes[start + x.start as usize..start + x.end as usize]
            };
            let planes = lines.flat_map(line).copied().collect();
            Self { view: self.view.window(x.clone(), y.clone()), planes, weight: self.weight }
        })
    }

    /// The planes, a byte per value.
    #[cfg(feature = "gpu")]
    pub(crate) fn bytes(&self) -> &[u8] {
        &self.planes
    }

    /// Puts the planes into `out`.
    pub(crate) fn planes(&self, out: &mut Vec<f32>) {
        out.clear();
        out.extend(self.planes.iter().map(|&v| f32::from(v) / 255.0));
    }
}

/// Columns and rows of windows of at most so many pixels that are as square as possible.
fn grid([w, h]: [u32; 2], most: u32) -> [u32; 2] {
    let mut cells = [1, 1];
    let edges = |c: [u32; 2]| [w.div_ceil(c[0]), h.div_ceil(c[1])];
    while let [x, y] = edges(cells)
        && u64::from(x) * u64::from(y) > u64::from(most.max(1))
    {
        cells[usize::from(y > x)] += 1;
    }
    cells
}

/// With or without gradients of the means.
enum Pass {
    Frozen(Box<Backward<FROZEN>>),
    Moving(Box<Backward<MOVING>>),
}

impl ViewGradients {
    /// Prepares the views.
    ///
    /// # Errors
    /// [`NoViews`](crate::Error::NoViews), [`PhotoSize`](crate::Error::PhotoSize),
    /// [`ViewSize`](crate::Error::ViewSize), [`DistortedView`](crate::Error::DistortedView).
    pub fn new(views: Vec<TrainView>, loss: Loss, options: &RenderOptions) -> Result<Self> {
        check_views(&views)?;
        let views = views.into_iter().map(|v| PreparedView::new(v, options)).collect();
        let (options, pass) = (*options, Pass::Frozen(Box::default()));
        Ok(Self { views, options, loss, pass, last: 0, planes: Vec::new() })
    }

    /// Divides the views into windows of at most so many pixels, which are views of their own: a step costs no more on
    /// a large photo than on a small one.
    pub fn split(&mut self, most: u32) {
        let views = std::mem::take(&mut self.views);
        self.views = views.into_iter().flat_map(|view| view.in_windows(most)).collect();
    }

    /// Adds a view of this weight behind the others.
    ///
    /// # Errors
    /// As [`ViewGradients::new`].
    pub fn add(&mut self, view: TrainView, weight: f32) -> Result<()> {
        check_views(std::slice::from_ref(&view))?;
        self.views.push(PreparedView { weight, ..PreparedView::new(view, &self.options) });
        Ok(())
    }

    /// Gives view `view` (modulo their number) a weight: its gradients are multiplied by it. At first it is 1.
    pub fn weigh(&mut self, view: usize, weight: f32) {
        let n = self.views.len();
        self.views[view % n].weight = weight;
    }

    /// Whether gradients of the means are wanted from now on; at first they are not.
    pub fn move_means(&mut self, wanted: bool) {
        self.pass =
            if wanted { Pass::Moving(Box::default()) } else { Pass::Frozen(Box::default()) };
    }

    /// Number of views.
    #[must_use]
    pub fn views(&self) -> usize {
        self.views.len()
    }

    /// Renders `scene` at view `view` (modulo their number) and prepares the gradients.
    pub fn run(&mut self, scene: &Scene, view: usize) -> ViewLoss {
        self.last = view % self.views.len();
        let prepared = &self.views[self.last];
        prepared.planes(&mut self.planes);
        let (view, photo) = (&prepared.view, &self.planes);
        match &mut self.pass {
            Pass::Frozen(pass) => pass.run(scene, view, photo, self.loss),
            Pass::Moving(pass) => pass.run(scene, view, photo, self.loss),
        }
    }

    /// What the stage `gather` found at the last view, means moving.
    #[cfg(all(test, feature = "gpu"))]
    pub(crate) fn sums(&self) -> Vec<[f32; MOVING]> {
        match &self.pass {
            Pass::Frozen(_) => Vec::new(),
            Pass::Moving(pass) => pass.all_sums(),
        }
    }

    /// Finds out which Gaussians view `view` (modulo their number) may show.
    pub(crate) fn look(&mut self, scene: &Scene, view: usize) {
        let view = &self.views[view % self.views.len()].view;
        match &mut self.pass {
            Pass::Frozen(pass) => project(view, scene, &mut pass.forward.projected),
            Pass::Moving(pass) => project(view, scene, &mut pass.forward.projected),
        }
    }

    /// Whether the view last looked at may show Gaussian `i`.
    #[inline(always)]
    pub(crate) fn may_show(&self, i: usize) -> bool {
        match &self.pass {
            Pass::Frozen(pass) => pass.forward.projected.place(i).is_some(),
            Pass::Moving(pass) => pass.forward.projected.place(i).is_some(),
        }
    }

    /// Whether Gaussian `i` reaches a pixel of the last view.
    #[inline(always)]
    pub(crate) fn shows(&self, i: usize) -> bool {
        match &self.pass {
            Pass::Frozen(pass) => pass.sum(i).is_some(),
            Pass::Moving(pass) => pass.sum(i).is_some(),
        }
    }

    /// The gradients of Gaussian `i` at the last view; `None` if it reaches no pixel. `scene` is that of
    /// [`ViewGradients::run`].
    // The result is large: a call would copy it through memory.
    #[inline(always)]
    #[must_use]
    pub fn of(&self, scene: &Scene, i: usize) -> Option<ParameterGradient> {
        self.of_gaussian(&Gaussian::of(scene, i), i)
    }

    /// The same of a Gaussian in any form.
    #[inline(always)]
    pub(crate) fn of_gaussian(
        &self,
        gaussian: &Gaussian<'_>,
        i: usize,
    ) -> Option<ParameterGradient> {
        let PreparedView { view, weight, .. } = &self.views[self.last];
        match &self.pass {
            Pass::Frozen(pass) => Some(parameter_gradient(view, *weight, gaussian, pass.sum(i)?)),
            Pass::Moving(pass) => Some(parameter_gradient(view, *weight, gaussian, pass.sum(i)?)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Photo;
    use gs_model::Camera;

    #[test]
    fn windows_are_small_enough() {
        for (size, most) in
            [([749, 1000], 250_000), ([5, 3], 1), ([640, 480], 307_200), ([7, 900], 100)]
        {
            let [columns, rows] = grid(size, most);
            assert!(size[0].div_ceil(columns) * size[1].div_ceil(rows) <= most, "{size:?}");
            assert!(columns <= size[0] && rows <= size[1], "{size:?}");
        }
        assert_eq!(grid([640, 480], 640 * 480), [1, 1]);
        assert_eq!(grid([749, 1000], 250_000), [2, 2]);
    }

    #[test]
    fn the_gradients_of_the_windows_add_up_to_those_of_the_whole_view() {
        let scene = testing::trained_like(300, 1, &mut testing::Rng::seeded(4));
        let (eye, up) = ([0.0, 0.5, -3.0], [0.0, -1.0, 0.0]);
        let camera = Camera::looking_at("a".into(), eye, [0.0; 3], up, [75, 53], 60.0);
        let photo = Photo {
            rgb: (0..75 * 53 * 3).map(|i| (i % 251) as u8).collect(),
            ..Photo::black(75, 53)
        };
        let views = vec![TrainView { camera, photo }];
        let options = RenderOptions::default();
        let mut whole = ViewGradients::new(views.clone(), Loss::MSE, &options).unwrap();
        let mut parts = ViewGradients::new(views, Loss::MSE, &options).unwrap();
        parts.split(600);
        assert!(parts.views() > 4);
        let mut sums = vec![([0.0f32; 3], 0.0); scene.len()];
        let mut mse = 0.0;
        for part in 0..parts.views() {
            let view = &parts.views[part].view;
            let share = (view.width * view.height) as f32 / (75.0 * 53.0);
            mse += f64::from(share) * parts.run(&scene, part).mse;
            for (i, (scale, opacity)) in sums.iter_mut().enumerate() {
                let Some(g) = parts.of(&scene, i) else { continue };
                scale.iter_mut().zip(g.log_scale).for_each(|(sum, g)| *sum += share * g);
                *opacity += share * g.opacity_logit;
            }
        }
        assert!((whole.run(&scene, 0).mse - mse).abs() < 1e-6);
        let mut seen = 0;
        for (i, (scale, opacity)) in sums.iter().enumerate() {
            let Some(g) = whole.of(&scene, i) else { continue };
            seen += 1;
            let close =
                |a: f32, b: f32| assert!((a - b).abs() < 1e-5 + 1e-3 * a.abs(), "{i}: {a}, {b}");
            scale.iter().zip(g.log_scale).for_each(|(a, b)| close(*a, b));
            close(*opacity, g.opacity_logit);
        }
        assert!(seen > 100, "{seen}");
    }
}

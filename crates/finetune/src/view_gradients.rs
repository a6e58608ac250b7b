//! Gradients of one view after another, for optimisers of other parameters than a scene's arrays.

use gs_model::Scene;

use crate::backward::{Backward, planes_of};
use crate::error::Result;
use crate::options::{Loss, RenderOptions};
use crate::stages::blend_adjoint::{FROZEN, MOVING};
use crate::stages::loss::ViewLoss;
use crate::stages::project::RenderView;
use crate::stages::project_adjoint::{ParameterGradient, parameter_gradient};
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

    /// Puts the planes into `out`.
    pub(crate) fn planes(&self, out: &mut Vec<f32>) {
        out.clear();
        out.extend(self.planes.iter().map(|&v| f32::from(v) / 255.0));
    }
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

    /// What the stage `gather` found at the last view, means frozen.
    #[cfg(all(test, feature = "gpu"))]
    pub(crate) fn sums(&self) -> Vec<[f32; 7]> {
        match &self.pass {
            Pass::Frozen(pass) => pass.sums.clone(),
            Pass::Moving(_) => Vec::new(),
        }
    }

    /// The gradients of Gaussian `i` at the last view; `None` if it reaches no pixel. `scene` is that of
    /// [`ViewGradients::run`].
    // The result is large: a call would copy it through memory.
    #[inline(always)]
    #[must_use]
    pub fn of(&self, scene: &Scene, i: usize) -> Option<ParameterGradient> {
        let PreparedView { view, weight, .. } = &self.views[self.last];
        match &self.pass {
            Pass::Frozen(pass) => parameter_gradient(view, *weight, scene, i, pass.sums.get(i)?),
            Pass::Moving(pass) => parameter_gradient(view, *weight, scene, i, pass.sums.get(i)?),
        }
    }
}

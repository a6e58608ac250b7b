//! Blending weights: how much each Gaussian contributes to a set of views.

use gs_model::{Camera, Scene};

use crate::forward::Forward;
use crate::options::RenderOptions;
use crate::stages::blend::blend_weights;
use crate::stages::gather::gather;
use crate::stages::project::RenderView;

/// Blending weights of each Gaussian over a set of views; unit: pixels.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Saliency {
    /// Sum over all pixels of all views of alpha T. Zero means that no view would change without the Gaussian.
    pub total: Vec<f32>,
    /// Sum over all pixels of all views of (alpha T)^2: how much the squared error of the views
    /// grows with an error of this Gaussian's colour.
    pub squared: Vec<f32>,
}

/// Blending weights of every Gaussian, accumulated over `cameras`. Costs one forward pass per camera; views are summed
/// in the order given.
#[must_use]
pub fn saliency(scene: &Scene, cameras: &[Camera]) -> Saliency {
    let n = scene.len();
    let mut out = Saliency { total: vec![0.0; n], squared: vec![0.0; n] };
    let mut f = Forward::default();
    let (mut weights, mut sums) = (Vec::new(), Vec::new());
    for camera in cameras {
        let view = RenderView::new(camera, &RenderOptions::default());
        f.lists(scene, &view);
        blend_weights(&view, &f.projected.seen.splats, &f.lists, &mut weights);
        gather(&f.lists, &weights, f.order.len(), &mut sums, |_, _| ());
        for (i, &[w, w2]) in f.projected.gaussians().zip(&sums) {
            out.total[i] += w;
            out.squared[i] += w2;
        }
    }
    out
}

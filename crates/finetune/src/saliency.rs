//! Blending weights: how much each Gaussian contributes to a set of views.

use gs_model::{Camera, Scene};

use crate::forward::Forward;
use crate::options::RenderOptions;
use crate::stages::blend::blend_weights;
use crate::stages::gather::gather;
use crate::stages::project::{View, project};
use crate::stages::sort_depth::sort_depth;
use crate::stages::tiles::tile_lists;

/// Per-Gaussian blending weights over a set of views; unit: pixels.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Saliency {
    /// Sum over all pixels of all views of alpha T.
    pub total: Vec<f32>,
    /// Sum over all pixels of all views of (alpha T)^2: how much the squared error of the views
    /// grows with an error of this Gaussian's colour.
    pub squared: Vec<f32>,
    /// Largest sum over the pixels of a single view.
    pub peak: Vec<f32>,
    /// Number of views to which the Gaussian contributes at all.
    pub views: Vec<u32>,
}

/// Blending weights of every Gaussian, accumulated over `cameras`: the sum over all pixels of
/// alpha T. Zero means that no view would change without the Gaussian.
#[must_use]
pub fn saliency(scene: &Scene, cameras: &[Camera]) -> Vec<f32> {
    saliency_per_view(scene, cameras).total
}

/// As [`saliency`], with the peak over the views and the number of views as well. Costs one
/// forward pass per camera; views are summed in the order given.
#[must_use]
pub fn saliency_per_view(scene: &Scene, cameras: &[Camera]) -> Saliency {
    let n = scene.len();
    let mut out = Saliency {
        total: vec![0.0; n],
        squared: vec![0.0; n],
        peak: vec![0.0; n],
        views: vec![0; n],
    };
    let mut f = Forward::default();
    let (mut weights, mut sums) = (Vec::new(), Vec::new());
    for camera in cameras {
        let view = View::new(camera, &RenderOptions::default());
        project(&view, scene, &mut f.projected);
        sort_depth(&f.projected.keys, &mut f.order);
        let (splats, boxes) = (&f.projected.splats, &f.projected.boxes);
        tile_lists(&view, splats, boxes, &f.order, &mut f.lists);
        blend_weights(&view, splats, &f.lists, &mut weights);
        gather::<2>(&f.lists, &weights, n, &mut sums);
        for (i, &[w, w2]) in sums.iter().enumerate() {
            out.total[i] += w;
            out.squared[i] += w2;
            out.peak[i] = out.peak[i].max(w);
            out.views[i] += u32::from(w > 0.0);
        }
    }
    out
}

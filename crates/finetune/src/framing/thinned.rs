//! [`ThinnedScene`]: how much of the detail a camera sees, quickly.

use gs_model::{Camera, SH_C0, Scene};
use rayon::prelude::*;

use super::bulk::{Weigh, weights};
use super::ring::{Placement, Ring};
use crate::forward::render;
use crate::image::Image;
use crate::options::RenderOptions;
use crate::visibility::{ColourlessScene, WeightSums};

/// Cameras on a circle during the search, and for the choice of an arc.
pub(super) const FEW: u32 = 8;
const MANY: u32 = 24;
/// From where cameras see less than this share of what the best one sees, there is next to nothing: the other side of
/// a model that was photographed from one side. The back of an object has half of the detail of its front, or a third.
pub(super) const SEES: f64 = 0.25;
/// An arc longer than this is the whole circle, in turns.
const WHOLE: f64 = 0.8;

/// A copy of a scene with fewer, larger Gaussians without view dependence, which is drawn quickly.
pub(super) struct ThinnedScene {
    scene: Scene,
    shapes: ColourlessScene,
    weights: Vec<f64>,
    tangents: [f64; 2],
}

/// Gaussians that a copy has at most.
const MOST: usize = 8_000;
/// Pixels along the longer edge of its images.
const EDGE_PIXELS: f64 = 64.0;
/// A Gaussian that fills this much of a pixel is seen.
const SEEN: f64 = 0.02;

/// At most `most` Gaussians of a scene, larger by as much as they are fewer, without view dependence; and
/// their numbers.
pub(super) fn thinned(scene: &Scene, most: usize) -> (Scene, Vec<usize>) {
    let step = scene.len().div_ceil(most).max(1);
    let chosen: Vec<usize> = (0..scene.len()).step_by(step).collect();
    let mut base = scene.emptied(0);
    let larger = 0.5 * libm::log(step as f64) as f32;
    for &i in &chosen {
        base.means.push(scene.means[i]);
        base.rotations.push(scene.rotations[i]);
        base.log_scales.push(scene.log_scales[i].map(|s| s + larger));
        base.opacity_logits.push(scene.opacity_logits[i]);
        base.sh.push(scene.sh_of(i)[0]);
    }
    (base, chosen)
}

/// The pixels at the edge of an image.
pub(super) fn edge(image: &Image) -> impl Iterator<Item = &[f32]> {
    let [width, height] = [image.width as usize, image.height as usize];
    image.rgb.chunks_exact(3).enumerate().filter_map(move |(i, rgb)| {
        let (x, y) = (i % width, i / width);
        (x == 0 || y == 0 || x + 1 == width || y + 1 == height).then_some(rgb)
    })
}

impl ThinnedScene {
    pub(super) fn of(scene: &Scene, tangents: [f64; 2], weigh: Weigh) -> Self {
        let weights = weights(scene, weigh);
        let (base, chosen) = thinned(scene, MOST);
        let weights = chosen.iter().map(|&i| weights[i]).collect();
        Self { shapes: ColourlessScene::of(&base), scene: base, weights, tangents }
    }

    /// A small camera on a circle.
    fn camera(&self, ring: &Ring, turn: f64) -> Camera {
        let wide = self.tangents[0].max(self.tangents[1]);
        let size = self.tangents.map(|t| (EDGE_PIXELS * t / wide).round().max(1.0) as u32);
        ring.camera(String::new(), turn, size, 0.5 * EDGE_PIXELS / wide)
    }

    /// The share of the detail that one camera sees.
    pub(super) fn view(&self, ring: &Ring, turn: f64) -> f64 {
        self.view_in(&mut WeightSums::default(), ring, turn)
    }

    fn view_in(&self, buffers: &mut WeightSums, ring: &Ring, turn: f64) -> f64 {
        buffers.start(self.scene.len());
        buffers.add(&self.shapes, &self.camera(ring, turn));
        let seen = buffers.visibility.total.iter().zip(&self.weights);
        let sum: f64 = seen.map(|(&s, w)| w * (f64::from(s) / SEEN).min(1.0)).sum();
        sum / self.weights.iter().sum::<f64>().max(f64::MIN_POSITIVE)
    }

    /// The share of the detail that each of `n` cameras on a circle sees.
    fn views(&self, ring: &Ring, n: u32) -> Vec<f64> {
        let turns = (0..n).into_par_iter().map(|i| f64::from(i) / f64::from(n));
        let view = |buffers: &mut WeightSums, turn| self.view_in(buffers, ring, turn);
        turns.map_init(WeightSums::default, view).collect()
    }

    /// How opaque the edges of a few pictures are, from 0 to 1.
    pub(super) fn edges(&self, ring: &Ring) -> f64 {
        let mut white = self.scene.clone();
        white.sh.fill([0.5 / SH_C0; 3]);
        let of_one = |i: u32| {
            let camera = self.camera(ring, f64::from(i) / f64::from(FEW));
            let image = render(&white, &camera, &RenderOptions::default());
            edge(&image).map(|rgb| f64::from(rgb[0])).sum::<f64>() / edge(&image).count() as f64
        };
        (0..FEW).map(of_one).sum::<f64>() / f64::from(FEW)
    }

    /// How much each of a few cameras on a circle sees, in descending order.
    pub(super) fn few(&self, ring: &Ring) -> Vec<f64> {
        let mut seen = self.views(ring, FEW);
        seen.sort_by(|a, b| b.total_cmp(a));
        seen
    }

    /// How much the better half of a circle sees: many models were photographed from one side.
    pub(super) fn best_half(&self, ring: &Ring) -> f64 {
        self.few(ring).iter().take(FEW as usize / 2).sum()
    }

    /// How much a whole circle sees.
    pub(super) fn all(&self, ring: &Ring) -> f64 {
        self.few(ring).iter().sum()
    }

    /// The part of a circle around its best camera from which as much is seen as from there.
    pub(super) fn arc(&self, ring: Ring) -> Placement {
        let turn = |i: u32| f64::from(i % MANY) / f64::from(MANY);
        let seen = self.views(&ring, MANY);
        let best = (0..MANY).max_by(|&a, &b| {
            let order = seen[a as usize].total_cmp(&seen[b as usize]);
            order.then(b.cmp(&a))
        });
        let best = best.unwrap_or(0);
        let good = |i: u32| seen[(i % MANY) as usize] >= SEES * seen[best as usize];
        let after = (1..MANY).take_while(|&k| good(best + k)).count() as u32;
        let before = (1..MANY).take_while(|&k| good(best + MANY - k)).count() as u32;
        let step = 1.0 / f64::from(MANY);
        let whole = f64::from(after + before) * step >= WHOLE;
        let place = turn(best);
        let ends = [place - f64::from(before) * step, place + f64::from(after) * step];
        Placement { ring, best: place, arc: (!whole).then_some(ends) }
    }
}

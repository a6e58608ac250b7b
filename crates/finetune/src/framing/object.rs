//! Models of one object without a background: cameras show the whole of it, wherever its detail is.

use glam::DVec3;
use gs_model::Scene;

use super::bulk::{Bulk, Weigh, quantile, weights};
use super::thinned::ThinnedScene;
use super::{Constraints, Placement, Ring, framing_distance};

/// The share of the opacity that the whole of a model has: a few specks in the air are none of it.
const NEARLY_ALL: f64 = 0.999;
/// How far a Gaussian reaches, standard deviations.
const SIZES: f64 = 1.5;
/// A model whose whole is wider than this many times the bulk of its detail has a background.
const WIDE: f64 = 4.0;
/// The edges of pictures of an object are less opaque than this. They are at most 0.33 where the detail of a head or a
/// bust fills the picture, and at least 0.66 in rooms.
const BEHIND: f64 = 0.5;
/// The worst side of an object shows more than this share of what the best side shows. The share is 0.5 to 0.8 for a head,
/// a bust, a flower and a rider, and at most 0.3 for rooms and for what was photographed from one side.
const FROM_ALL_SIDES: f64 = 0.4;

impl Bulk {
    /// A sphere that holds nearly all of a model; `None` if it holds no Gaussian.
    fn whole(scene: &Scene) -> Option<Self> {
        let weights = weights(scene, Weigh::Alike);
        let at = |i: usize| DVec3::from_array(scene.means[i].map(f64::from));
        let size = |i: usize| scene.log_scales[i].iter().copied().fold(f32::NEG_INFINITY, f32::max);
        let share_of = |share: f64, value: &dyn Fn(usize) -> f64| {
            quantile((0..scene.len()).map(|i| (value(i), weights[i])).collect(), share)
        };
        let edge = |k: usize, share: f64| share_of(share, &|i| at(i)[k]);
        let middle = |k: usize| 0.5 * (edge(k, 1.0 - NEARLY_ALL) + edge(k, NEARLY_ALL));
        let centre = DVec3::from_array([0, 1, 2].map(middle));
        let reach = |i: usize| at(i).distance(centre) + SIZES * libm::exp(f64::from(size(i)));
        (!scene.is_empty()).then(|| Self { centre, radius: share_of(NEARLY_ALL, &reach) })
    }
}

/// A circle that shows the whole of an object, if the scene is one; `found` shows its detail, whose bulk is `detail`.
pub(super) fn whole_object(
    scene: &Scene,
    detail: Bulk,
    alike: &ThinnedScene,
    found: &Placement,
    constraints: &Constraints,
) -> Option<Placement> {
    let whole = Bulk::whole(scene)?;
    if whole.radius > WIDE * detail.radius {
        return None;
    }
    let framing = framing_distance(whole, constraints.tangents);
    let ring = Ring { centre: whole.centre, radius: framing, ..found.ring };
    let sides = alike.few(&ring);
    let is_object =
        *sides.last()? > FROM_ALL_SIDES * sides.first()? && alike.edges(&found.ring) < BEHIND;
    if !is_object {
        return None;
    }
    let ring = Ring { radius: constraints.radius.unwrap_or(framing), ..ring };
    let best = ThinnedScene::of(scene, constraints.tangents, Weigh::Detail).arc(ring).best;
    Some(Placement { ring, best, arc: None })
}

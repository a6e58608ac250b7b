//! [`cover`]: cameras that show a model from wherever it can be seen.

use gs_model::{Camera, Scene};

use super::bulk::Weigh;
use super::thinned::{SEES, ThinnedScene};
use super::{Constraints, Placement, Ring, find};

/// Heights of the cameras around an object, degrees; the sines are spread evenly.
const HEIGHTS: [f64; 2] = [-5.0, 70.0];
/// Heights above and below those of an arc, degrees.
const ARC_HEIGHTS: f64 = 12.0;
/// Every third camera stands farther away by this factor.
const FARTHER: f64 = 1.5;
/// Turns from one camera to the next: the golden ratio less 1, so that any number of cameras is spread evenly.
const GOLDEN: f64 = 0.618_033_988_749_894_8;
/// Places that are tried for a camera.
const TRIES: u32 = 4;

/// Cameras that cover a model.
#[derive(Clone, Debug)]
pub struct Coverage {
    /// The first is the one that sees most.
    pub cameras: Vec<Camera>,
    /// The circle that sees most, and the arc of it from which the model is seen.
    pub placement: Placement,
    /// Places that were passed over, because next to nothing is seen from there.
    pub empty: usize,
}

/// At most `n` cameras around what matters in a scene, at heights from the horizon to far above it and at two
/// distances; in front of it, where only that side is seen. A fixed elevation or radius is that of all of them.
/// `size` is in pixels, and `whole` means the whole circle in any case. `None` for a scene without a Gaussian.
#[must_use]
pub fn cover(
    scene: &Scene,
    constraints: &Constraints,
    n: u32,
    size: [u32; 2],
    whole: bool,
) -> Option<Coverage> {
    let mut placement = find(scene, constraints)?;
    if whole {
        placement.arc = None;
    }
    let thin = ThinnedScene::of(scene, constraints.tangents, Weigh::Detail);
    let least = SEES * thin.view(&placement.ring, placement.best);
    let focal = 0.5 * f64::from(size[0]) / constraints.tangents[0];
    let (mut cameras, mut empty) = (Vec::new(), 0);
    for k in 0..TRIES * n {
        let (ring, turn) = place(&placement, constraints, k, n);
        if k > 0 && !whole && thin.view(&ring, turn) < least {
            empty += 1;
            continue;
        }
        cameras.push(ring.camera(format!("orbit-{:04}", cameras.len()), turn, size, focal));
        if cameras.len() == n as usize {
            break;
        }
    }
    Some(Coverage { cameras, placement, empty })
}

/// Place `k`, if about `n` are wanted: a circle of its own, and the turn around it. Place 0 is the best.
fn place(placement: &Placement, constraints: &Constraints, k: u32, n: u32) -> (Ring, f64) {
    let &Placement { mut ring, best, arc } = placement;
    if k == 0 {
        return (ring, best);
    }
    let around = (f64::from(k) * GOLDEN).fract();
    let turn = arc.map_or(best + around, |[first, last]| first + (last - first) * around);
    if constraints.elevation.is_none() {
        let [low, high] = match arc {
            None => HEIGHTS,
            Some(_) => [ring.elevation - ARC_HEIGHTS, ring.elevation + ARC_HEIGHTS],
        };
        let [low, high] = [low, high].map(|degrees| libm::sin(degrees.to_radians()));
        // Twice as many places as cameras, so that the second half lies between the first.
        let share = (f64::from(k % n) + 0.5 * f64::from(k / n)) / f64::from(n);
        ring.elevation = libm::asin(low + (high - low) * share).to_degrees();
    }
    if constraints.radius.is_none() && k % 3 == 2 {
        ring.radius *= FARTHER;
    }
    (ring, turn)
}

//! [`nearby`]: cameras between, beside and behind given ones.

use glam::{DMat3, DQuat, DVec3};
use gs_model::{Camera, Scene};

use super::bulk::{Bulk, Weigh};

/// Greatest shift to the side or upwards, and greatest way back, over the distance to what matters.
const ASIDE: f64 = 0.2;
const BACK: f64 = 0.5;
/// Greatest turn to the side or upwards, radians.
const TURN: f64 = 0.15;

/// `n` cameras near `cameras`: each stands between two neighbours, moved to the side, upwards and back, and turned.
/// The same cameras for the same arguments; another `set` gives others. No cameras for a scene without a Gaussian.
#[must_use]
pub fn nearby(scene: &Scene, cameras: &[Camera], n: usize, set: u32) -> Vec<Camera> {
    let Some(bulk) = Bulk::of(scene, Weigh::Detail) else { return Vec::new() };
    if cameras.is_empty() {
        return Vec::new();
    }
    let one = |k: usize| {
        let at = spread(k, set);
        let a = &cameras[k * cameras.len() / n];
        let b = neighbour(cameras, a);
        let t = at[0];
        let (from, to) = (a.position(), b.position());
        let [start, end] = [a, b].map(|c| DQuat::from_mat3(&c.rotation));
        // Half the angle is nearly its sine; square roots are the same on all machines, and sines are not.
        let [right, up] = [1, 2].map(|i| 0.5 * TURN * (2.0 * at[i] - 1.0));
        let turned = DQuat::from_xyzw(up, right, 0.0, 1.0).normalize();
        let rotation = DMat3::from_quat(turned * start.lerp(end, t));
        let middle = from.lerp(to, t);
        let away = middle.distance(bulk.centre);
        let shift =
            DVec3::new(ASIDE * (2.0 * at[3] - 1.0), ASIDE * (2.0 * at[4] - 1.0), -BACK * at[5]);
        let eye = middle + rotation.transpose() * (away * shift);
        let name = format!("nearby-{k:04}");
        Camera { name, rotation, translation: -(rotation * eye), ..a.clone() }
    };
    (0..n).map(one).collect()
}

/// The camera nearest to `a` that stands elsewhere; `a` if there is none.
fn neighbour<'a>(cameras: &'a [Camera], a: &'a Camera) -> &'a Camera {
    let eye = a.position();
    let others = cameras.iter().filter(|c| c.position() != eye);
    let key = |c: &&Camera| c.position().distance_squared(eye);
    others.min_by(|x, y| key(x).total_cmp(&key(y))).unwrap_or(a)
}

/// Point `k` of a sequence that fills the unit cube of six dimensions evenly (Roberts 2018, R-sequence).
fn spread(k: usize, set: u32) -> [f64; 6] {
    // The root above 1 of x^7 = x + 1.
    const ROOT: f64 = 1.112_775_684_278_705_5;
    let mut share = 1.0;
    [0; 6].map(|_| {
        share /= ROOT;
        (0.5 + share * (k as f64 + 1.0) + 0.37 * f64::from(set)).fract()
    })
}

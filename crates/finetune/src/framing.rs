//! Cameras for a model that has none: what matters in it, and which circle of cameras sees it.
//!
//! What matters is where the detail is: trained models describe what the photos were taken of by many
//! small Gaussians, and what lies around it by few large ones. So a Gaussian weighs its opacity
//! divided by its area. Which cameras see the detail, and not the back of a wall or fog right before
//! the lens, is found by drawing a thinned-out copy of the model, small, from circles of different
//! size, height and axis.

use crate::saliency::saliency;
use gs_model::{Camera, Scene};
use rayon::prelude::*;

/// A vector.
pub type V3 = [f64; 3];

/// Where the detail is.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Bulk {
    centre: V3,
    /// Of a sphere around the centre that holds nearly all of it.
    radius: f64,
}

/// Share of the smallest Gaussians that weigh no more than the largest of them: a few specks would
/// outweigh the rest.
const SPECKS: f64 = 0.05;
/// The share of the weight whose distance from the median stands for the size of the subject; what is
/// further than `FAR` times that is background.
const CORE: f64 = 0.8;
const FAR: f64 = 2.0;
/// Weighted quantiles that a box around the subject lies between, and of the distance from its centre.
const EDGE: f64 = 0.01;
const WITHIN: f64 = 0.99;

/// Gaussians all in one place are as large as this many of their standard deviations.
const SIZES: f64 = 2.0;
const LEAST_RADIUS: f64 = 1e-9;

impl Bulk {
    /// The bulk of a scene; `None` if it holds no Gaussian.
    fn of(scene: &Scene, weigh: Weigh) -> Option<Self> {
        let weights = weights(scene, weigh);
        let all: Vec<usize> = (0..scene.len()).filter(|&i| weights[i] > 0.0).collect();
        let at = |i: usize| scene.means[i].map(f64::from);
        let along = |chosen: &[usize], k: usize, share: f64| {
            quantile(chosen.iter().map(|&i| (at(i)[k], weights[i])).collect(), share)
        };
        let from = |chosen: &[usize], centre: V3, share: f64| {
            quantile(chosen.iter().map(|&i| (distance(at(i), centre), weights[i])).collect(), share)
        };
        if all.is_empty() {
            return None;
        }
        let median = [0, 1, 2].map(|k| along(&all, k, 0.5));
        let reach = FAR * from(&all, median, CORE);
        let near: Vec<usize> =
            all.iter().copied().filter(|&i| distance(at(i), median) <= reach).collect();
        let near = if near.is_empty() { all } else { near };
        let centre = [0, 1, 2].map(|k| 0.5 * (along(&near, k, EDGE) + along(&near, k, 1.0 - EDGE)));
        let size = |i: usize| f64::from(largest(&scene.log_scales[i]));
        let typical = quantile(near.iter().map(|&i| (size(i), weights[i])).collect(), 0.5);
        let least = SIZES * libm::exp(typical);
        let radius = from(&near, centre, WITHIN).max(least);
        // What is smaller than numbers of 32 bits can tell apart is nothing.
        Some(Self { centre, radius: radius.clamp(LEAST_RADIUS, f64::from(f32::MAX)) })
    }
}

/// What a Gaussian weighs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Weigh {
    /// Its opacity divided by its area.
    Detail,
    /// Its opacity.
    Alike,
}

fn weights(scene: &Scene, weigh: Weigh) -> Vec<f64> {
    let areas: Vec<f64> = scene.log_scales.par_iter().map(area).collect();
    let least = quantile(areas.iter().map(|&a| (a, 1.0)).collect(), SPECKS).max(f64::MIN_POSITIVE);
    let small = |a: f64| if weigh == Weigh::Detail { least / a.max(least) } else { 1.0 };
    areas.iter().zip(&scene.opacity_logits).map(|(&a, &o)| opacity(o) * small(a)).collect()
}

/// The largest of a Gaussian's three.
fn largest(log_scale: &[f32; 3]) -> f32 {
    log_scale.iter().copied().fold(f32::NEG_INFINITY, f32::max)
}

/// Product of the two largest standard deviations.
fn area(log_scale: &[f32; 3]) -> f64 {
    let sum: f32 = log_scale.iter().sum();
    let least = log_scale.iter().copied().fold(f32::INFINITY, f32::min);
    libm::exp(f64::from(sum - least))
}

fn opacity(logit: f32) -> f64 {
    1.0 / (1.0 + libm::exp(-f64::from(logit)))
}

/// The value below which the given share of the weight lies; 0 of nothing.
fn quantile(mut values: Vec<(f64, f64)>, share: f64) -> f64 {
    // Ties are broken, so that the sums do not depend on the number of threads.
    values.par_sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
    let total: f64 = values.iter().map(|v| v.1).sum();
    let mut sum = 0.0;
    for &(value, weight) in &values {
        sum += weight;
        if sum >= share * total {
            return value;
        }
    }
    values.last().map_or(0.0, |v| v.0)
}

/// A circle of cameras that look at one point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ring {
    /// The point.
    pub centre: V3,
    /// A direction of length 1.
    pub up: V3,
    /// From the centre to the cameras.
    pub radius: f64,
    /// Above the horizon, degrees.
    pub elevation: f64,
}

/// Renderers show nothing that is nearer than 0.2 units, so no camera stands nearer to the centre than this.
const NEAREST: f64 = 0.5;

impl Ring {
    /// A camera at `turn` (in turns) around the circle. Where the circle is too small to see anything from it, the
    /// camera stands farther away and has a longer lens.
    #[must_use]
    pub fn camera(&self, name: String, turn: f64, size: [u32; 2], focal: f64) -> Camera {
        let angle = std::f64::consts::TAU * turn;
        let (right, ahead) = horizon(self.up);
        let (sin, cos) = (libm::sin(angle), libm::cos(angle));
        let raised = self.elevation.to_radians();
        let radius = self.radius.max(NEAREST);
        let focal = focal * (radius / self.radius);
        let (out, up) = (radius * libm::cos(raised), radius * libm::sin(raised));
        let eye = [0, 1, 2]
            .map(|k| self.centre[k] + out * (cos * right[k] + sin * ahead[k]) + up * self.up[k]);
        Camera::looking_at(name, eye, self.centre, self.up, size, focal)
    }
}

/// Two directions at right angles to `up` and to each other.
fn horizon(up: V3) -> (V3, V3) {
    // The axis after the one that is most nearly up.
    let most = (0..3).max_by(|&a, &b| up[a].abs().total_cmp(&up[b].abs())).unwrap_or(1);
    let mut axis = [0.0; 3];
    axis[(most + 1) % 3] = 1.0;
    let right = unit(sub(axis, scaled(up, dot(axis, up))));
    (right, cross(up, right))
}

/// What is given, and what is to be found.
#[derive(Clone, Copy, Debug)]
pub struct Constraints {
    /// A direction of length 1.
    pub up: Option<V3>,
    /// World units.
    pub radius: Option<f64>,
    /// Degrees above the horizon.
    pub elevation: Option<f64>,
    /// Tangents of half the field of view, horizontal and vertical.
    pub tangents: [f64; 2],
}

/// A circle, and the part of it from which the model is seen well.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placement {
    /// The circle.
    pub ring: Ring,
    /// Where the best camera is, in turns.
    pub best: f64,
    /// First and last place, in turns; `None` if the whole circle will do.
    pub arc: Option<[f64; 2]>,
}

impl Placement {
    /// Where `n` cameras stand, in turns: the best one first, then around the circle, or to the ends of the
    /// arc and back.
    #[must_use]
    pub fn places(&self, n: u32) -> Vec<f64> {
        let step = |i: u32| f64::from(i) / f64::from(n);
        let Some([first, last]) = self.arc else {
            return (0..n).map(|i| self.best + step(i)).collect();
        };
        let (ahead, back) = (last - self.best, self.best - first);
        let way = 2.0 * (ahead + back);
        let along = |s: f64| match s {
            s if s <= ahead => self.best + s,
            s if s <= 2.0 * ahead + back => last - (s - ahead),
            s => first + (s - 2.0 * ahead - back),
        };
        (0..n).map(|i| along(way * step(i))).collect()
    }

    /// `n` cameras, at [`Placement::places`]. Their names are `name` and a number. `focal` is in pixels.
    #[must_use]
    pub fn cameras(&self, n: u32, name: &str, size: [u32; 2], focal: f64) -> Vec<Camera> {
        let places = self.places(n).into_iter().enumerate();
        places
            .map(|(i, turn)| self.ring.camera(format!("{name}-{i:04}"), turn, size, focal))
            .collect()
    }
}

/// Room around the bulk in the image.
const MARGIN: f64 = 1.15;
/// Radii that are tried, as shares of the one that frames the whole bulk.
const RADII: [f64; 6] = [1.0, 0.8, 0.64, 0.5, 0.4, 0.3];
/// Heights that are tried, degrees: eye level first.
const ELEVATIONS: [f64; 3] = [8.0, 20.0, 32.0];
/// What a smaller circle, another height and a leaning axis must gain to be preferred.
const CLOSER: f64 = 1.08;
const HIGHER: f64 = 1.06;
const LEANING: f64 = 1.12;
const LEANING_HALF: f64 = 1.07;
/// What the circle that leans the other way must lose.
const OTHER_WAY: f64 = 0.97;
/// Cameras that on average see less than this share of all Gaussians look at specks.
const SPECKS_SEE: f64 = 0.2;
/// Cameras on a circle during the search, and for the choice of an arc.
const FEW: u32 = 8;
const MANY: u32 = 24;
/// Cameras that see less than this share of what the best one sees are not on the arc.
const SEES: f64 = 0.6;
/// An arc longer than this is the whole circle, in turns.
const WHOLE: f64 = 0.8;

/// Finds a circle; `None` for a scene without a Gaussian.
#[must_use]
pub fn find(scene: &Scene, constraints: &Constraints) -> Option<Placement> {
    let found = find_around(scene, Bulk::of(scene, Weigh::Detail)?, constraints, Weigh::Detail);
    // In some models the smallest Gaussians are specks in the air: then all count alike.
    let seen = ThinnedScene::of(scene, constraints.tangents, Weigh::Alike).all(&found.ring);
    if seen > SPECKS_SEE * f64::from(FEW) {
        return Some(found);
    }
    Some(find_around(scene, Bulk::of(scene, Weigh::Alike)?, constraints, Weigh::Alike))
}

/// Gaussians of the copy that [`find_quickly`] looks at, and its height, degrees.
const FEWER: usize = 8_000;
const QUICK_ELEVATION: f64 = 20.0;

/// As [`find`], in a tenth of a second for a model of any size: from some of the Gaussians, and at one height.
#[must_use]
pub fn find_quickly(scene: &Scene, tangents: [f64; 2]) -> Option<Placement> {
    let (up, elevation) = (Some(COLMAP_UP), Some(QUICK_ELEVATION));
    let (thin, _) = thinned(scene, FEWER);
    find(&thin, &Constraints { up, radius: None, elevation, tangents })
}

/// The distance at which the bulk's sphere nearly touches the edges of the image.
fn framing_distance(bulk: Bulk, tangents: [f64; 2]) -> f64 {
    let narrow = tangents[0].min(tangents[1]);
    MARGIN * bulk.radius * (1.0 + narrow * narrow).sqrt() / narrow
}

/// Finds a circle around what matters.
fn find_around(scene: &Scene, bulk: Bulk, constraints: &Constraints, weigh: Weigh) -> Placement {
    let thin = ThinnedScene::of(scene, constraints.tangents, weigh);
    let framing = framing_distance(bulk, constraints.tangents);
    let radii = match constraints.radius {
        Some(radius) => vec![radius],
        None => RADII.map(|share| share * framing).to_vec(),
    };
    let elevations = constraints.elevation.map_or(ELEVATIONS.to_vec(), |e| vec![e]);
    let ring = |up, radius, elevation| Ring { centre: bulk.centre, up, radius, elevation };
    let best_of = |up: V3| {
        let mut best = (ring(up, radii[0], elevations[0]), 0.0);
        for &elevation in &elevations {
            for &radius in &radii {
                let tried = ring(up, radius, elevation);
                let sees = thin.best_half(&tried);
                let same = elevation == best.0.elevation;
                if sees > (if same { CLOSER } else { HIGHER }) * best.1 {
                    best = (tried, sees);
                }
            }
        }
        best.0
    };
    if let Some(up) = constraints.up {
        return thin.arc(best_of(up));
    }
    let straight = best_of(COLMAP_UP);
    thin.arc(lean(&thin, &straight).map_or(straight, best_of))
}

/// What is up in COLMAP scenes, nearly.
const COLMAP_UP: V3 = [0.0, -1.0, 0.0];

/// A direction, leaning from that of `ring`, whose circle sees clearly more; COLMAP's first camera may
/// have been held at a slant. Leaning half as far must
/// help too, and leaning the other way must not, or it is by chance.
fn lean(thin: &ThinnedScene, ring: &Ring) -> Option<V3> {
    let upright = thin.all(ring);
    let mut best = (None, LEANING * upright);
    for eighth in 0..8 {
        let turn = std::f64::consts::TAU * f64::from(eighth) / 8.0;
        let at = |degrees: f64| {
            let (sin, cos) = (libm::sin(degrees.to_radians()), libm::cos(degrees.to_radians()));
            [sin * libm::cos(turn), -cos, sin * libm::sin(turn)]
        };
        let ups = [at(20.0), at(40.0)];
        let sees = ups.map(|up| thin.all(&Ring { up, ..*ring }));
        let other = thin.all(&Ring { up: [-ups[0][0], ups[0][1], -ups[0][2]], ..*ring });
        let least = sees[0].min(sees[1]);
        if other < OTHER_WAY * upright
            && least > LEANING_HALF * upright
            && sees[0].max(sees[1]) > best.1
        {
            best = (Some(ups[usize::from(sees[1] > sees[0])]), sees[0].max(sees[1]));
        }
    }
    best.0
}

/// A copy of a scene with fewer, larger Gaussians without view dependence, which is drawn quickly.
struct ThinnedScene {
    scene: Scene,
    weights: Vec<f64>,
    tangents: [f64; 2],
}

/// Gaussians that a copy has at most.
const MOST: usize = 16_000;
/// Pixels along the longer edge of its images.
const EDGE_PIXELS: f64 = 64.0;
/// A Gaussian that fills this much of a pixel is seen.
const SEEN: f64 = 0.02;

/// At most `most` Gaussians of a scene, larger by as much as they are fewer, without view dependence; and
/// their numbers.
fn thinned(scene: &Scene, most: usize) -> (Scene, Vec<usize>) {
    let step = scene.len().div_ceil(most).max(1);
    let chosen: Vec<usize> = (0..scene.len()).step_by(step).collect();
    let mut base = Scene { sh_degree: 0, ..Scene::default() };
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

impl ThinnedScene {
    fn of(scene: &Scene, tangents: [f64; 2], weigh: Weigh) -> Self {
        let weights = weights(scene, weigh);
        let (base, chosen) = thinned(scene, MOST);
        let weights = chosen.iter().map(|&i| weights[i]).collect();
        Self { scene: base, weights, tangents }
    }

    /// The share of the detail that one camera sees.
    fn view(&self, ring: &Ring, turn: f64) -> f64 {
        let wide = self.tangents[0].max(self.tangents[1]);
        let size = self.tangents.map(|t| (EDGE_PIXELS * t / wide).round().max(1.0) as u32);
        let focal = 0.5 * EDGE_PIXELS / wide;
        let camera = ring.camera(String::new(), turn, size, focal);
        let seen = saliency(&self.scene, &[camera]).total;
        let sum: f64 =
            seen.iter().zip(&self.weights).map(|(&s, w)| w * (f64::from(s) / SEEN).min(1.0)).sum();
        sum / self.weights.iter().sum::<f64>().max(f64::MIN_POSITIVE)
    }

    /// What each of a few cameras on a circle sees, the most first.
    fn few(&self, ring: &Ring) -> Vec<f64> {
        let turn = |i: u32| f64::from(i) / f64::from(FEW);
        let mut seen: Vec<f64> = (0..FEW).map(|i| self.view(ring, turn(i))).collect();
        seen.sort_by(|a, b| b.total_cmp(a));
        seen
    }

    /// How much the better half of a circle sees: many models were photographed from one side.
    fn best_half(&self, ring: &Ring) -> f64 {
        self.few(ring).iter().take(FEW as usize / 2).sum()
    }

    /// How much a whole circle sees.
    fn all(&self, ring: &Ring) -> f64 {
        self.few(ring).iter().sum()
    }

    /// The part of a circle around its best camera from which as much is seen as from there.
    fn arc(&self, ring: Ring) -> Placement {
        let turn = |i: u32| f64::from(i % MANY) / f64::from(MANY);
        let seen: Vec<f64> = (0..MANY).map(|i| self.view(&ring, turn(i))).collect();
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

/// The distance of two points.
#[must_use]
pub fn distance(a: V3, b: V3) -> f64 {
    let d = sub(a, b);
    dot(d, d).sqrt()
}

fn sub(a: V3, b: V3) -> V3 {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

fn dot(a: V3, b: V3) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn scaled(a: V3, f: f64) -> V3 {
    a.map(|v| f * v)
}

fn cross(a: V3, b: V3) -> V3 {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// `a` with length 1; `a` itself if it has none.
#[must_use]
pub fn unit(a: V3) -> V3 {
    let length = dot(a, a).sqrt();
    if length > 0.0 { scaled(a, 1.0 / length) } else { a }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A sphere of small Gaussians, one unit around `centre`, and a few large ones far away.
    fn sphere(centre: [f32; 3]) -> Scene {
        let mut scene = Scene::default();
        let mut seed = 1u32;
        let mut next = || {
            seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (seed >> 8) as f32 / (1 << 23) as f32 - 1.0
        };
        for i in 0..520 {
            let p = [next(), next(), next()];
            let length = p.iter().map(|v| v * v).sum::<f32>().sqrt().max(1e-3);
            let far = i >= 500;
            let distance = if far { 40.0 } else { 1.0 };
            scene.means.push([0, 1, 2].map(|k| centre[k] + distance * p[k] / length));
            scene.rotations.push([1.0, 0.0, 0.0, 0.0]);
            scene.log_scales.push([if far { 1.0 } else { -3.0 }; 3]);
            scene.opacity_logits.push(3.0);
            scene.sh.push([0.5; 3]);
        }
        scene
    }

    #[test]
    fn the_background_moved_the_camera_away_or_into_the_subject() {
        let scene = sphere([5.0, -2.0, 9.0]);
        let bulk = Bulk::of(&scene, Weigh::Detail).unwrap();
        assert!(distance(bulk.centre, [5.0, -2.0, 9.0]) < 0.1, "{bulk:?}");
        assert!((0.9..1.1).contains(&bulk.radius), "{bulk:?}");
        let constraints =
            Constraints { up: None, radius: None, elevation: None, tangents: [0.6, 0.45] };
        let found = find(&scene, &constraints).unwrap();
        // All around, and all of it in the image: the sphere is seen under less than its height.
        assert!(found.arc.is_none(), "{found:?}");
        assert!(1.0 / (found.ring.radius * found.ring.radius - 1.0).sqrt() < 0.45, "{found:?}");
        assert!(found.ring.radius < 6.0, "{found:?}");
        assert!(find(&Scene::default(), &constraints).is_none());
    }

    #[test]
    fn a_model_of_no_extent_or_of_two_centimetres_was_not_shown() {
        let mut small = sphere([0.0; 3]).select(&(0..500).collect::<Vec<_>>());
        for i in 0..small.len() {
            small.means[i] = small.means[i].map(|x| 0.01 * x);
            small.log_scales[i] = small.log_scales[i].map(|l| l - 4.6);
        }
        let mut one_place = sphere([0.0; 3]);
        one_place.means.fill([1.0, 2.0, 3.0]);
        let mut one_speck = one_place.clone();
        one_speck.log_scales.fill([-11.0; 3]);
        for scene in [small, one_place.select(&[0]), one_place, one_speck] {
            let constraints =
                Constraints { up: None, radius: None, elevation: None, tangents: [0.6, 0.45] };
            let found = find(&scene, &constraints).unwrap();
            let camera = found.ring.camera(String::new(), found.best, [64, 48], 53.0);
            let image = crate::render(&scene, &camera, &crate::RenderOptions::default());
            let shows = image.rgb.iter().filter(|&&v| v > 0.1).count();
            assert!(shows > image.rgb.len() / 10, "{shows} of {found:?}");
        }
    }

    #[test]
    fn cameras_stood_behind_the_wall() {
        // A dense wall right behind the sphere: z grows away from the cameras that see it.
        let mut scene = sphere([0.0; 3]);
        for i in 0..900 {
            let (x, y) = ((i % 30) as f32 - 14.5, (i / 30) as f32 - 14.5);
            scene.means.push([0.3 * x, 0.3 * y, 1.2]);
            scene.rotations.push([1.0, 0.0, 0.0, 0.0]);
            scene.log_scales.push([-1.6, -1.6, -6.0]);
            scene.opacity_logits.push(8.0);
            scene.sh.push([0.0; 3]);
        }
        let up = Some([0.0, -1.0, 0.0]);
        let constraints = Constraints { up, radius: None, elevation: None, tangents: [0.6, 0.45] };
        let found = find(&scene, &constraints).unwrap();
        let [first, last] = found.arc.expect("half of the circle is behind the wall");
        for turn in [first, found.best, last] {
            let eye = found.ring.camera(String::new(), turn, [8, 6], 8.0).position();
            assert!(eye.z < 1.2, "{eye} at {turn} of {found:?}");
        }
    }
}

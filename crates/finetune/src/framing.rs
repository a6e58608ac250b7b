//! Cameras for a model that has none: what matters in it, and which circle of cameras sees it.
//!
//! What matters is where the detail is: trained models describe what the photos were taken of by many
//! small Gaussians, and what lies around it by few large ones. So a Gaussian weighs its opacity
//! divided by its area. Which cameras see the detail, and not the back of a wall or fog right before
//! the lens, is found by drawing a thinned-out copy of the model, small, from circles of different
//! size, height and axis. An object without a background is shown whole. [`cover`] gives cameras that show a model from wherever it can be seen, and
//! [`nearby`] some that stand near given ones.

mod bulk;
mod coverage;
mod nearby;
mod object;
mod ring;
mod thinned;

pub use coverage::{Coverage, cover};
pub use nearby::nearby;
pub(crate) use ring::{Placement, Ring};

use bulk::{Bulk, Weigh};
use glam::DVec3;
use gs_model::{Camera, Scene};
use object::whole_object;
#[cfg(test)]
use thinned::edge;
use thinned::{FEW, ThinnedScene, thinned};

/// What the caller fixes. `find` chooses what is `None`.
#[derive(Clone, Copy, Debug)]
pub struct Constraints {
    /// A direction of length 1: see [`unit()`].
    pub up: Option<[f64; 3]>,
    /// World units.
    pub radius: Option<f64>,
    /// Degrees above the horizon.
    pub elevation: Option<f64>,
    /// Tangents of half the field of view, horizontal and vertical.
    pub tangents: [f64; 2],
}

/// Size of an image, and its horizontal field of view in degrees, unless the caller has others.
pub const SIZE: [u32; 2] = [640, 480];
/// See [`SIZE`].
pub const FIELD_OF_VIEW: f64 = 60.0;

impl Constraints {
    /// Nothing is fixed but the camera.
    #[must_use]
    pub fn of_camera([width, height]: [u32; 2], field_of_view: f64) -> Self {
        let tangent = libm::tan(0.5 * field_of_view.to_radians());
        let tangents = [tangent, tangent * f64::from(height) / f64::from(width)];
        Self { up: None, radius: None, elevation: None, tangents }
    }
}

impl Default for Constraints {
    fn default() -> Self {
        Self::of_camera(SIZE, FIELD_OF_VIEW)
    }
}

/// Room around the bulk in the image.
const MARGIN: f64 = 1.15;
/// Radii that are tried, as shares of the one that frames the whole bulk.
const RADII: [f64; 6] = [1.0, 0.8, 0.64, 0.5, 0.4, 0.3];
/// Heights that are tried, degrees: eye level first.
const ELEVATIONS: [f64; 3] = [8.0, 20.0, 32.0];
/// The least gains of a smaller circle, another height and a leaning axis.
const CLOSER: f64 = 1.08;
const HIGHER: f64 = 1.06;
const LEANING: f64 = 1.12;
const LEANING_HALF: f64 = 1.07;
/// The circle that leans the other way must see less than this share.
const OTHER_WAY: f64 = 0.97;
/// Cameras that on average see less than this share of all Gaussians look at specks.
const SPECKS_SEE: f64 = 0.2;
/// Gaussians that are looked at, at most: evenly chosen ones stand for all.
const SAMPLE: usize = 1 << 16;

/// Finds a circle; `None` for a scene without a Gaussian.
#[must_use]
pub fn find(scene: &Scene, constraints: &Constraints) -> Option<Placement> {
    let (sample, _) = thinned(scene, SAMPLE);
    let detail = Bulk::of(&sample, Weigh::Detail)?;
    let alike = ThinnedScene::of(&sample, constraints.tangents, Weigh::Alike);
    let found = find_detail(&sample, detail, &alike, constraints)?;
    Some(whole_object(&sample, detail, &alike, &found, constraints).unwrap_or(found))
}

/// Finds a circle around the detail.
fn find_detail(
    scene: &Scene,
    detail: Bulk,
    alike: &ThinnedScene,
    constraints: &Constraints,
) -> Option<Placement> {
    let found = find_around(scene, detail, constraints, Weigh::Detail);
    // In some models the smallest Gaussians are specks in the air: then all count alike.
    let seen = alike.all(&found.ring);
    if seen > SPECKS_SEE * f64::from(FEW) {
        return Some(found);
    }
    Some(find_around(scene, Bulk::of(scene, Weigh::Alike)?, constraints, Weigh::Alike))
}

/// `n` views of what matters in a model, of the default size; none of a scene without a Gaussian. They depend on the
/// model alone.
#[must_use]
pub fn around(scene: &Scene, n: u32) -> Vec<Camera> {
    let constraints = Constraints::default();
    let Some(found) = find(scene, &constraints) else { return Vec::new() };
    let focal = 0.5 * f64::from(SIZE[0]) / constraints.tangents[0];
    found.cameras(n, "around", SIZE, focal)
}

/// Degrees above and below the horizon.
const ALL_AROUND: f64 = 40.0;

/// Eight views of what matters in a model from all sides, four from above and four from below. They depend on the model
/// alone, and not on which way is up: what nobody photographed shows in some of them.
#[must_use]
pub fn all_around(scene: &Scene) -> Vec<Camera> {
    let (up, elevation) = (Some(COLMAP_UP.to_array()), Some(ELEVATIONS[0]));
    let constraints = Constraints { up, elevation, ..Constraints::default() };
    let Some(Placement { ring, best, .. }) = find(scene, &constraints) else { return Vec::new() };
    let focal = 0.5 * f64::from(SIZE[0]) / constraints.tangents[0];
    let one = |k: u32| {
        let (above, turn) = (k < 4, best + 0.25 * f64::from(k) + if k < 4 { 0.0 } else { 0.125 });
        let elevation = if above { ALL_AROUND } else { -ALL_AROUND };
        Ring { elevation, ..ring }.camera(format!("all-around-{k}"), turn, SIZE, focal)
    };
    (0..8).map(one).collect()
}

/// `direction` with length 1; as it is if it has none.
#[must_use]
pub fn unit(direction: [f64; 3]) -> [f64; 3] {
    let direction = DVec3::from_array(direction);
    direction.normalize_or(direction).to_array()
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
    let best_of = |up: DVec3| {
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
    if let Some(up) = constraints.up.map(DVec3::from_array) {
        return thin.arc(best_of(up));
    }
    let straight = best_of(COLMAP_UP);
    thin.arc(lean(&thin, &straight).map_or(straight, best_of))
}

/// The direction that is nearly up in COLMAP scenes.
const COLMAP_UP: DVec3 = DVec3::NEG_Y;

/// A direction, leaning from that of `ring`, whose circle sees clearly more; COLMAP's first camera may
/// have been held at a slant. Leaning half as far must
/// help too, and leaning the other way must not, or it is by chance.
fn lean(thin: &ThinnedScene, ring: &Ring) -> Option<DVec3> {
    let upright = thin.all(ring);
    let at = |eighth: usize, degrees: f64| {
        let turn = std::f64::consts::TAU * eighth as f64 / 8.0;
        let (sin, cos) = (libm::sin(degrees.to_radians()), libm::cos(degrees.to_radians()));
        DVec3::new(sin * libm::cos(turn), -cos, sin * libm::sin(turn))
    };
    let sees = |up: DVec3| thin.all(&Ring { up, ..*ring });
    let sees_half: [f64; 8] = std::array::from_fn(|eighth| sees(at(eighth, 20.0)));
    let mut best = (None, LEANING * upright);
    for eighth in 0..8 {
        // The direction four eighths further is the opposite one.
        let (here, other) = (sees_half[eighth], sees_half[(eighth + 4) % 8]);
        if other >= OTHER_WAY * upright || here <= LEANING_HALF * upright {
            continue;
        }
        let full = sees(at(eighth, 40.0));
        if full > LEANING_HALF * upright && full.max(here) > best.1 {
            let degrees = if full > here { 40.0 } else { 20.0 };
            best = (Some(at(eighth, degrees)), full.max(here));
        }
    }
    best.0
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
    fn the_background_does_not_move_the_camera() {
        let scene = sphere([5.0, -2.0, 9.0]);
        let bulk = Bulk::of(&scene, Weigh::Detail).unwrap();
        assert!(bulk.centre.distance(DVec3::new(5.0, -2.0, 9.0)) < 0.1, "{bulk:?}");
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
    fn a_model_of_no_extent_or_of_two_centimetres_is_shown() {
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

    /// A sphere with a dense wall right behind it: z grows away from the cameras that see it.
    fn sphere_before_a_wall() -> Scene {
        let mut scene = sphere([0.0; 3]);
        for i in 0..900 {
            let (x, y) = ((i % 30) as f32 - 14.5, (i / 30) as f32 - 14.5);
            scene.means.push([0.3 * x, 0.3 * y, 1.2]);
            scene.rotations.push([1.0, 0.0, 0.0, 0.0]);
            scene.log_scales.push([-1.2, -1.2, -6.0]);
            scene.opacity_logits.push(8.0);
            scene.sh.push([0.0; 3]);
        }
        scene
    }

    /// Where the wall is.
    const WALL: f64 = 1.2;

    const UPRIGHT: Constraints = Constraints {
        up: Some([0.0, -1.0, 0.0]),
        radius: None,
        elevation: None,
        tangents: [0.6, 0.45],
    };

    #[test]
    fn no_camera_of_an_arc_is_behind_the_wall() {
        let found = find(&sphere_before_a_wall(), &UPRIGHT).unwrap();
        let [first, last] = found.arc.expect("half of the circle is behind the wall");
        for turn in [first, found.best, last] {
            let eye = found.ring.camera(String::new(), turn, [8, 6], 8.0).position();
            assert!(eye.z < WALL, "{eye} at {turn} of {found:?}");
        }
    }

    /// The share of an image's edge where something shows.
    fn touched(scene: &Scene, camera: &Camera) -> f64 {
        let image = crate::render(scene, camera, &crate::RenderOptions::default());
        let lit = edge(&image).filter(|rgb| rgb.iter().any(|&v| v > 0.02));
        lit.count() as f64 / edge(&image).count() as f64
    }

    #[test]
    fn nothing_of_an_object_is_cut_wherever_its_detail_is() {
        // A head: a face of fine Gaussians on one side, coarse ones all around, long hair above.
        let mut head = sphere([3.0, 1.0, -2.0]).select(&(0..500).collect::<Vec<_>>());
        for i in 0..head.len() {
            let [x, y, z] = [0, 1, 2].map(|k| head.means[i][k] - [3.0, 1.0, -2.0][k]);
            let is_face = z < -0.75;
            head.log_scales[i] = if is_face { [-4.5; 3] } else { [-2.5, -2.0, -3.0] };
            head.means[i] = [3.0 + 0.7 * x, 1.0 + if y < 0.0 { 1.6 * y } else { y }, -2.0 + z];
        }
        let up = |up| Constraints { up, ..Constraints::default() };
        for scale in [1.0, 0.15] {
            head.means.as_flattened_mut().iter_mut().for_each(|x| *x *= scale);
            let larger = libm::log(f64::from(scale)) as f32;
            head.log_scales.as_flattened_mut().iter_mut().for_each(|s| *s += larger);
            let mut cameras = [around(&head, 8), all_around(&head)].concat();
            for up in [None, Some([0.0, 1.0, 0.0]), Some([1.0, 0.0, 0.0])].map(up) {
                cameras.extend(cover(&head, &up, 24, [64, 48], false).unwrap().cameras);
            }
            for camera in &cameras {
                let share = touched(&head, &camera.within(64 * 48));
                assert!(share < 0.01, "{}: {share} of the edge", camera.name);
            }
        }
    }

    #[test]
    fn cameras_cover_an_object_all_around_from_above_and_at_two_distances() {
        let covered = cover(&sphere([0.0; 3]), &UPRIGHT, 24, [64, 48], false).unwrap();
        assert_eq!((covered.cameras.len(), covered.empty), (24, 0));
        let eyes: Vec<DVec3> = covered.cameras.iter().map(Camera::position).collect();
        let quarters = |k: usize| [(1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)][k];
        for (x, z) in (0..4).map(quarters) {
            assert!(eyes.iter().filter(|e| e.x * x > 0.0 && e.z * z > 0.0).count() >= 4);
        }
        let steepest = eyes.iter().map(|e| -e.y / e.length()).fold(0.0, f64::max);
        assert!(steepest > 0.85, "sine of the height {steepest}");
        let far = covered.placement.ring.radius * 1.2;
        assert!((6..=10).contains(&eyes.iter().filter(|e| e.length() > far).count()));
    }

    #[test]
    fn cameras_cover_one_side_only_where_the_other_is_empty() {
        let scene = sphere_before_a_wall();
        let before = cover(&scene, &UPRIGHT, 24, [64, 48], false).unwrap();
        assert!(before.placement.arc.is_some());
        let last = before.cameras.iter().map(|c| c.position().z).fold(f64::MIN, f64::max);
        assert!(last < WALL, "{last}");
        let around = cover(&scene, &UPRIGHT, 24, [64, 48], true).unwrap();
        assert!(around.cameras.len() == 24 && around.cameras.iter().any(|c| c.position().z > WALL));
    }

    #[test]
    fn nearby_cameras_stand_off_the_path_and_look_the_same_way() {
        let scene = sphere([0.0; 3]);
        let path = find(&scene, &UPRIGHT).unwrap().cameras(12, "orbit", [64, 48], 53.0);
        let near = nearby(&scene, &path, 9, 0);
        assert_eq!(near.len(), 9);
        assert_eq!(near, nearby(&scene, &path, 9, 0));
        assert_ne!(near, nearby(&scene, &path, 9, 1));
        for camera in &near {
            let next = |c: &&Camera| c.position().distance_squared(camera.position());
            let beside = path.iter().min_by(|a, b| next(a).total_cmp(&next(b))).unwrap();
            let (eye, apart) = (camera.position(), next(&beside).sqrt());
            assert!(apart > 0.01 && apart < eye.length(), "{apart} from the path at {eye}");
            assert!(camera.rotation.row(2).dot(-eye.normalize()) > 0.8, "{eye}");
        }
        // One camera has no neighbour, and an empty scene nothing to look at.
        assert_eq!(nearby(&scene, &path[..1], 3, 0).len(), 3);
        assert!(nearby(&Scene::default(), &path, 3, 0).is_empty());
        assert!(nearby(&scene, &[], 3, 0).is_empty());
    }
}

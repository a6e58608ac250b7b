//! Which cameras can see a model. Captures of cities have many thousand; a part of a city is seen by few.

use gs_model::{Camera, Scene};

/// Most cameras that visibility is measured from. With more, as many evenly chosen ones stand for all.
pub const MOST: usize = 256;

/// A Gaussian ends where its opacity is below 1/255: at most so many standard deviations from its mean.
const REACH: f64 = 3.34;

/// A ball around the Gaussians of a model, as far as they reach.
#[derive(Clone, Copy, Debug)]
struct Ball {
    centre: glam::DVec3,
    radius: f64,
}

impl Ball {
    fn around(scene: &Scene) -> Self {
        let points = || scene.means.iter().map(|m| glam::DVec3::from_array(m.map(f64::from)));
        let finite = || points().filter(|p| p.is_finite());
        let low = finite().fold(glam::DVec3::INFINITY, glam::DVec3::min);
        let high = finite().fold(glam::DVec3::NEG_INFINITY, glam::DVec3::max);
        let centre = 0.5 * (low + high);
        let scale =
            scene.log_scales.as_flattened().iter().fold(f32::NEG_INFINITY, |m, &x| m.max(x));
        let radius = finite().map(|p| p.distance(centre)).fold(0.0, f64::max);
        Self { centre, radius: radius + REACH * libm::exp(f64::from(scale)) }
    }

    /// False if nothing in the ball falls into the image of `camera`.
    fn meets(&self, camera: &Camera) -> bool {
        let c = camera.rotation * self.centre + camera.translation;
        // Planes through the camera's centre: the sides of the image, and the image plane itself.
        let (w, h) = (f64::from(camera.width), f64::from(camera.height));
        let sides = [
            glam::DVec3::new(camera.fx, 0.0, camera.cx),
            glam::DVec3::new(-camera.fx, 0.0, w - camera.cx),
            glam::DVec3::new(0.0, camera.fy, camera.cy),
            glam::DVec3::new(0.0, -camera.fy, h - camera.cy),
            glam::DVec3::Z,
        ];
        // A comparison with NaN is false: such a camera is kept.
        !sides.iter().any(|side| side.normalize().dot(c) < -self.radius)
    }
}

/// The cameras that can see `scene`, at most 256 evenly chosen ones, and how many each of them stands for.
#[must_use]
pub fn that_see<'a>(scene: &Scene, cameras: &'a [Camera]) -> (Vec<&'a Camera>, f64) {
    let ball = Ball::around(scene);
    let meeting: Vec<&Camera> = cameras.iter().filter(|c| ball.meets(c)).collect();
    let n = meeting.len().min(MOST);
    let chosen = (0..n).map(|i| meeting[(2 * i + 1) * meeting.len() / (2 * n)]).collect();
    (chosen, meeting.len() as f64 / n.max(1) as f64)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::visibility::Visibility;

    fn cameras(n: usize) -> Vec<Camera> {
        let mut rng = testing::Rng::seeded(4);
        let mut place = |far: f64| [0, 1, 2].map(|_| far * f64::from(rng.signed()));
        let camera = |_| {
            let (eye, target) = (place(30.0), place(30.0));
            Camera::looking_at("c".into(), eye, target, [0.0, 1.0, 0.0], [40, 30], 40.0)
        };
        (0..n).map(camera).collect()
    }

    #[test]
    fn a_camera_that_is_left_out_sees_nothing() {
        let scene = testing::trained_like(300, 0, &mut testing::Rng::seeded(2));
        let cameras = cameras(120);
        let ball = Ball::around(&scene);
        let (meeting, left): (Vec<&Camera>, Vec<&Camera>) =
            cameras.iter().partition(|c| ball.meets(c));
        assert!(meeting.len() > 20 && left.len() > 20, "{} {}", meeting.len(), left.len());
        for camera in left {
            let seen = Visibility::of_all(&scene, std::slice::from_ref(camera));
            assert!(seen.total.iter().all(|&w| w == 0.0));
        }
    }

    #[test]
    fn many_cameras_are_chosen_evenly() {
        let scene = testing::trained_like(20, 0, &mut testing::Rng::seeded(2));
        let many =
            vec![cameras(120).into_iter().find(|c| Ball::around(&scene).meets(c)).unwrap(); 1000];
        let (chosen, each) = that_see(&scene, &many);
        assert_eq!((chosen.len(), each), (MOST, 1000.0 / MOST as f64));
        assert_eq!(that_see(&scene, &many[..MOST]).0.len(), MOST);
        assert_eq!(that_see(&scene, &[]).0.len(), 0);
        assert_eq!(that_see(&Scene::default(), &many[..3]).0.len(), 3);
    }
}

//! The tour of cameras through the room, and the photos they take.

use glam::{DMat3, DVec3};
use gs_model::Camera;
use rayon::prelude::*;
use testing::Rng;

use super::furniture::Room;
use super::light::{Samples, display, seen};
use super::shape::Ray;
use crate::progress::Bar;

/// Photo width in pixels.
pub(crate) const WIDTH: u32 = 240;
/// Photo height in pixels.
pub(crate) const HEIGHT: u32 = 160;
/// Focal length in pixels (63 degrees across).
const FOCAL: f64 = 195.0;

/// `count` cameras on a wavy ellipse around the table, looking inwards.
pub(crate) fn tour(count: u32) -> Vec<Camera> {
    (0..count)
        .map(|i| {
            let turn = std::f64::consts::TAU * f64::from(i) / f64::from(count);
            let (c, s) = (libm::cos(turn), libm::sin(turn));
            let height = 1.55 + 0.28 * libm::sin(3.0 * turn + 0.4);
            let position = DVec3::new(2.25 * c, 1.85 * s, height);
            let target = DVec3::new(-0.35 * c, -0.25 * s, 0.82 + 0.08 * libm::cos(5.0 * turn));
            look_at(format!("view_{i:03}.png"), position, target)
        })
        .collect()
}

fn look_at(name: String, position: DVec3, target: DVec3) -> Camera {
    let forward = (target - position).normalize();
    let right = forward.cross(DVec3::Z).normalize();
    let down = forward.cross(right);
    let rotation = DMat3::from_cols(right, down, forward).transpose();
    Camera {
        name,
        width: WIDTH,
        height: HEIGHT,
        fx: FOCAL,
        fy: FOCAL,
        cx: f64::from(WIDTH) / 2.0,
        cy: f64::from(HEIGHT) / 2.0,
        rotation,
        translation: -(rotation * position),
        ignored_distortion: None,
    }
}

/// Takes the photo of `camera`: interleaved 8-bit RGB.
pub(crate) fn photo(room: &Room, camera: &Camera, seed: u64, samples: u32, bar: &Bar) -> Vec<u8> {
    let back = camera.rotation.transpose();
    let origin = camera.position();
    let rows: Vec<Vec<u8>> = (0..camera.height)
        .into_par_iter()
        .map(|y| {
            let mut row = Vec::with_capacity(camera.width as usize * 3);
            for x in 0..camera.width {
                let key = name_key(&camera.name);
                let mut rng = Rng::keyed(seed, &[key, u64::from(y), u64::from(x)]);
                let mut points = Samples::shifted(&mut rng);
                let mut sum = DVec3::ZERO;
                for _ in 0..samples {
                    let u = points.next_point();
                    let pixel = DVec3::new(
                        (f64::from(x) + u[0] - camera.cx) / camera.fx,
                        (f64::from(y) + u[1] - camera.cy) / camera.fy,
                        1.0,
                    );
                    let ray = Ray { origin, direction: (back * pixel).normalize() };
                    sum += seen(room, &ray, [u[2], u[3], u[4], u[5]], &mut rng);
                }
                let value = display(sum / f64::from(samples));
                row.extend(value.to_array().map(|v| (v * 255.0).round().clamp(0.0, 255.0) as u8));
            }
            bar.step(1);
            row
        })
        .collect();
    rows.concat()
}

fn name_key(name: &str) -> u64 {
    name.bytes().fold(0, |h: u64, b| h.wrapping_mul(31).wrapping_add(u64::from(b)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cameras_look_inwards_and_upright() {
        for camera in tour(32) {
            let det = camera.rotation.determinant();
            assert!((det - 1.0).abs() < 1e-12);
            let middle = camera.rotation * DVec3::new(0.0, 0.0, 0.8) + camera.translation;
            assert!(middle.z > 1.0 && middle.x.abs() / middle.z < 0.05, "{middle}");
            // The world's up is the camera's -y.
            assert!((camera.rotation * DVec3::Z).y < -0.5);
        }
    }

    #[test]
    fn a_photo_is_the_same_for_any_thread_count() {
        let room = Room::furnished();
        let mut camera = tour(8).remove(1);
        (camera.width, camera.height) = (12, 8);
        let take = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| photo(&room, &camera, 1, 4, &Bar::hidden()))
        };
        assert_eq!(take(1), take(4));
    }
}

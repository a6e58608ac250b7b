//! Cameras that do not show a scene, and photos of another scene, are detected by [`Visibility::share`] and
//! [`PhotoCheck`].

mod common;

use finetune::{Photo, PhotoCheck, TrainView, Visibility};
use gs_model::{Camera, Scene};

/// Cameras around the middle of [`common::scene`].
fn cameras(count: usize) -> Vec<Camera> {
    let eyes = (0..count).map(|i| 0.4 * i as f64 - 0.2 * count as f64);
    eyes.map(|x| {
        let target = [0.0, 0.0, 4.0];
        Camera::looking_at("v".into(), [x, 0.0, -1.0], target, [0.0, -1.0, 0.0], [72, 56], 50.0)
    })
    .collect()
}

fn views(scene: &Scene, cameras: Vec<Camera>) -> Vec<TrainView> {
    cameras.into_iter().map(|camera| TrainView::rendered(scene, camera)).collect()
}

#[test]
fn cameras_that_do_not_show_the_scene_are_detected() {
    let scene = common::scene(400, 0, 21);
    let share = |cameras: &[Camera]| Visibility::of_all(&scene, cameras).share(&scene);
    let all_around = share(&cameras(8));
    assert!(all_around > 0.9, "{all_around}");
    // Of another scene, far away.
    let mut elsewhere = cameras(8);
    elsewhere.iter_mut().for_each(|c| c.translation.x += 1e4);
    assert_eq!(share(&elsewhere), 0.0);
    assert_eq!(share(&[]), 0.0);
    // Through a narrow lens.
    let mut narrow = cameras(2);
    narrow.iter_mut().for_each(|c| (c.fx, c.fy) = (2000.0, 2000.0));
    let narrow = share(&narrow);
    assert!(narrow > 0.0 && narrow < 0.5, "{narrow}");
}

#[test]
fn the_share_is_weighted_by_opacity() {
    let mut scene = common::scene(4, 0, 3);
    // Opacities 1/2, 1/4, 1/4 and 0.
    let logit = libm::logf(1.0 / 3.0);
    scene.opacity_logits = vec![0.0, logit, logit, -80.0];
    let share = |weights: &[f32]| {
        Visibility { squared: weights.to_vec(), ..Visibility::default() }.share(&scene)
    };
    assert!((share(&[0.1, 0.0, 0.0, 0.0]) - 0.5).abs() < 1e-6);
    assert!((share(&[0.0, 3.0, 0.0, 0.0]) - 0.25).abs() < 1e-6);
    assert!((share(&[0.0, 3.0]) - 0.25).abs() < 1e-6, "missing weights count as unseen");
    assert!((share(&[1.0; 4]) - 1.0).abs() < 1e-6);
    assert_eq!(Visibility::default().share(&Scene::default()), 1.0);
}

#[test]
fn photos_of_other_views_and_of_another_exposure_are_detected() {
    let scene = common::scene(300, 1, 5);
    let good = views(&scene, cameras(7));
    let check = |views: &[TrainView]| PhotoCheck::of(&scene, views).unwrap();
    let found = check(&good);
    assert!(found.proves_cameras() && !found.of_other_views(), "{found:?}");
    assert!(!found.of_other_exposure(), "{found:?}");
    // Photos have 8 bits.
    assert!(found.views == 7 && found.psnr > 58.0 && found.unlike_own < 1e-3, "{found:?}");
    let mut turned = good.clone();
    (0..7).for_each(|i| turned[i].photo = good[(i + 3) % 7].photo.clone());
    assert!(check(&turned).of_other_views(), "{:?}", check(&turned));
    assert!(!check(&turned).proves_cameras());
    let mut dark = good.clone();
    dark.iter_mut().for_each(|v| v.photo.rgb.iter_mut().for_each(|v| *v = *v / 2 + 20));
    assert!(
        check(&dark).of_other_exposure() && !check(&dark).of_other_views(),
        "{:?}",
        check(&dark)
    );
    // One photo has nothing to be compared with, and one of another size cannot be.
    assert_eq!(PhotoCheck::of(&scene, &good[..1]), None);
    dark[0].photo = Photo::black(3, 3);
    assert_eq!(PhotoCheck::of(&scene, &dark), None);
}

/// A model that fits its photos badly still resembles them at their own cameras and at no others. A model that was moved
/// resembles them at none.
#[test]
fn photos_of_a_poor_model_prove_its_cameras_and_those_of_a_moved_model_do_not() {
    let mut scene = Scene::default();
    let mut rooms = Vec::new();
    for (i, camera) in cameras(7).into_iter().enumerate() {
        let away = 1000.0 * i as f32;
        let mut room = common::scene(60, 0, i as u64);
        room.means.iter_mut().for_each(|mean| mean[1] += away);
        scene.append(&room);
        rooms.push(camera.relative_to([0.0, -f64::from(away), 0.0]));
    }
    let mut photos = views(&scene, rooms);
    for view in &mut photos {
        let row = 3 * view.photo.width as usize;
        let stripes = view.photo.rgb.chunks_mut(row).enumerate().filter(|(y, _)| y % 16 < 8);
        stripes.flat_map(|(_, row)| row).for_each(|v| *v = v.saturating_add(26));
    }
    let found = PhotoCheck::of(&scene, &photos).unwrap();
    assert!(found.unlike_own > 0.1 && found.proves_cameras(), "{found:?}");
    scene.means.iter_mut().for_each(|mean| mean[0] += 0.5);
    let found = PhotoCheck::of(&scene, &photos).unwrap();
    assert!(!found.proves_cameras(), "{found:?}");
}

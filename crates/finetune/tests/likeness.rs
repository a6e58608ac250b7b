//! The estimate of a loss does not trust the cameras that chose what was kept.

use finetune::{Likeness, Viewpoint, doubted_loss, estimate_loss};
use glam::DVec3;
use gs_model::{Camera, Scene};

/// Two clusters, and cameras that see the first one only.
fn clusters() -> (Scene, Vec<Camera>) {
    let one = testing::trained_like(2000, 1, &mut testing::Rng::seeded(1));
    let cameras = finetune::framing::around(&one, 6);
    let mut both = one.clone();
    both.append(&one);
    both.means[one.len()..].iter_mut().for_each(|m| m[0] += 6.0);
    (both, cameras)
}

#[test]
fn a_loss_that_the_cameras_do_not_see_is_told() {
    let (scene, cameras) = clusters();
    let kept = scene.select(&(0..scene.len() / 2).collect::<Vec<_>>());
    let loss = estimate_loss(&scene, &kept, Some(&cameras));
    let [at_cameras, around] = [loss.at_cameras, loss.around].map(|l| l.unwrap().psnr);
    assert!(at_cameras > around + 10.0, "{at_cameras} at the cameras, {around} around");
    assert_eq!(loss.worse(), loss.around);
    // What is lost is in the middle of the view.
    let Viewpoint { eye, ahead } = loss.worst.unwrap();
    let [ahead, eye] = [ahead, eye].map(DVec3::from);
    let lost = scene.means[kept.len()..].iter().map(|m| DVec3::from(m.map(f64::from)) - eye);
    let angle = lost.map(|to| to.angle_between(ahead).to_degrees()).fold(f64::MAX, f64::min);
    assert!(angle < 3.0, "{angle} degrees");
    assert!(loss.is_far_apart() && loss.doubts_cameras());
    assert_eq!(doubted_loss(&scene, &kept, &cameras), Some(loss));
    // Without cameras there is one figure.
    let alone = estimate_loss(&scene, &kept, None);
    assert_eq!((alone.at_cameras, alone.worse()), (None, alone.around));
    // Cameras that see nothing cannot speak for what they chose.
    let mut away = cameras[0].clone();
    away.translation.z -= 1e6;
    let blind = estimate_loss(&scene, &kept, Some(std::slice::from_ref(&away)));
    assert!(blind.at_cameras.is_none() && blind.doubts_cameras());
    assert_eq!(doubted_loss(&scene, &kept, &[away]), Some(blind));
    // Nothing is lost: nothing is doubted.
    let same = estimate_loss(&scene, &scene, Some(&cameras));
    assert_eq!(doubted_loss(&scene, &scene, &cameras), None);
    assert_eq!(same.worst, None);
    assert!(same.worse().unwrap().psnr == 99.0 && !same.is_far_apart());
}

#[test]
fn the_words_are_those_of_the_less_favourable_measure() {
    let words = |psnr, ssimulacra2| {
        let likeness = Likeness { psnr, ssim: 1.0, ssimulacra2, views: 1 };
        (likeness.meaning(), likeness.is_poor())
    };
    assert_eq!(words(99.0, 100.0), ("no difference can be seen", false));
    assert_eq!(words(99.0, 81.0), ("differences are hard to see", false));
    assert_eq!(words(41.0, 95.0), ("differences are hard to see", false));
    assert_eq!(words(36.0, 40.0), ("differences can be seen", false));
    assert_eq!(words(50.0, 20.0), ("differences are easy to see", true));
    assert_eq!(words(20.0, 90.0), ("differences are easy to see", true));
    // Pictures below 8 pixels have no SSIMULACRA2.
    assert_eq!(words(41.0, f64::NAN), ("differences are hard to see", false));
}

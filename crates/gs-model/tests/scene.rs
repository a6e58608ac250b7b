//! Appending to scenes and splitting them.

mod common;

use common::scene;
use gs_model::{Axes, Scene};

#[test]
fn what_was_appended_is_split_off() {
    for (a, b) in [(3, 2), (0, 2), (3, 0)] {
        let mut both = scene(a, 2);
        both.append(&scene(b, 2));
        assert_eq!(both.len(), a + b);
        assert_eq!(both.split_off(a), scene(b, 2));
        assert_eq!(both, scene(a, 2));
        assert!(both.split_off(a + 1).is_empty());
    }
}

#[test]
fn appended_gaussians_take_the_degree_of_the_scene() {
    let (mut low, mut high) = (scene(1, 0), scene(0, 1));
    let first = low.sh[0];
    low.append(&scene(1, 1));
    assert_eq!(low.sh, [first, scene(1, 1).sh[0]]);
    high.append(&scene(1, 0));
    assert_eq!(high.sh, [first, [0.0; 3], [0.0; 3], [0.0; 3]]);
}

const ORIGIN: [f64; 3] = [448_200.25, 5_411_900.5, -46.125];

fn georeferenced() -> Scene {
    Scene { antialiased: true, origin: ORIGIN, ..scene(5, 2) }
}

#[test]
fn a_scene_made_of_an_antialiased_one_is_antialiased_and_has_its_origin() {
    let whole = georeferenced();
    let (mut joined, mut in_part, mut split) = (scene(0, 3), scene(0, 0), whole.clone());
    joined.append(&whole);
    in_part.append_range(&whole, 1..2);
    let behind = split.split_off(2);
    let (mut cut, mut cleared, mut valid) = (whole.clone(), whole.clone(), whole.clone());
    cut.cut_sh(1);
    cleared.clear();
    valid.opacity_logits[1] = f32::NAN;
    assert_eq!(valid.drop_invalid(), 1);
    let made = [whole.select(&[3, 1]), whole.emptied(1), joined, in_part, split, behind];
    for (i, scene) in made.iter().chain(&[cut, cleared, valid]).enumerate() {
        assert_eq!((scene.antialiased, scene.origin), (true, ORIGIN), "{i}");
    }
    for axes in [Axes::YUp, Axes::Unity, Axes::Unreal] {
        let mut turned = georeferenced();
        axes.turn(&mut turned);
        assert!(turned.antialiased && turned.origin != ORIGIN);
        axes.turn_back(&mut turned);
        assert_eq!((turned.means, turned.origin), (whole.means.clone(), ORIGIN));
    }
}

#[test]
fn scenes_of_different_origins_are_joined_in_place() {
    let (mut a, mut b) = (georeferenced(), georeferenced());
    b.move_origin([448_300.25, 5_411_900.0, -46.125]);
    assert_eq!(b.means[0][0], a.means[0][0] - 100.0);
    a.append(&b);
    assert_eq!(a.origin, ORIGIN);
    for (near, moved) in a.means[..5].iter().zip(&a.means[5..]) {
        assert!(near.iter().zip(moved).all(|(a, b)| (a - b).abs() < 1e-5), "{near:?} {moved:?}");
    }
}

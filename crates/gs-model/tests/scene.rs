//! Appending to scenes and splitting them.

mod common;

use common::scene;

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

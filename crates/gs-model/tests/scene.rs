//! Appending to scenes and splitting them.

use gs_model::Scene;

fn scene(n: usize, sh_degree: u8) -> Scene {
    let mut s = Scene { sh_degree, ..Scene::default() };
    for i in 0..n {
        let v = i as f32;
        s.means.push([v, 1.0, 2.0]);
        s.rotations.push([1.0, v, 0.0, 0.0]);
        s.log_scales.push([-v; 3]);
        s.opacity_logits.push(0.5 + v);
        s.sh.extend((0..s.sh_len()).map(|k| [v, k as f32, 3.0]));
    }
    s
}

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
    let mut low = scene(1, 0);
    low.append(&scene(1, 1));
    assert_eq!(low.sh, [[0.0, 0.0, 3.0]; 2]);
    let mut high = scene(0, 1);
    high.append(&scene(1, 0));
    assert_eq!(high.sh, [[0.0, 0.0, 3.0], [0.0; 3], [0.0; 3], [0.0; 3]]);
}

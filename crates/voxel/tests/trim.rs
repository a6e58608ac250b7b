//! A cube without the floaters.

mod common;

use common::clustered;
use voxel::{Trim, TrimOutcome, cube_of, trim};

/// An octree that can reach the wanted cells keeps its floaters: a floater costs 3 bits per level.
#[test]
fn floaters_stay_while_levels_suffice() {
    let mut scene = clustered(1000, 3);
    scene.means.push([900.0, 0.0, 0.0]);
    let t = trim(&scene.means, &Trim::new(0.01)).unwrap();
    assert_eq!(t.outliers, [0usize; 0]);
    assert_eq!(t.cube, cube_of(&scene.means).unwrap());
    assert_eq!(t.j_high, 17);
}

/// A floater so far away that 21 levels do not reach the wanted cells is cut off.
#[test]
fn floaters_beyond_the_levels_are_trimmed() {
    let mut scene = clustered(1000, 3);
    scene.means.insert(500, [1e6, -3e5, 0.0]);
    scene.means.push([0.0, 0.0, -2e6]);
    let t = trim(&scene.means, &Trim::new(1e-3)).unwrap();
    assert_eq!(t.outliers, [500, 1001]);
    assert_eq!(t.inside.len(), 1000);
    assert!(t.cube.side < 4.0 && t.j_high <= 12 && t.saved_bits > 0.0);
    assert!(t.inside.iter().all(|&i| t.cube.index_of(scene.means[i], t.j_high).is_some()));
    assert!(t.cube.cell(t.j_high) <= 1e-3 && t.cube.cell(t.j_high - 1) > 1e-3);
}

/// The boxes are around the scene, wherever it is: a floater at the origin is far from this one.
#[test]
fn a_scene_far_from_the_origin_is_the_centre() {
    let mut means = vec![[0.0; 3]];
    means.extend((0..1000).map(|i| [1e4 + i as f32 * 0.001, -2e4, 3e4]));
    let t = trim(&means, &Trim::new(1e-3)).unwrap();
    assert_eq!(t.outliers, [0]);
}

/// Each Gaussian has the row of its place among those inside, or among the outliers after them.
#[test]
fn rows_name_every_gaussian_once() {
    let t = TrimOutcome {
        inside: vec![1, 2, 4],
        outliers: vec![0, 3],
        ..trim(&[], &Trim::new(1.0)).unwrap()
    };
    assert_eq!(t.rows(&[7, 5, 6], 8), [8, 7, 5, 9, 6]);
}

#[test]
fn trim_of_degenerate_scenes() {
    assert!(trim(&[], &Trim::new(1.0)).unwrap().inside.is_empty());
    let same = trim(&[[5.0; 3]; 9], &Trim::new(1e-30)).unwrap();
    assert_eq!(same.inside.len(), 9);
    assert!(trim(&[[0.0; 3]], &Trim::new(0.0)).is_err());
    assert!(trim(&[[0.0; 3]], &Trim::new(f64::NAN)).is_err());
    // Half the scene far away is no floater, whatever it costs.
    let split: Vec<_> =
        (0..100).map(|i| [if i % 2 == 0 { 0.0 } else { 1e9 }, i as f32, 0.0]).collect();
    let t = trim(&split, &Trim::new(1e-3)).unwrap();
    assert!(t.outliers.len() <= 50);
}

/// Nothing of these scenes is so far away that it costs bits.
#[test]
fn real_scenes_keep_their_floaters() {
    let shared = ["fox", "bonsai"].into_iter().filter_map(|name| {
        let path = testing::shared(&format!("scenes/{name}/point_cloud.ply"))?;
        Some((name, gs_model::ply::read(&path).unwrap().0))
    });
    for (name, scene) in std::iter::once(("leica", testing::leica())).chain(shared) {
        let cube = cube_of(&scene.means).unwrap();
        for depth in [10, 15, 21] {
            let t = trim(&scene.means, &Trim::new(cube.cell(depth))).unwrap();
            assert_eq!((t.outliers.len(), t.j_high), (0, depth), "{name} at {depth}");
        }
    }
}

/// Exact floats cost ten times as much as a coded Gaussian, and are still better than two scenes that an
/// octree turns into a few cells.
#[test]
fn two_scenes_far_apart_became_a_few_gaussians() {
    let one = clustered(1000, 3).means;
    let far = |distance: f32| one.iter().map(move |p| [p[0] + distance, p[1], p[2]]);
    let weighed = Trim { bits_per_outlier: 1800.0, ..Trim::new(0.01) };
    let trimmed = |distance| {
        let both: Vec<_> = one.iter().copied().chain(far(distance)).collect();
        trim(&both, &weighed).unwrap()
    };
    // Cells 50 times as wide as wanted.
    let t = trimmed(1e6);
    assert_eq!((t.inside.len(), t.outliers.len()), (1000, 1000));
    assert!(t.cube.side < 4.0, "{t:?}");
    // Cells 5 times as wide.
    assert!(trimmed(1e5).outliers.is_empty());
}

//! Degenerate and hostile scenes: no panic, no endless loop, and the behaviour that is stated.

mod common;

use common::{at, cube, strategies};
use gs_model::Scene;
use voxel::{
    Cube, Error, Merge, RateDistortion, Strategy, WeightSums, cube_of, merge, voxelize, w2,
};

/// Runs everything; returns the number of leaves under `Uniform` at depth 12.
fn run(scene: &Scene) -> usize {
    let cube = cube(scene);
    for strategy in strategies(scene.len(), 3, 16) {
        let v = voxelize(scene, &cube, &strategy).unwrap();
        for rule in [Merge::Paper, Merge::Moments] {
            let merged = merge(scene, &v, rule).unwrap();
            assert!(merged.means.iter().flatten().all(|x| x.is_finite()));
            assert!(merged.rotations.iter().flatten().all(|x| x.is_finite()));
            assert!(merged.log_scales.iter().flatten().all(|x| x.is_finite()));
            assert!(merged.opacity_logits.iter().all(|x| x.is_finite()));
        }
        assert!(w2::total_distortion(scene, &v).is_finite());
    }
    voxelize(scene, &cube, &Strategy::Uniform { depth: 12 }).unwrap().len()
}

#[test]
fn one_point() {
    let scene = at(&[[3.25, -1.0, 1e6]], -2.0);
    assert_eq!(run(&scene), 1);
    // Its voxelized mean is itself.
    let v = voxelize(&scene, &cube(&scene), &Strategy::Uniform { depth: 12 }).unwrap();
    assert_eq!(v.octree().centre(0), scene.means[0]);
}

#[test]
fn no_point() {
    let scene = Scene { sh_degree: 0, ..Scene::default() };
    assert_eq!(run(&scene), 0);
}

#[test]
fn identical_means() {
    assert_eq!(run(&at(&[[1.0, 2.0, 3.0]; 500], -2.0)), 1);
}

#[test]
fn collinear_and_coplanar() {
    let line: Vec<_> = (0..300).map(|i| [i as f32, 7.0, 7.0]).collect();
    assert_eq!(run(&at(&line, 0.0)), 300);
    let plane: Vec<_> = (0..900).map(|i| [(i % 30) as f32, 0.0, (i / 30) as f32]).collect();
    assert_eq!(run(&at(&plane, 0.0)), 900);
}

#[test]
fn extreme_scales() {
    // exp(+-69) is 1e+-30.
    for log_scale in [-69.0, 69.0, -200.0, 200.0, f32::MAX, f32::MIN] {
        let means: Vec<_> = (0..64).map(|i| [(i / 4) as f32, 0.0, 0.01 * (i % 4) as f32]).collect();
        let mut scene = at(&means, log_scale);
        run(&scene);
        // Flat: one scale of each sign.
        for (i, l) in scene.log_scales.iter_mut().enumerate() {
            l[i % 3] = -log_scale;
        }
        run(&scene);
    }
}

#[test]
fn extreme_coordinates_and_extents() {
    // Around 1e7 neighbouring f32 are 1 apart.
    let far: Vec<_> = (0..200).map(|i| [1e7 + (i % 50) as f32, -1e7, i as f32]).collect();
    assert_eq!(run(&at(&far, 0.0)), 200);
    let wide = [[1e38, 0.0, 0.0], [-1e38, 0.0, 0.0], [0.0, 1e-40, 0.0]];
    assert_eq!(run(&at(&wide, 0.0)), 3);
    // Wider than f32: only the authors' arithmetic gives up.
    let scene = at(&[[f32::MAX, 0.0, 0.0], [-f32::MAX, 0.0, 0.0]], 0.0);
    for strategy in strategies(2, 3, 16) {
        let result = voxelize(&scene, &cube(&scene), &strategy);
        match strategy {
            Strategy::Released(_) => assert!(matches!(result, Err(Error::InvalidCube { .. }))),
            _ => assert!(result.is_ok()),
        }
    }
    let tiny = [[0.0, 0.0, 0.0], [1e-45, 0.0, 0.0], [1e-44, 0.0, 1e-44]];
    assert_eq!(run(&at(&tiny, -60.0)), 3);
}

#[test]
fn extreme_opacities_and_zero_quaternions() {
    let mut scene = at(&[[0.0; 3]; 4], -2.0);
    scene.means[3] = [1.0; 3];
    for logits in [[100.0, 200.0, 50.0], [-100.0, -200.0, -50.0], [f32::MAX, 0.0, f32::MIN]] {
        scene.opacity_logits[..3].copy_from_slice(&logits);
        run(&scene);
    }
    scene.rotations[0] = [0.0; 4];
    scene.rotations[1] = [1e-30; 4];
    run(&scene);
}

#[test]
fn non_finite_means_are_named() {
    let mut scene = at(&[[0.0; 3], [1.0; 3], [2.0; 3]], 0.0);
    let cube = cube(&scene);
    for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        scene.means[1][2] = bad;
        assert_eq!(cube_of(&scene.means), Err(Error::NonFiniteMean { index: 1 }));
        assert_eq!(
            voxelize(&scene, &cube, &Strategy::Uniform { depth: 3 }),
            Err(Error::NonFiniteMean { index: 1 })
        );
    }
    scene.means[1] = [5.0; 3];
    assert_eq!(
        voxelize(&scene, &cube, &Strategy::Uniform { depth: 3 }),
        Err(Error::OutsideCube { index: 1 })
    );
}

#[test]
fn bad_parameters_are_named() {
    let scene = at(&[[0.0; 3], [1.0; 3]], 0.0);
    let cube = cube(&scene);
    let fails = |s: &Strategy| voxelize(&scene, &cube, s).unwrap_err();
    assert_eq!(
        fails(&Strategy::Uniform { depth: 22 }),
        Error::DepthTooGreat { depth: 22, max: 21 }
    );
    assert_eq!(fails(&Strategy::paper(9, 8)), Error::DepthRange { j_low: 9, j_high: 8 });
    let rd = voxel::RateDistortion { lambda: f64::NAN, ..voxel::RateDistortion::new(0.0) };
    assert!(matches!(
        fails(&Strategy::RateDistortion(rd)),
        Error::Parameter { name: "lambda", .. }
    ));
    let rd = voxel::RateDistortion::seen(0.1, vec![1.0]);
    let Error::Length { name: "importance", got: 1, want: 2 } =
        fails(&Strategy::RateDistortion(rd))
    else {
        panic!("a short importance must be named");
    };
    for bad in [Cube { origin: [0.0; 3], side: 0.0 }, Cube { origin: [f64::NAN; 3], side: 1.0 }] {
        assert!(matches!(
            voxelize(&scene, &bad, &Strategy::Uniform { depth: 3 }),
            Err(Error::InvalidCube { .. })
        ));
    }
}

/// The sum of many importances beside that of integers; it does not fit single precision.
#[test]
fn the_sum_of_many_importances_is_exact() {
    let parts: Vec<u32> = (0..300_000u32).map(|i| i * 7919 % 65_521 + 1).collect();
    let weights = parts.iter().map(|&p| p as f32 / 1024.0).collect();
    let scene = at(&vec![[0.5; 3]; parts.len()], -3.0);
    let sums = WeightSums::of(&scene, &RateDistortion::seen(0.01, weights)).unwrap();
    let exact = parts.iter().map(|&p| u64::from(p)).sum::<u64>() as f64 / 1024.0;
    assert_eq!((sums.count, sums.importance), (300_000, exact));
}

//! Means over neighbours.

mod common;

use gpcc_lite::{Cube, morton};
use voxel::{cube_of, local_means};

#[test]
fn a_far_part_has_means_of_its_own() {
    let mut scene = common::clustered(600, 5);
    for mean in &mut scene.means[300..] {
        mean[0] += 1e5;
    }
    let values: Vec<f64> = (0..600).map(|i| if i < 300 { 1.0 } else { 5.0 }).collect();
    let means = local_means(&scene, &values, 64).unwrap();
    let near = |want: f64, part: &[f64]| part.iter().filter(|&&m| (m - want).abs() < 1e-9).count();
    // Only windows at the border between the two parts see both.
    assert!(near(1.0, &means[..300]) >= 268 && near(5.0, &means[300..]) >= 268);
    assert_eq!(local_means(&scene, &[2.0; 600], 10_000).unwrap(), vec![2.0; 600]);
    assert!(local_means(&scene, &values[1..], 64).is_err());
    scene.means[7][1] = f32::NAN;
    assert!(local_means(&scene, &values, 64).is_err());
}

/// The mean of the nearest of the three runs around each Gaussian in two Morton orders, one Gaussian at a time.
fn slow(means: &[[f32; 3]], values: &[f64], width: usize) -> Vec<f64> {
    let cube = cube_of(means).unwrap();
    let origin = [0, 1, 2].map(|k| cube.origin[k] - [0.5, 0.45, 0.4][k] * cube.side);
    let orders = [cube, Cube { origin, side: 1.5 * cube.side }].map(|cube| {
        let code = |i: &usize| morton::encode(cube.index_of(means[*i], morton::MAX_DEPTH).unwrap());
        let mut order: Vec<usize> = (0..means.len()).collect();
        order.sort_by_key(code);
        order
    });
    let mean_of = |i: usize| {
        let mut best = (f64::INFINITY, 0.0);
        for order in &orders {
            let place = order.iter().position(|&member| member == i).unwrap();
            for before in [0, width / 2, width - 1] {
                let first = place.saturating_sub(before).min(means.len() - width);
                let run = &order[first..first + width];
                let squares = [1, 3, 5, 7].map(|s| {
                    let other = means[run[s * width / 8]];
                    (0..3)
                        .map(|k| f64::from(other[k]) - f64::from(means[i][k]))
                        .map(|d| d * d)
                        .sum::<f64>()
                });
                let distance: f64 = squares.iter().sum();
                if distance < best.0 {
                    best = (distance, run.iter().map(|&m| values[m]).sum::<f64>() / width as f64);
                }
            }
        }
        best.1
    };
    (0..means.len()).map(mean_of).collect()
}

#[test]
fn means_are_those_of_the_nearest_run() {
    let scene = common::clustered(700, 9);
    let values: Vec<f64> = (0..700).map(|i| f64::from(i * i % 17)).collect();
    let got = local_means(&scene, &values, 20).unwrap();
    for (i, (got, want)) in got.iter().zip(slow(&scene.means, &values, 20)).enumerate() {
        assert!((got - want).abs() < 1e-9, "Gaussian {i}: {got} {want}");
    }
}

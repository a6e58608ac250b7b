//! Means over neighbours.

mod common;

use voxel::local_means;

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

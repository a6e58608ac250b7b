//! Where the Gaussians of the input are in the output.
#![cfg(feature = "encode")]

mod common;

use common::{bits, encode, scene, with_floaters};
use gsvx::{Aim, EncodeOptions, Encoder, LEFT_OUT, MaxError, decode, encode_lossless};

#[test]
fn rows_lead_to_the_gaussians_that_the_input_became() {
    let (scene, outliers) = with_floaters(scene(3000, 1, 8));
    let encoded = encode(&scene, &EncodeOptions::default()).unwrap();
    let (rows, back) = (encoded.rows, decode(&encoded.bytes).unwrap());
    assert_eq!(rows.len(), scene.len());
    let mut members = vec![0u32; back.len()];
    for (i, &row) in rows.iter().enumerate() {
        members[row as usize] += 1;
        if outliers.contains(&i) {
            assert_eq!(bits(&back, row as usize), bits(&scene, i));
        }
    }
    // Gaussians alone in their leaf are in its cell, and every leaf has a Gaussian.
    assert!(members.iter().all(|&n| n > 0));
    let side = encoded.index.header.cube.side as f32;
    let far = |i: &usize| {
        let row = rows[*i] as usize;
        (0..3).any(|k| (back.means[row][k] - scene.means[*i][k]).abs() > 0.01 * side)
    };
    let inside = (0..scene.len()).filter(|i| !outliers.contains(i));
    assert_eq!(inside.filter(far).count(), 0);
}

#[test]
fn gaussians_that_no_camera_sees_have_no_row() {
    let scene = scene(2000, 0, 9);
    let importance: Vec<f32> = (0..scene.len()).map(|i| (i % 2) as f32).collect();
    let mut options = EncodeOptions::default();
    options.prepare.drop_unseen = true;
    let encoded = gsvx::encode(&scene, Some(&importance), 80.0, &options).unwrap();
    let left_out = encoded.rows.iter().filter(|&&row| row == LEFT_OUT).count();
    assert!(left_out > 0 && left_out == encoded.left_out);
}

#[test]
fn with_bounds_on_errors_each_gaussian_has_a_row_of_its_own() {
    let (scene, outliers) = with_floaters(scene(1000, 1, 11));
    let bounds = Aim::MaxError(MaxError::all(0.05));
    let encoded = Encoder::new(bounds).encode(&scene, None).unwrap().encoded;
    let (rows, back) = (encoded.rows, decode(&encoded.bytes).unwrap());
    let mut sorted = rows.clone();
    sorted.sort_unstable();
    assert!(sorted.into_iter().eq(0..scene.len() as u32));
    for (i, &row) in rows.iter().enumerate() {
        let row = row as usize;
        if outliers.contains(&i) {
            assert_eq!(bits(&back, row), bits(&scene, i));
        }
        let longest = scene.log_scales[i].iter().copied().fold(f32::NEG_INFINITY, f32::max);
        let d: [f32; 3] = std::array::from_fn(|k| back.means[row][k] - scene.means[i][k]);
        let off = (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).sqrt();
        assert!(off <= 0.0501 * libm::expf(longest), "{i}");
    }
}

#[test]
fn lossless_rows_are_exact() {
    let scene = scene(1500, 2, 10);
    for keep_order in [false, true] {
        let encoded = encode_lossless(&scene, keep_order).unwrap();
        let back = decode(&encoded.bytes).unwrap();
        for (i, &row) in encoded.rows.iter().enumerate() {
            assert_eq!(bits(&back, row as usize), bits(&scene, i));
            assert!(!keep_order || row as usize == i);
        }
    }
    assert!(encode_lossless(&Default::default(), false).unwrap().rows.is_empty());
}

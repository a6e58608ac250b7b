//! What a scene does not need takes no bytes: the list is in the crate's README.
#![cfg(feature = "encode")]

mod common;

use common::{bits, encode, scene};
use gs_model::{LEAST_DRAWN_LOGIT, Scene};
use gsvx::{
    Aim, EncodeOptions, EncodeWarning, Encoder, LEFT_OUT, MaxError, decode, encode_lossless,
};

/// A scene, and the same with as many transparent Gaussians between its own.
fn with_transparent(n: usize) -> (Scene, Scene) {
    let drawn = scene(n, 1, 3);
    let mut all = drawn.clone();
    all.append(&drawn);
    for i in n..2 * n {
        all.opacity_logits[i] = -8.0;
        all.means[i] = all.means[i].map(|x| 1.5 * x);
    }
    let mixed: Vec<usize> = (0..n).flat_map(|i| [n + i, i]).collect();
    (drawn, all.select(&mixed))
}

#[test]
fn transparent_gaussians_take_no_bytes_and_have_no_row() {
    let (drawn, all) = with_transparent(2000);
    let mut options = EncodeOptions::default();
    let (alone, encoded) = (encode(&drawn, &options).unwrap(), encode(&all, &options).unwrap());
    assert!(encoded.bytes == alone.bytes && encoded.transparent == 2000 && encoded.pruned == 0);
    let rows = alone.rows.into_iter().flat_map(|row| [LEFT_OUT, row]);
    assert!(encoded.rows.into_iter().eq(rows));
    // With importances and pruning too.
    options.prepare.prune = 0.25;
    let pruned = |scene: &Scene| {
        let n = scene.len();
        let seen: Vec<f32> = (0..n).map(|i| (i / (n / 2000) % 7) as f32).collect();
        gsvx::encode(scene, Some(&seen), 80.0, &options).unwrap()
    };
    let (alone, encoded) = (pruned(&drawn), pruned(&all));
    assert!(encoded.bytes == alone.bytes && encoded.pruned == 500 && encoded.transparent == 2000);
}

#[test]
fn bounds_on_errors_and_lossless_coding_keep_transparent_gaussians() {
    let (_, all) = with_transparent(300);
    let bounded =
        Encoder::new(Aim::MaxError(MaxError::all(0.05))).encode(&all, None).unwrap().encoded;
    assert_eq!((decode(&bounded.bytes).unwrap().len(), bounded.transparent), (600, 0));
    let lossless = encode_lossless(&all, true).unwrap();
    let back = decode(&lossless.bytes).unwrap();
    assert!((0..600).all(|i| bits(&back, i) == bits(&all, i)));
}

#[test]
fn a_scene_of_transparent_gaussians_alone_is_an_empty_stream_with_a_warning() {
    let mut all = scene(50, 1, 3);
    all.opacity_logits.fill(-6.0);
    let made = Encoder::new(Aim::Quality(50.0)).encode(&all, None).unwrap();
    assert!(decode(&made.encoded.bytes).unwrap().is_empty());
    assert_eq!(made.warnings, [EncodeWarning::AllTransparent(50)]);
}

#[test]
fn the_last_opacity_that_is_drawn_is_kept() {
    assert_eq!(f64::from(LEAST_DRAWN_LOGIT) as f32, -libm::log(254.0) as f32);
    let mut all = scene(2, 0, 3);
    all.opacity_logits = vec![LEAST_DRAWN_LOGIT, LEAST_DRAWN_LOGIT.next_down()];
    let encoded = encode(&all, &EncodeOptions::default()).unwrap();
    assert_eq!((encoded.index.header.count, encoded.transparent), (1, 1));
}

fn bytes(scene: &Scene) -> usize {
    encode(scene, &EncodeOptions::default()).unwrap().bytes.len()
}

#[test]
fn sh_degrees_that_are_zero_everywhere_take_no_bytes() {
    let plain = scene(2000, 0, 4);
    let mut padded = Scene { sh_degree: 3, ..Scene::default() };
    padded.append(&plain);
    assert_eq!(bytes(&padded), bytes(&plain));
}

#[test]
fn channels_of_colour_that_are_equal_are_coded_once() {
    let coloured = scene(4000, 1, 5);
    let mut grey = coloured.clone();
    grey.sh.iter_mut().for_each(|rgb| *rgb = [rgb[1]; 3]);
    let mut bare = coloured.clone();
    bare.sh.iter_mut().for_each(|rgb| *rgb = [0.0; 3]);
    let [coloured, grey, bare] = [coloured, grey, bare].map(|s| bytes(&s) as f64);
    let (one, three) = (grey - bare, coloured - bare);
    assert!(one < 0.5 * three, "{one} bytes of one channel, {three} of three");
}

#[test]
fn empty_space_takes_few_bytes() {
    let near = scene(4000, 0, 6);
    let mut far = near.clone();
    far.means.iter_mut().step_by(2).for_each(|m| m[0] += 500.0);
    let [near, far] = [near, far].map(|s| bytes(&s) as f64);
    // The two halves share no cell, as they did before: nothing merges between them.
    assert!(far < 1.1 * near, "{far} bytes, {near} without the space between the halves");
}

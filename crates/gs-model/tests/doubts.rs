//! Models that are not what they seem: numbers stored without log and logit, and positions far from the origin.

mod common;

use common::ply::{ENCODINGS, File, LITTLE};
use common::{read, written};
use gs_model::{Doubts, Scene, ply};

/// A hundred Gaussians of the room.
fn room() -> Scene {
    common::room(110, 3).select(&(0..100).collect::<Vec<_>>())
}

fn said(scene: &Scene) -> String {
    let (_, report) = read("a.ply", &written("ply", scene)).unwrap();
    assert_eq!(report.warnings, Doubts::of(scene).sentences());
    report.warnings.join("; ")
}

fn activate_scales(scene: &mut Scene) {
    scene.log_scales.as_flattened_mut().iter_mut().for_each(|s| *s = libm::expf(*s));
}

fn activate_opacities(scene: &mut Scene) {
    scene.opacity_logits.iter_mut().for_each(|o| *o = 1.0 / (1.0 + libm::expf(-*o)));
}

#[test]
fn a_trained_model_raises_no_doubt() {
    assert_eq!(said(&room()), "");
    assert_eq!(said(&room().select(&[3])), "");
    // In centimetres all Gaussians are wider than 1.
    let mut large = room();
    large.means.as_flattened_mut().iter_mut().for_each(|x| *x *= 3000.0);
    large.log_scales.as_flattened_mut().iter_mut().for_each(|s| *s += 8.1);
    assert_eq!(said(&large), "");
}

#[test]
fn scales_and_opacities_without_log_and_logit_are_noticed() {
    let mut both = room();
    activate_scales(&mut both);
    let mut opacities = room();
    activate_opacities(&mut opacities);
    assert!(said(&both).contains("stored without log?"), "{}", said(&both));
    activate_opacities(&mut both);
    assert!(said(&both).contains("stored without log and logit?"), "{}", said(&both));
    assert!(said(&opacities).contains("stored without logit?"), "{}", said(&opacities));
}

#[test]
fn colours_in_the_place_of_sh_coefficients_are_noticed() {
    for (full, least) in [(1.0, "0 and 1:"), (255.0, "0 and 255:")] {
        let mut scene = room();
        for (i, rgb) in scene.sh.iter_mut().enumerate() {
            *rgb = [0.0, 0.5, 1.0].map(|v| full * (v + 0.01 * (i % 7) as f32).min(1.0));
        }
        assert!(said(&scene).contains(least), "{}", said(&scene));
    }
}

#[test]
fn floats_that_arrive_coarse_are_said_with_step_size_and_remedy() {
    let mut far = room();
    far.means.iter_mut().for_each(|m| m[1] += 5_400_000.0);
    let said = said(&far);
    assert!(said.contains("steps of 0.5") && said.contains("subtract an offset"), "{said}");
}

/// A PLY with positions as doubles, far from the origin.
fn utm(scene: &Scene, encoding: &'static str) -> Vec<u8> {
    let mut file = File::inria(encoding, 0);
    file.properties[..3].iter_mut().for_each(|p| p.kind = "double");
    file.shift = UTM;
    file.bytes(scene).0
}

const UTM: [f64; 3] = [389_477.25, 5_435_291.5, 120.0];

#[test]
fn doubles_far_from_the_origin_keep_their_places() {
    let mut scene = room();
    scene.cut_sh(0);
    for encoding in ENCODINGS {
        let (back, report) = read("utm.ply", &utm(&scene, encoding)).unwrap();
        assert!(report.warnings.is_empty(), "{:?}", report.warnings);
        assert!(report.notes.join("; ").contains("relative to the origin"), "{:?}", report.notes);
        let off = |a: &Scene, i: usize, k: usize| {
            let place = a.origin[k] + f64::from(a.means[i][k]);
            (place - UTM[k] - f64::from(scene.means[i][k])).abs()
        };
        let worst = |a: &Scene| {
            let all = (0..a.len()).flat_map(|i| [0, 1, 2].map(|k| off(a, i, k)));
            all.fold(0.0, f64::max)
        };
        assert!(worst(&back) < 1e-6, "{}", worst(&back));
        // In a file, too.
        for name in ["ply", "compressed-ply"] {
            let (again, report) = read("a.ply", &written(name, &back)).unwrap();
            assert_eq!(again.origin, back.origin);
            assert!(report.sentences().is_empty(), "{:?}", report.sentences());
            assert!(name != "ply" || again == back);
        }
    }
}

#[test]
fn a_large_file_of_doubles_is_read_in_parts_alike() {
    let mut scene = room();
    scene.cut_sh(0);
    let all: Vec<usize> = (0..scene.len()).cycle().take(70_000).collect();
    let scene = scene.select(&all);
    let file = utm(&scene, LITTLE);
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("utm.ply");
    std::fs::write(&path, &file).unwrap();
    assert!(file.len() > 4 << 20);
    let (whole, _) = read("utm.ply", &file).unwrap();
    assert_eq!(ply::read(&path).unwrap().0, whole);
    let mut parts = ply::Parts::open(&path, &Default::default()).unwrap().unwrap();
    let mut joined = Scene::default();
    while let Some(part) = parts.next_part().unwrap() {
        assert_eq!(part.origin, whole.origin);
        joined.append(&part);
    }
    assert_eq!(joined, whole);
    assert!(parts.report().notes.join("; ").contains("relative to the origin"));
}

#[test]
fn one_far_gaussian_does_not_coarsen_a_compressed_ply() {
    let mut room = common::room(1, 0);
    // Of each Gaussian the distance to the nearest one that comes back, in its size; of those that show.
    let errors = |scene: &Scene| {
        let (back, _) = read("a.ply", &written("compressed-ply", scene)).unwrap();
        let mut errors: Vec<f32> = (0..11_000)
            .step_by(37)
            .map(|i| {
                let size = scene.log_scales[i].into_iter().fold(f32::NEG_INFINITY, f32::max);
                let square = |m: &[f32; 3]| {
                    let d = [0, 1, 2].map(|k| m[k] - scene.means[i][k]);
                    d[0] * d[0] + d[1] * d[1] + d[2] * d[2]
                };
                back.means.iter().map(square).fold(f32::INFINITY, f32::min).sqrt()
                    / libm::expf(size)
            })
            .collect();
        errors.sort_unstable_by(f32::total_cmp);
        errors[errors.len() * 95 / 100]
    };
    let before = errors(&room);
    room.means[17] = [60_000.0, 0.0, 0.0];
    let after = errors(&room);
    assert!(after < 1.5 * before, "{after}, {before} without it");
}

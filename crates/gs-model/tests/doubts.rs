//! Models that are not what they seem: numbers stored without log and logit, and positions far from the origin.

mod common;

use common::{fixture, read};
use gs_model::{Doubts, Scene, ply};

/// A hundred Gaussians of the room.
fn room() -> Scene {
    let (room, _) = ply::read(fixture("room/point_cloud.ply")).unwrap();
    room.select(&(0..11_000).step_by(110).collect::<Vec<_>>())
}

fn said(scene: &Scene) -> String {
    let mut file = Vec::new();
    ply::write_to(&mut file, scene).unwrap();
    let (_, report) = read("a.ply", &file).unwrap();
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

/// The rows of a PLY with positions as doubles, far from the origin, little-endian or ASCII.
fn utm(scene: &Scene, ascii: bool) -> Vec<u8> {
    let format = if ascii { "ascii" } else { "binary_little_endian" };
    let mut file = format!("ply\nformat {format} 1.0\nelement vertex {}\n", scene.len());
    ["x", "y", "z"].iter().for_each(|n| file += &format!("property double {n}\n"));
    let names = ["f_dc_0", "f_dc_1", "f_dc_2", "opacity", "scale_0", "scale_1", "scale_2"];
    let names = names.into_iter().chain(["rot_0", "rot_1", "rot_2", "rot_3"]);
    names.for_each(|n| file += &format!("property float {n}\n"));
    let mut file = (file + "end_header\n").into_bytes();
    for i in 0..scene.len() {
        let position: [f64; 3] = std::array::from_fn(|k| UTM[k] + f64::from(scene.means[i][k]));
        let (sh, opacity) = (scene.sh_of(i)[0], [scene.opacity_logits[i]]);
        let floats = [&sh[..], &opacity, &scene.log_scales[i], &scene.rotations[i]].concat();
        if ascii {
            let doubles = position.map(|x| x.to_string()).join(" ");
            let floats: Vec<String> = floats.iter().map(f32::to_string).collect();
            file.extend(format!("{doubles} {}\n", floats.join(" ")).bytes());
        } else {
            position.iter().for_each(|x| file.extend(x.to_le_bytes()));
            floats.iter().for_each(|x| file.extend(x.to_le_bytes()));
        }
    }
    file
}

const UTM: [f64; 3] = [389_477.25, 5_435_291.5, 120.0];

#[test]
fn doubles_far_from_the_origin_keep_their_places() {
    let mut scene = room();
    scene.cut_sh(0);
    for ascii in [false, true] {
        let (back, report) = read("utm.ply", &utm(&scene, ascii)).unwrap();
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
            let mut file = Vec::new();
            gs_model::Format::named(name).unwrap().write_to("a", &mut file, &back).unwrap();
            let (again, report) = read("a.ply", &file).unwrap();
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
    let file = utm(&scene, false);
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
    let (mut room, _) = ply::read(fixture("room/point_cloud.ply")).unwrap();
    room.cut_sh(0);
    let compressed = gs_model::Format::named("compressed-ply").unwrap();
    // Of each Gaussian the distance to the nearest one that comes back, in its size; of those that show.
    let errors = |scene: &Scene| {
        let mut file = Vec::new();
        compressed.write_to("a", &mut file, scene).unwrap();
        let (back, _) = read("a.ply", &file).unwrap();
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

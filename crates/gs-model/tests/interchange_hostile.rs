//! Broken and hostile files of the interchange formats: a typed error of one line, never a panic, never
//! memory far beyond the file's size.

mod common;

use std::path::PathBuf;

use gs_model::model;
use gs_model::{Error, ReadOptions, Result, Scene, gltf, ply};
use proptest::prelude::*;

const NAMES: [&str; 4] = ["small.compressed.ply", "small.ksplat", "small.sog", "small.glb"];

fn fixture(name: &str) -> Vec<u8> {
    let formats = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../fixtures/formats");
    std::fs::read(formats.join(name)).unwrap()
}

fn read(name: &str, bytes: &[u8]) -> Result<Scene> {
    model::read_named(name, bytes, &ReadOptions::default()).map(|(scene, _)| scene)
}

fn assert_plain(error: &Error, name: &str) {
    let text = error.to_string();
    assert!(text.starts_with(name) && text.lines().count() == 1, "{text}");
    assert!(!text.contains(['{', '}']), "{text}");
}

#[test]
fn files_that_are_cut_short_are_typed_errors() {
    for name in NAMES {
        let file = fixture(name);
        let whole = read(name, &file).unwrap();
        // Every length near the ends, and some between.
        let lengths = (0..file.len()).filter(|&n| n < 700 || n % 97 == 0 || n + 300 > file.len());
        for len in lengths {
            match read(name, &file[..len]) {
                Err(error) => assert_plain(&error, name),
                // Padding may be missing.
                Ok(scene) => assert_eq!(scene, whole, "{name} {len}"),
            }
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]

    #[test]
    fn changed_bytes_are_errors_or_scenes(
        which in 0..NAMES.len(),
        changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6),
        in_head in any::<bool>(),
    ) {
        let name = NAMES[which];
        let mut file = fixture(name);
        let reach = if in_head { file.len().min(1200) } else { file.len() };
        for (at, byte) in changes {
            file[at.index(reach)] = byte;
        }
        match read(name, &file) {
            Ok(scene) => scene.validate().unwrap(),
            Err(error) => prop_assert_eq!(error.to_string().lines().count(), 1),
        }
    }

    #[test]
    fn a_glb_comes_back(n in 1usize..40, degree in 0u8..=3, seed in any::<u64>()) {
        let scene = random(n, degree, seed);
        let mut file = Vec::new();
        gltf::write_to(&mut file, &scene).unwrap();
        let (back, _) = model::read_named("a.glb", &file, &ReadOptions::default()).unwrap();
        prop_assert_eq!(&back.means, &scene.means);
        prop_assert_eq!(&back.sh, &scene.sh);
        prop_assert_eq!(back.sh_degree, degree);
        let opacity = |l: f32| 1.0 / (1.0 + libm::exp(-f64::from(l)));
        for i in 0..n {
            for (a, b) in scene.log_scales[i].iter().zip(back.log_scales[i]) {
                let bound = a.abs().max(1.0) / (1u32 << 22) as f32;
                prop_assert!((a - b).abs() <= bound, "{} {}", a, b);
            }
            let (a, b) = (opacity(scene.opacity_logits[i]), opacity(back.opacity_logits[i]));
            prop_assert!((a - b).abs() <= 6e-8, "{} {}", a, b);
            let [p, q] = [&scene, &back].map(|s| {
                glam::DVec4::from_array(s.rotations[i].map(f64::from)).normalize()
            });
            prop_assert!(p.dot(q).abs() > 1.0 - 1e-12);
            prop_assert!((back.rotations[i].iter().map(|v| v * v).sum::<f32>() - 1.0).abs() < 1e-6);
        }
    }
}

/// Numbers of all sizes that a trained model may have.
fn random(n: usize, sh_degree: u8, seed: u64) -> Scene {
    let mut state = seed | 1;
    let mut next = |most: f32| {
        state =
            state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((state >> 40) as f32 / (1 << 23) as f32 - 1.0) * most
    };
    let mut scene = Scene::zeros(n, sh_degree);
    scene.means.iter_mut().flatten().for_each(|v| *v = next(1000.0));
    scene.rotations.iter_mut().flatten().for_each(|v| *v = next(3.0));
    scene.log_scales.iter_mut().flatten().for_each(|v| *v = next(20.0));
    scene.opacity_logits.iter_mut().for_each(|v| *v = next(25.0));
    scene.sh.iter_mut().flatten().for_each(|v| *v = next(4.0));
    scene
}

/// The JSON of a `.glb` with something in it replaced.
fn glb_with(from: &str, to: &str) -> Vec<u8> {
    let mut file = Vec::new();
    gltf::write_to(&mut file, &common::scene(3, 1)).unwrap();
    let len = u32::from_le_bytes(file[12..16].try_into().unwrap()) as usize;
    let json = String::from_utf8(file[20..20 + len].to_vec()).unwrap();
    assert!(json.contains(from), "{json}");
    let mut changed = json.replacen(from, to, 1).into_bytes();
    changed.resize(changed.len().next_multiple_of(4), b' ');
    let data = &file[20 + len..];
    let mut out = b"glTF\x02\0\0\0".to_vec();
    out.extend(((20 + changed.len() + data.len()) as u32).to_le_bytes());
    out.extend((changed.len() as u32).to_le_bytes());
    out.extend(b"JSON");
    [&out, &changed[..], data].concat()
}

#[test]
fn what_is_not_read_of_gltf_is_named() {
    let said = |from: &str, to: &str| {
        let error = read("a.glb", &glb_with(from, to)).unwrap_err();
        assert_plain(&error, "a.glb");
        error.to_string()
    };
    let space = "\"colorSpace\":\"srgb_rec709_display\"";
    assert!(said("ellipse", "cube").contains("kernel \"cube\""));
    assert!(said("srgb_rec709_display", "lin_rec709_display").contains("colour space"));
    let compressed = format!("{space},\"extensions\":{{\"KHR_spz_2\":{{}}}}");
    assert!(said(space, &compressed).contains("compressed (KHR_spz_2)"));
    assert!(said(space, "\"colorSpace\":7").contains("JSON"));
    let node = "\"nodes\":[{\"mesh\":0}]";
    let turned = "\"nodes\":[{\"children\":[1],\"translation\":[0,1,0]},{\"mesh\":0}]";
    assert!(said(node, turned).contains("node 1 has a transform"));
    let required = "\"extensionsRequired\":[\"KHR_draco_mesh_compression\"],\"extensionsUsed\"";
    assert!(said("\"extensionsUsed\"", required).contains("requires KHR_draco_mesh_compression"));
    assert!(said("\"mode\":0", "\"mode\":1").contains("POINTS"));
    assert!(said("\"count\":3", "\"count\":9999999999").contains("more than the file holds"));
    assert!(said("\"count\":3", "\"count\":2").contains("different lengths"));
    assert!(said("KHR_gaussian_splatting:SCALE", "SCALE").contains("SCALE is missing"));
    assert!(said("SH_DEGREE_1_COEF_2", "SH_DEGREE_1_COEF_5").contains("COEF_2 is missing"));
    // The same primitive a hundred times over.
    let file = glb_with("\"mode\":0", "\"mode\":0");
    let text = String::from_utf8_lossy(&file).into_owned();
    let start = text.find("\"primitives\":[").unwrap() + 14;
    let end = text[start..].find("]}]").unwrap() + start;
    let one = &text[start..end];
    let many = vec![one; 100].join(",");
    assert!(said(one, &many).contains("more Gaussians than the file has data for"));
    // A transform that does nothing is none.
    let same = "\"nodes\":[{\"mesh\":0,\"scale\":[1,1,1],\"rotation\":[0,0,0,1]}]";
    assert_eq!(read("a.glb", &glb_with(node, same)).unwrap().len(), 3);
    let empty = gltf::write_to(Vec::new(), &Scene::default()).unwrap_err();
    assert!(empty.to_string().contains("empty"), "{empty}");
}

/// A row of a `.ksplat` of level 0: one Gaussian of degree 1.
fn ksplat(level: u16, row: &[u8], head: &[(usize, u32)]) -> Vec<u8> {
    let mut file = vec![0; 4096 + 1024];
    file[1] = 1;
    file[4] = 1;
    file[20..22].copy_from_slice(&level.to_le_bytes());
    for (at, word) in [(0, 1), (4, 1), (40, 1)].iter().chain(head) {
        file[4096 + at..4100 + at].copy_from_slice(&u32::to_le_bytes(*word));
    }
    file.extend(row);
    file
}

#[test]
fn a_ksplat_without_compression_is_read() {
    let mut row = Vec::new();
    // Mean, scales, quaternion.
    for v in [1.0f32, -2.0, 3.5, 1.0, 0.5, 2.0, 0.5, -0.5, 0.5, 0.5] {
        row.extend(v.to_le_bytes());
    }
    row.extend([255, 0, 51, 51]);
    // Red of three functions, then green, then blue.
    (0..9).for_each(|i| row.extend((i as f32 / 8.0).to_le_bytes()));
    let scene = read("a.ksplat", &ksplat(0, &row, &[])).unwrap();
    assert_eq!((scene.means[0], scene.rotations[0]), ([1.0, -2.0, 3.5], [0.5, -0.5, 0.5, 0.5]));
    let ln2 = std::f32::consts::LN_2;
    assert_eq!(scene.log_scales[0], [0.0, -ln2, ln2]);
    assert!((scene.opacity_logits[0] + 2.0 * ln2).abs() < 1e-6);
    assert_eq!(scene.sh_of(0)[1], [0.0, 3.0 / 8.0, 6.0 / 8.0]);
    assert_eq!(scene.sh_of(0)[3], [2.0 / 8.0, 5.0 / 8.0, 1.0]);
    // A scale of 0 is invalid here, since a float holds any.
    row[12..16].fill(0);
    let outcome = read("a.ksplat", &ksplat(0, &row, &[]));
    assert!(matches!(outcome, Err(Error::InvalidGaussian { .. })), "{outcome:?}");
}

#[test]
fn a_ksplat_of_half_floats_is_read() {
    let mut row = Vec::new();
    // Steps 0 and 32,767 and 65,534 of a bucket of 5 units around (1, 2, 3); then half floats.
    for v in [0u16, 32767, 65534, 0x3c00, 0x3800, 0x0000, 0x3c00, 0x8000, 0, 0] {
        row.extend(v.to_le_bytes());
    }
    row.extend([0, 128, 255, 255]);
    row.extend([0x3c00u16; 9].iter().flat_map(|v| v.to_le_bytes()));
    let bucket: Vec<u8> =
        [1.0f32, 2.0, 3.0].iter().flat_map(|v| v.to_le_bytes()).chain(row).collect();
    // One partial bucket of one Gaussian; size, count, side, stored bytes, range, full, partial.
    let head = [(8, 256), (12, 1), (16, 5.0f32.to_bits()), (20, 12), (24, 32767), (36, 1)];
    let rows = [&1u32.to_le_bytes()[..], &bucket].concat();
    let scene = read("a.ksplat", &ksplat(1, &rows, &head)).unwrap();
    assert_eq!(scene.means[0], [-1.5, 2.0, 5.5]);
    assert_eq!(scene.log_scales[0][..2], [0.0, -std::f32::consts::LN_2]);
    // A half float of 0 stands for anything below 2^-25.
    assert!((scene.log_scales[0][2] + 25.0 * std::f32::consts::LN_2).abs() < 1e-5);
    assert_eq!(scene.sh_of(0)[1], [1.0; 3]);
    let nowhere = [&0u32.to_le_bytes()[..], &bucket].concat();
    let error = read("a.ksplat", &ksplat(1, &nowhere, &head)).unwrap_err();
    assert!(error.to_string().contains("section 0 has Gaussians in no bucket"), "{error}");
}

/// A PLY of floats with these columns and rows.
fn ply_of(columns: &str, rows: &[&[f32]]) -> Result<(Scene, ply::ReadReport)> {
    let mut text = format!("ply\nformat ascii 1.0\nelement vertex {}\n", rows.len());
    for column in columns.split_whitespace() {
        let kind = if ["red", "green", "blue"].contains(&column) { "uchar" } else { "float" };
        text += &format!("property {kind} {column}\n");
    }
    text += "end_header\n";
    for row in rows {
        text += &row.iter().map(|v| format!("{v} ")).collect::<String>();
        text += "\n";
    }
    ply::read_bytes(text.as_bytes())
}

#[test]
fn discs_of_2d_gaussian_splatting_get_a_thickness() {
    let columns = "x y z f_dc_0 f_dc_1 f_dc_2 opacity scale_0 scale_1 rot_0 rot_1 rot_2 rot_3";
    let row = [1., 2., 3., 0.1, 0.2, 0.3, 0.5, -2.0, -3.0, 1.0, 0.0, 0.0, 0.0];
    let (scene, report) = ply_of(columns, &[&row]).unwrap();
    assert_eq!(scene.log_scales[0][..2], [-2.0, -3.0]);
    assert!((scene.log_scales[0][2] + 3.0 + libm::logf(1000.0)).abs() < 1e-6);
    assert!(report.notes[0].contains("2D Gaussian splatting"), "{:?}", report.notes);
}

#[test]
fn colours_as_bytes_are_sh_coefficients() {
    let columns = "x y z red green blue opacity scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3";
    let row = [1., 2., 3., 255.0, 0.0, 51.0, 0.5, -2.0, -3.0, -4.0, 1.0, 0.0, 0.0, 0.0];
    let (scene, report) = ply_of(columns, &[&row]).unwrap();
    let colour = scene.sh_of(0)[0].map(|v| 0.5 + gs_model::SH_C0 * v);
    for (c, expected) in colour.into_iter().zip([1.0, 0.0, 0.2]) {
        assert!((c - expected).abs() < 1e-6, "{colour:?}");
    }
    assert!(report.unknown_properties.is_empty() && report.notes.len() == 1);
    // Points without scales are no model.
    let error = ply_of("x y z red green blue", &[&[0.0; 6]]).unwrap_err();
    assert!(matches!(error, Error::PlyMissingProperty { .. }), "{error}");
}

#[test]
fn filter_3d_of_mip_splatting_is_added() {
    let columns = "x y z f_dc_0 f_dc_1 f_dc_2 opacity scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3 \
                   filter_3D";
    let row =
        |f: f32, l: f32| [1., 2., 3., 0.1, 0.2, 0.3, l, -2.0, -3.0, -4.0, 1.0, 0.0, 0.0, 0.0, f];
    let (scene, report) = ply_of(columns, &[&row(0.05, 1.0), &row(0.0, 1.0)]).unwrap();
    // Mip-Splatting's own formulas, in floating point of twice the width.
    let variances = [-2.0f64, -3.0, -4.0].map(|s| libm::exp(2.0 * s));
    let smoothed = variances.map(|v| v + 0.0025);
    let factor = (variances.iter().product::<f64>() / smoothed.iter().product::<f64>()).sqrt();
    let opacity = factor / (1.0 + libm::exp(-1.0));
    for (s, v) in scene.log_scales[0].into_iter().zip(smoothed) {
        assert!((f64::from(s) - 0.5 * libm::log(v)).abs() < 1e-6);
    }
    let logit = libm::log(opacity / (1.0 - opacity));
    assert!((f64::from(scene.opacity_logits[0]) - logit).abs() < 1e-5);
    // Without smoothing, every bit stays.
    assert_eq!((scene.log_scales[1], scene.opacity_logits[1]), ([-2.0, -3.0, -4.0], 1.0));
    assert!(report.unknown_properties.is_empty() && report.notes.len() == 1);
}

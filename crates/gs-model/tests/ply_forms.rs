//! One scene, many forms of its file: every one must read as the same bits. Models whose columns differ from the Inria
//! layout.

mod common;

use common::ply::{ASCII, ENCODINGS, File, LITTLE, Property, ascii_ply};
use common::{DROP, bits, read, says, scene, written};
use gs_model::ply::{self, Parts};
use gs_model::{ReadOptions, Report, Result, Scene};

/// A fixed shuffle: the same in every run.
fn shuffle<T>(items: &mut [T], seed: u64) {
    let mut state = seed;
    for i in (1..items.len()).rev() {
        state =
            state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        items.swap(i, (state >> 33) as usize % (i + 1));
    }
}

/// Every form that the scene's file is tested in, with a name for messages.
fn forms(format: &'static str, sh_degree: u8) -> Vec<(String, File)> {
    let plain = File::inria(format, sh_degree);
    let mut all = Vec::new();
    let mut add = |name: &str, change: &dyn Fn(&mut File)| {
        let mut file = plain.clone();
        change(&mut file);
        all.push((format!("{format}, degree {sh_degree}, {name}"), file));
    };
    let extra = |kind| Property { name: format!("extra_{kind}"), kind, list: false };
    add("plain", &|_| {});
    add("reversed", &|f| f.properties.reverse());
    for seed in 0..4 {
        add("shuffled", &|f| shuffle(&mut f.properties, seed));
    }
    add("sorted by name", &|f| f.properties.sort_by(|a, b| a.name.cmp(&b.name)));
    add("without normals", &|f| f.properties.retain(|p| !p.name.starts_with('n')));
    add("double", &|f| f.properties.iter_mut().for_each(|p| p.kind = "double"));
    add("float32 and float64 mixed", &|f| {
        for (i, p) in f.properties.iter_mut().enumerate() {
            p.kind = ["float32", "float64"][i % 2];
        }
    });
    add("unknown properties", &|f| {
        for (i, kind) in ["char", "ushort", "double", "int8"].into_iter().enumerate() {
            f.properties.insert(5 * i, extra(kind));
        }
    });
    add("other elements before", &|f| f.faces_before = 6);
    add("other elements before and after", &|f| (f.faces_before, f.faces_after) = (3, 5));
    add("CRLF", &|f| f.line_end = "\r\n");
    add("CR", &|f| f.line_end = "\r");
    all
}

#[test]
fn every_form_reads_as_the_same_bits() {
    for format in ENCODINGS {
        for degree in 0..4 {
            let scene = scene(7, degree);
            for (name, file) in forms(format, degree) {
                let (bytes, _) = file.bytes(&scene);
                let (back, report) =
                    ply::read_bytes(&bytes).unwrap_or_else(|e| panic!("{name}: {e}"));
                assert_eq!(bits(&back), bits(&scene), "{name}");
                assert_eq!((back.sh_degree, report.gaussians_in_file), (degree, 7), "{name}");
                assert_eq!(report.format, "ply", "{name}");
                let unknown: Vec<&str> = file
                    .properties
                    .iter()
                    .filter_map(|p| p.name.starts_with("extra").then_some(p.name.as_str()))
                    .collect();
                let said = report.notes.join("; ");
                assert!(unknown.iter().all(|p| said.contains(p)), "{name}: {said}");
                for (faces, element) in [(file.faces_before, "before"), (file.faces_after, "after")]
                {
                    let told = said.contains(&format!("{element} ({faces} rows)"));
                    assert_eq!(told, faces > 0, "{name}: {said}");
                }
                assert!(!said.contains("made by a test"), "{name}: {said}");
            }
        }
    }
}

#[test]
fn every_scalar_type_is_converted() {
    // Whole numbers that every type holds; 200 only fits the unsigned byte.
    let mut scene = scene(3, 1);
    let mut arrays: [&mut [f32]; 5] = [
        scene.means.as_flattened_mut(),
        scene.rotations.as_flattened_mut(),
        scene.log_scales.as_flattened_mut(),
        &mut scene.opacity_logits,
        scene.sh.as_flattened_mut(),
    ];
    for (i, v) in arrays.iter_mut().flat_map(|a| a.iter_mut()).enumerate() {
        *v = (i % 100 + 1) as f32;
    }
    for format in ENCODINGS {
        for kind in ["char", "uchar", "short", "ushort", "int", "uint", "float", "double", "uint8"]
        {
            let mut file = File::inria(format, 1);
            file.properties.iter_mut().for_each(|p| p.kind = kind);
            let (bytes, _) = file.bytes(&scene);
            assert_eq!(ply::read_bytes(&bytes).unwrap().0, scene, "{format} {kind}");
        }
    }
}

#[test]
fn the_writer_writes_the_inria_layout() {
    for degree in 0..4 {
        let scene = scene(5, degree);
        let ours = written("ply", &scene);
        let (mut theirs, _) = File::inria(LITTLE, degree).bytes(&scene);
        let comment = b"comment made by a test\n";
        let at = theirs.windows(comment.len()).position(|w| w == comment).unwrap();
        theirs.drain(at..at + comment.len());
        assert_eq!(ours, theirs, "degree {degree}");
    }
}

#[test]
fn any_number_of_threads_reads_and_writes_the_same() {
    // More rows than several tasks take, and not a multiple of them.
    let scene = scene(5000, 1);
    let mut one: Option<(Vec<u8>, Scene)> = None;
    for threads in [1, 2, 8] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let outcome = pool.install(|| {
            let bytes = written("ply", &scene);
            let back = ply::read_bytes(&bytes).unwrap().0;
            (bytes, back)
        });
        assert_eq!(bits(&outcome.1), bits(&scene), "{threads} threads");
        assert!(one.get_or_insert_with(|| outcome.clone()).0 == outcome.0, "{threads} threads");
    }
}

#[test]
fn no_gaussians_is_a_scene() {
    for format in ENCODINGS {
        let (bytes, _) = File::inria(format, 2).bytes(&scene(0, 2));
        let (back, _) = ply::read_bytes(&bytes).unwrap();
        assert!(back.is_empty() && back.sh_degree == 2);
    }
    assert!(ply::read_bytes(&written("ply", &Scene::default())).unwrap().0.is_empty());
}

#[test]
fn bytes_after_the_end_are_reported() {
    for format in ENCODINGS {
        let (mut bytes, _) = File::inria(format, 0).bytes(&scene(2, 0));
        bytes.extend(b"more\n\n");
        let (back, report) = ply::read_bytes(&bytes).unwrap();
        assert_eq!(back.len(), 2);
        let expected = if format == ASCII { 4 } else { 6 };
        let said = format!("{expected} bytes after the last row are not read");
        assert_eq!(report.notes, [said], "{format}");
    }
}

#[test]
fn what_is_missing_is_named() {
    let scene = scene(1, 1);
    // Without scale_2 alone it is a model of 2D Gaussians.
    for gone in ["x", "f_dc_1", "opacity", "scale_1", "rot_3"] {
        let mut file = File::inria(LITTLE, 1);
        file.properties.retain(|p| p.name != gone);
        let outcome = read("a.ply", &file.bytes(&scene).0);
        says(outcome, &format!("element \"vertex\": no property {gone}: not a 3DGS model"));
    }
    // The right number of f_rest, but not the right ones.
    let mut file = File::inria(LITTLE, 1);
    let last = file.properties.iter_mut().find(|p| p.name == "f_rest_8").unwrap();
    last.name = "f_rest_9".into();
    says(read("a.ply", &file.bytes(&common::scene(0, 1)).0), "no property f_rest_8");
}

#[test]
fn rows_beyond_those_that_the_header_promises_are_counted() {
    let (short, _) = File::inria(LITTLE, 0).bytes(&scene(2, 0));
    let (long, _) = File::inria(LITTLE, 0).bytes(&scene(3, 0));
    let row = long.len() - short.len();
    let bytes = [&short[..], &short[short.len() - row..], &short[short.len() - row..]].concat();
    let (back, report) = ply::read_bytes(&bytes).unwrap();
    assert_eq!(back.len(), 2);
    assert_eq!(report.notes, ["2 rows more than the header promises are not read"]);
}

/// Files that are read in parts: several parts, rows across their borders, trailing bytes.
#[test]
fn large_files_are_read_as_small_ones_are() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("large.ply");
    let scene = scene(30_000, 3);
    let mut file = File::inria(LITTLE, 3);
    file.normal = 1.0;
    let (mut bytes, _) = file.bytes(&scene);
    bytes.extend([1, 2, 3]);
    assert!(bytes.len() > 7 << 20);
    std::fs::write(&path, &bytes).unwrap();
    let (model, report) = gs_model::model::read(&path, &Default::default()).unwrap();
    assert!(model == scene && ply::read_bytes(&bytes).unwrap().0 == scene);
    let said = report.notes.join("; ");
    assert!(said.contains("not kept: nx, ny, nz; 3 bytes after the last row"), "{said}");
    // Cut short, the error is that of the reader of whole files.
    std::fs::write(&path, &bytes[..bytes.len() - 100]).unwrap();
    says(ply::read(&path), "row 29999 is not whole");
}

#[test]
fn what_a_scene_does_not_keep_is_reported() {
    for encoding in ENCODINGS {
        const PROPERTIES: &str = "properties that are not part of a 3DGS model are not kept: ";
        for (normal, lost) in [(0.0, ""), (-0.0, ""), (0.5, "nx, ny, nz")] {
            let mut file = File::inria(encoding, 1);
            file.normal = normal;
            let (_, report) = ply::read_bytes(&file.bytes(&scene(7, 1)).0).unwrap();
            let said = if lost.is_empty() { vec![] } else { vec![format!("{PROPERTIES}{lost}")] };
            assert_eq!(report.notes, said, "{encoding}, {normal}");
        }
        let mut file = File::inria(encoding, 0);
        file.properties.push(Property { name: "id".into(), kind: "uchar", list: false });
        file.faces_after = 2;
        let (_, report) = ply::read_bytes(&file.bytes(&scene(3, 0)).0).unwrap();
        let elements = "other elements than those of the model are not kept: after (2 rows)";
        assert_eq!(report.notes, [&format!("{PROPERTIES}id"), elements], "{encoding}");
    }
    // Numbers that no float holds.
    let mut file = File::inria(LITTLE, 0);
    file.properties[0].kind = "double";
    let (mut bytes, header) = file.bytes(&scene(2, 0));
    assert!(ply::read_bytes(&bytes).unwrap().1.notes.is_empty());
    bytes[header..header + 8].copy_from_slice(&0.1f64.to_le_bytes());
    let (_, report) = ply::read_bytes(&bytes).unwrap();
    assert_eq!(report.notes, ["numbers that no float holds are rounded: x"]);
}

#[test]
fn a_file_in_parts_is_the_whole_file() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("model.ply");
    let mut whole = scene(30_000, 3);
    (whole.log_scales, whole.sh) = (vec![[-3.0; 3]; 30_000], vec![[0.5; 3]; 16 * 30_000]);
    ply::write(&path, &whole).unwrap();
    let read = |options: &ReadOptions| -> Result<Vec<Scene>> {
        let mut parts = Parts::open(&path, options)?.unwrap();
        assert_eq!(parts.gaussians_in_file(), 30_000);
        std::iter::from_fn(|| parts.next_part().transpose()).collect()
    };
    let parts = read(&ReadOptions::default()).unwrap();
    assert!(parts.len() > 5);
    let mut joined = Scene { sh_degree: 3, ..Scene::default() };
    parts.iter().for_each(|part| joined.append(part));
    assert_eq!(bits(&joined), bits(&whole));
    // The error is that of the whole file.
    for i in [9_000, 9_001, 29_999] {
        whole.means[i][1] = f32::NAN;
    }
    ply::write(&path, &whole).unwrap();
    let error = ply::read(&path).unwrap_err().to_string();
    assert_eq!(read(&ReadOptions::default()).unwrap_err().to_string(), error);
    assert_eq!(read(&DROP).unwrap().iter().map(Scene::len).sum::<usize>(), 29_997);
    std::fs::write(&path, "ply\nformat ascii 1.0\nelement vertex 0\nend_header\n").unwrap();
    assert!(Parts::open(&path, &DROP).unwrap().is_none());
}

/// An ASCII PLY of floats with these columns and rows.
fn ply_of(columns: &str, rows: &[&[f32]]) -> Result<(Scene, Report)> {
    ply::read_bytes(&ascii_ply(columns, rows))
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
    assert!(report.notes.len() == 1, "{:?}", report.notes);
    // Points without scales are no model.
    says(ply_of("x y z red green blue", &[&[0.0; 6]]), "a plain point cloud");
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
    assert!(report.notes.len() == 1, "{:?}", report.notes);
}

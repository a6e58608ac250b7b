//! One scene, many forms of its file: every one must read as the same bits.

mod common;

use common::{FORMATS, File, Property, bits, scene};
use gs_model::ply::{self, Format, Invalid, Parts, ReadOptions};
use gs_model::{Error, Scene};

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
fn forms(format: Format, sh_degree: u8) -> Vec<(String, File)> {
    let plain = File::inria(format, sh_degree);
    let mut all = Vec::new();
    let mut add = |name: &str, change: &dyn Fn(&mut File)| {
        let mut file = plain.clone();
        change(&mut file);
        all.push((format!("{format}, degree {sh_degree}, {name}"), file));
    };
    let extra = |kind, list| Property { name: format!("extra_{kind}_{list}"), kind, list };
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
            f.properties.insert(5 * i, extra(kind, false));
        }
    });
    add("lists among the properties", &|f| {
        f.properties.insert(0, extra("short", true));
        f.properties.insert(9, extra("double", true));
        f.properties.push(extra("uchar", true));
    });
    add("other elements before", &|f| f.faces_before = 6);
    add("other elements before and after", &|f| (f.faces_before, f.faces_after) = (3, 5));
    add("CRLF", &|f| f.line_end = "\r\n");
    add("CR", &|f| f.line_end = "\r");
    all
}

#[test]
fn every_form_reads_as_the_same_bits() {
    for format in FORMATS {
        for degree in 0..4 {
            let scene = scene(7, degree);
            for (name, file) in forms(format, degree) {
                let (bytes, _) = file.bytes(&scene);
                let (back, report) =
                    ply::read_bytes(&bytes).unwrap_or_else(|e| panic!("{name}: {e}"));
                assert_eq!(bits(&back), bits(&scene), "{name}");
                assert_eq!((back.sh_degree, report.sh_degree), (degree, degree), "{name}");
                assert_eq!((report.gaussians_in_file, report.gaussians), (7, 7), "{name}");
                assert_eq!((report.format, report.trailing_bytes), (format, 0), "{name}");
                let unknown: Vec<&str> = file
                    .properties
                    .iter()
                    .filter_map(|p| p.name.starts_with("extra").then_some(p.name.as_str()))
                    .collect();
                assert_eq!(report.unknown_properties, unknown, "{name}");
                let others = usize::from(file.faces_before > 0) + usize::from(file.faces_after > 0);
                assert_eq!(report.skipped_elements.len(), others, "{name}");
                assert_eq!(report.comments, ["made by a test"], "{name}");
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
    for format in FORMATS {
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
        let mut ours = Vec::new();
        ply::write_to(&mut ours, &scene).unwrap();
        let (mut theirs, _) = File::inria(Format::BinaryLittleEndian, degree).bytes(&scene);
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
            let mut bytes = Vec::new();
            ply::write_to(&mut bytes, &scene).unwrap();
            let back = ply::read_bytes(&bytes).unwrap().0;
            (bytes, back)
        });
        assert_eq!(bits(&outcome.1), bits(&scene), "{threads} threads");
        assert!(one.get_or_insert_with(|| outcome.clone()).0 == outcome.0, "{threads} threads");
    }
}

#[test]
fn no_gaussians_is_a_scene() {
    for format in FORMATS {
        let (bytes, _) = File::inria(format, 2).bytes(&scene(0, 2));
        let (back, _) = ply::read_bytes(&bytes).unwrap();
        assert!(back.is_empty() && back.sh_degree == 2);
    }
    let mut bytes = Vec::new();
    ply::write_to(&mut bytes, &Scene::default()).unwrap();
    assert!(ply::read_bytes(&bytes).unwrap().0.is_empty());
}

#[test]
fn bytes_after_the_end_are_reported() {
    for format in FORMATS {
        let (mut bytes, _) = File::inria(format, 0).bytes(&scene(2, 0));
        bytes.extend(b"more\n\n");
        let (back, report) = ply::read_bytes(&bytes).unwrap();
        assert_eq!(back.len(), 2);
        let expected = if format == Format::Ascii { 4 } else { 6 };
        assert_eq!(report.trailing_bytes, expected, "{format}");
    }
}

#[test]
fn what_is_missing_is_named() {
    let scene = scene(1, 1);
    // Without scale_2 alone it is a model of 2D Gaussians.
    for gone in ["x", "f_dc_1", "opacity", "scale_1", "rot_3"] {
        let mut file = File::inria(Format::BinaryLittleEndian, 1);
        file.properties.retain(|p| p.name != gone);
        match ply::read_bytes(&file.bytes(&scene).0) {
            Err(Error::PlyMissingProperty { properties, .. }) => assert_eq!(properties, gone),
            other => panic!("{gone}: {other:?}"),
        }
    }
    // The right number of f_rest, but not the right ones.
    let mut file = File::inria(Format::BinaryLittleEndian, 1);
    let last = file.properties.iter_mut().find(|p| p.name == "f_rest_8").unwrap();
    last.name = "f_rest_9".into();
    match ply::read_bytes(&file.bytes(&common::scene(0, 1)).0) {
        Err(Error::PlyMissingProperty { properties, .. }) => assert_eq!(properties, "f_rest_8"),
        other => panic!("{other:?}"),
    }
}

/// Files that are read in parts: several parts, rows across their borders, trailing bytes.
#[test]
fn large_files_are_read_as_small_ones_are() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("large.ply");
    let scene = common::scene(90_000, 3);
    let mut bytes = Vec::new();
    gs_model::ply::write_to(&mut bytes, &scene).unwrap();
    assert!(bytes.len() > 16 << 20);
    std::fs::write(&path, &bytes).unwrap();
    let (whole, _) = gs_model::ply::read_bytes(&bytes).unwrap();
    let (parts, report) = gs_model::ply::read(&path).unwrap();
    assert!(parts == whole && parts == scene);
    assert_eq!((report.file_bytes, report.trailing_bytes), (bytes.len(), 0));
    let (model, _) = gs_model::model::read(&path, &Default::default()).unwrap();
    assert!(model == scene);
    bytes.extend([1, 2, 3]);
    std::fs::write(&path, &bytes).unwrap();
    let (again, report) = gs_model::ply::read(&path).unwrap();
    assert!(again == scene);
    assert_eq!((report.file_bytes, report.trailing_bytes), (bytes.len(), 3));
    // Cut short, the error is that of the reader of whole files.
    std::fs::write(&path, &bytes[..bytes.len() - 100]).unwrap();
    let error = gs_model::ply::read(&path).unwrap_err();
    assert!(error.to_string().contains("row 89999 is not whole"), "{error}");
}

/// Normals and other columns were lost without a word.
#[test]
fn lost_normals_and_other_columns_are_reported() {
    for format in FORMATS {
        for (name, mut file) in forms(format, 1) {
            let has_normals = file.properties.iter().any(|p| p.name == "nx");
            for (normal, expected) in [(0.0, 0), (-0.0, 3), (0.5, 3)] {
                file.normal = normal;
                let (scene, report) = ply::read_bytes(&file.bytes(&scene(7, 1)).0).unwrap();
                assert_eq!(scene.len(), 7);
                let expected = if has_normals { expected } else { 0 };
                assert_eq!(report.nonzero_normals, expected, "{name}, {normal}");
                let lost = report.properties_not_kept();
                assert_eq!(lost.contains(&"ny"), expected > 0, "{name}, {normal}: {lost:?}");
                for unknown in &report.unknown_properties {
                    assert!(lost.contains(&unknown.as_str()), "{name}: {lost:?}");
                }
            }
        }
    }
}

/// The same in a file that is large enough to be read in parts.
#[test]
fn lost_normals_are_reported_of_large_files() {
    let scene = scene(20_000, 3);
    let mut file = File::inria(Format::BinaryLittleEndian, 3);
    file.normal = 1.0;
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.ply");
    let (bytes, _) = file.bytes(&scene);
    assert!(bytes.len() > 4 << 20);
    std::fs::write(&path, bytes).unwrap();
    let (back, report) = ply::read(&path).unwrap();
    assert_eq!(bits(&back), bits(&scene));
    assert_eq!(report.nonzero_normals, 10_000);
    assert_eq!(report.properties_not_kept(), ["nx", "ny", "nz"]);
}

#[test]
fn a_file_in_parts_is_the_whole_file() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("model.ply");
    let mut whole = scene(30_000, 3);
    ply::write(&path, &whole).unwrap();
    let read = |options: &ReadOptions| -> gs_model::Result<Vec<Scene>> {
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
    let drop = ReadOptions { invalid: Invalid::Drop, ..Default::default() };
    assert_eq!(read(&drop).unwrap().iter().map(Scene::len).sum::<usize>(), 29_997);
    std::fs::write(&path, "ply\nformat ascii 1.0\nelement vertex 0\nend_header\n").unwrap();
    assert!(Parts::open(&path, &drop).unwrap().is_none());
}

//! SOG: archives of both versions, made by hand and by other tools.

mod common;

use common::{assert_within, fixture, read, room, says, written, zipped};
use gs_model::{Format, ReadOptions, Scene, model, morton_order, sog};

/// A lossless WebP image of one row.
fn webp(width: u32, rgba: &[u8]) -> Vec<u8> {
    let mut file = Vec::new();
    let encoder = image_webp::WebPEncoder::new(&mut file);
    encoder.encode(rgba, width, 1, image_webp::ColorType::Rgba8).unwrap();
    file
}

/// A SOG of version 1 with two Gaussians of degree 1; in its `meta.json`, `to` replaces `from`.
fn sog_1(from: &str, to: &str) -> Vec<u8> {
    let meta = r#"{
        "means": {"shape": [2, 3], "dtype": "float32", "mins": [-1, 0, 0], "maxs": [1, 2, 4], "files": ["l", "u"]},
        "scales": {"shape": [2, 3], "mins": [-10, -9, -8], "maxs": [-5, -4, -3], "files": ["s"]},
        "quats": {"shape": [2, 4], "encoding": "quaternion_packed", "files": ["q"]},
        "sh0": {"shape": [2, 1, 4], "mins": [-2, -1, 0, -5], "maxs": [3, 4, 5, 10], "files": ["c"]},
        "shN": {"shape": [2, 9], "mins": -0.5, "maxs": 0.52, "quantization": 8, "files": ["p", "i"]}}"#;
    assert!(meta.contains(from));
    // The second entry of the palette: coefficients 0, 51 and 255 of 255 in red.
    let mut palette = vec![255; 4 * 64 * 3];
    palette[12..24].copy_from_slice(&[0, 0, 0, 255, 51, 0, 0, 255, 255, 0, 0, 255]);
    zipped(&[
        ("meta.json", meta.replace(from, to).into_bytes()),
        ("l", webp(2, &[255, 0, 0, 255, 255, 255, 255, 255])),
        ("u", webp(2, &[127, 0, 0, 255, 255, 255, 255, 255])),
        ("s", webp(2, &[0, 51, 255, 255, 0, 0, 0, 255])),
        ("q", webp(2, &[255, 128, 128, 253, 128, 128, 128, 252])),
        ("c", webp(2, &[0, 51, 255, 51, 255, 255, 255, 255])),
        ("p", webp(192, &palette)),
        ("i", webp(2, &[1, 0, 0, 255, 0, 0, 0, 255])),
    ])
}

#[test]
fn bytes_of_a_sog_of_version_1_are_steps_between_bounds() {
    let (scene, report) = read("a.sog", &sog_1("means", "means")).unwrap();
    assert_eq!((&report.form[..], scene.len(), scene.sh_degree), ("SOG, version 1", 2, 1));
    let close = |a: f32, b: f64| assert!((f64::from(a) - b).abs() < 1e-5, "{a} is not {b}");
    // 127 * 256 + 255 of 65535, just below the middle of -1 to 1; sign(v) (exp(|v|) - 1).
    close(scene.means[0][0], -1.0 / 65535.0);
    close(scene.means[1][2], libm::expm1(4.0));
    scene.log_scales[0].into_iter().zip([-10.0, -8.0, -3.0]).for_each(|(a, b)| close(a, b));
    // x was left out; w is 1 / sqrt(2).
    close(scene.rotations[0][0], std::f64::consts::FRAC_1_SQRT_2);
    assert!(scene.rotations[0][1] > 0.7 && scene.rotations[1][0] > 0.99);
    scene.sh_of(0)[0].into_iter().zip([-2.0, 0.0, 5.0]).for_each(|(a, b)| close(a, b));
    assert_eq!(scene.opacity_logits, [-2.0, 10.0]);
    for (rgb, red) in scene.sh_of(0)[1..].iter().zip([-0.5, -0.296, 0.52]) {
        close(rgb[0], red);
        close(rgb[1], -0.5);
    }
    close(scene.sh_of(1)[3][2], 0.52);
}

#[test]
fn a_hostile_meta_of_a_sog_is_refused() {
    let not_json = "not the JSON of a SOG's meta.json";
    for (from, to, said) in [
        ("[2, 3], \"dtype\"", "[], \"dtype\"", "meta.json: means: its shape is empty"),
        ("[2, 3], \"dtype\"", "[-2, 3], \"dtype\"", not_json),
        ("[2, 3], \"mins\"", "[9, 3], \"mins\"", "different shapes"),
        ("[-1, 0, 0]", "[-1, 0]", not_json),
        ("[-1, 0, 0]", "[1e400, 0, 0]", "number out of range"),
        ("[-5, -4, -3]", "[1e39, -4, -3]", "number out of range"),
        ("[2, ", "[9, ", "l: it has 2 pixels for 9 Gaussians"),
        ("[2, 9]", "[2, 10]", "shN: its shape is not N by 9, 24 or 45"),
        ("[2, 9]", "[2, 24]", "p: it is 192 pixels wide, not 512"),
        ("[\"s\"]", "[\"../s\"]", "not the name of a file beside meta.json"),
        ("[\"s\"]", "[\"gone\"]", "gone: it is not in the archive"),
        ("\"means\"", "\"version\": 3, \"means\"", "SOG version 3: not read (1 and 2 are)"),
        ("\"means\"", "\"version\": 2, \"means\"", not_json),
    ] {
        says(read("a.sog", &sog_1(from, to)), said);
    }
}

#[test]
fn a_sog_says_whether_a_model_is_antialiased() {
    for (says, antialiased) in [
        ("\"model\": \"antialiased\", ", true),
        ("\"antialias\": true, ", true),
        ("\"model\": \"default\", ", false),
        ("\"antialias\": false, ", false),
        ("", false),
    ] {
        let sog = sog_1("\"means\": {", &format!("{says}\"means\": {{"));
        assert_eq!(read("a.sog", &sog).unwrap().0.antialiased, antialiased, "{says}");
    }
}

/// A SOG of version 2 with one Gaussian of degree 0 and this codebook of scales. Its scales have the bytes 0, 2, 4.
fn sog_2(scales: &str) -> Vec<u8> {
    let meta = format!(
        r#"{{"version": 2, "count": 1, "asset": {{"generator": "a"}}, "origin": "null",
        "means": {{"mins": [-1, 0, 0], "maxs": [1, 2, 4], "files": ["l", "u"]}},
        "scales": {{"codebook": {scales}, "files": ["s"]}},
        "quats": {{"files": ["q"]}},
        "sh0": {{"codebook": [0, 1, 2], "files": ["c"]}}}}"#
    );
    zipped(&[
        ("meta.json", meta.into_bytes()),
        ("l", webp(1, &[255; 4])),
        ("u", webp(1, &[127, 0, 0, 255])),
        ("s", webp(1, &[0, 2, 4, 255])),
        ("q", webp(1, &[128, 128, 128, 252])),
        ("c", webp(1, &[0, 1, 2, 51])),
    ])
}

#[test]
fn missing_entries_of_a_codebook_are_read_from_their_neighbours() {
    let scales =
        |codebook| read("a.sog", &sog_2(codebook)).map(|(s, r)| (s.log_scales[0], r.notes));
    let (plain, notes) = scales("[-9, -8, -7, -6, -5]").unwrap();
    assert_eq!(plain, [-9.0, -7.0, -5.0]);
    assert_eq!(notes, ["\"origin\" of meta.json is not used"]);
    // The first as PlayCanvas has it: the second less a 4th of the range of the others.
    for codebook in
        ["[null, -8, -7, -6, -4]", "[NaN, -8, -7, -6, -4]", "[-Infinity, -8, -7, -6, -4]"]
    {
        let (first, notes) = scales(codebook).unwrap();
        assert_eq!(first, [-9.0, -7.0, -4.0]);
        assert!(
            notes.join("; ").contains("1 entry of the codebook of scales missing"),
            "{notes:?}"
        );
    }
    let (others, _) = scales("[-9, -8, null, null, null]").unwrap();
    assert_eq!(others, [-9.0, -7.75, -7.25]);
    let (inner, _) = scales("[-9, null, null, -6, -5]").unwrap();
    assert_eq!(inner, [-9.0, -7.0, -5.0]);
    says(scales("[null, null, null]"), "meta.json: scales: its codebook has no number");
    says(scales("[]"), "its codebook has no number");
}

#[test]
fn a_sog_is_the_same_in_a_folder_and_in_an_archive() {
    let dir = tempfile::tempdir().unwrap();
    let path = fixture("formats/small.sog");
    let file = std::fs::File::open(&path).unwrap();
    zip::ZipArchive::new(file).unwrap().extract(dir.path()).unwrap();
    let (bundled, _) = model::read(path, &ReadOptions::default()).unwrap();
    let (unbundled, report) =
        model::read(dir.path().join("meta.json"), &ReadOptions::default()).unwrap();
    assert_eq!(report.format, "sog");
    assert_eq!(unbundled, bundled);
    std::fs::remove_file(dir.path().join("quats.webp")).unwrap();
    says(
        model::read(dir.path().join("meta.json"), &ReadOptions::default()),
        "quats.webp: cannot read: ",
    );
}

/// A scene as it is written: its Gaussians in Morton order.
fn ordered(scene: &Scene) -> Scene {
    scene.select(&morton_order(&scene.means))
}

#[test]
fn a_sog_comes_back_within_its_steps() {
    for degree in 0..=3 {
        let scene = ordered(&room(3, degree));
        let (back, report) = read("a.sog", &written("sog", &scene)).unwrap();
        assert_eq!((&report.form[..], report.notes), ("SOG, version 2", vec![]));
        // Rotations are a byte for each component. The largest errors of scales and colours are those of single far
        // ones; of SH coefficients 2048 sets stand for 3667, and fit best what shows most.
        let bounds = |sh: f32| [2e-4, 4e-5, 0.05, 2e-3, 0.01, sh * f32::from(degree)];
        let what = format!("degree {degree}");
        assert_within(&what, &scene, &back, bounds(0.16));
        let half = shown_half(&scene);
        assert_within(&what, &scene.select(&half), &back.select(&half), bounds(0.024));
        let error = shown_sh_error(&scene, &back);
        assert!(error < 0.006, "degree {degree}: {error}");
    }
}

/// The root of what pictures show of a Gaussian: opacity times area.
fn shown(scene: &Scene, i: usize) -> f32 {
    let [x, y, z] = scene.log_scales[i];
    let log_area = x + y + z - x.min(y).min(z);
    (libm::expf(log_area) / (1.0 + libm::expf(-scene.opacity_logits[i]))).sqrt()
}

/// The half of the Gaussians that shows most.
fn shown_half(scene: &Scene) -> Vec<usize> {
    let mut all: Vec<usize> = (0..scene.len()).collect();
    all.sort_by(|&i, &k| shown(scene, k).total_cmp(&shown(scene, i)));
    all.truncate(scene.len() / 2);
    all
}

/// Root of the mean squared error of SH coefficients, weighted by [`shown`].
fn shown_sh_error(a: &Scene, b: &Scene) -> f32 {
    let (mut sum, mut weights) = (0.0, 0.0);
    for i in 0..a.len() {
        let numbers = a.sh_of(i).as_flattened().iter().zip(b.sh_of(i).as_flattened());
        sum += shown(a, i) * numbers.map(|(x, y)| (x - y) * (x - y)).sum::<f32>();
        weights += shown(a, i) * (3 * a.sh_len()) as f32;
    }
    (sum / weights).sqrt()
}

#[test]
fn small_scenes_are_held_exactly_but_for_rotations_and_opacities() {
    // A codebook has an entry for each number, a palette one for each power of two of Gaussians.
    for n in [1, 2, 64] {
        let scene = ordered(&common::mild(n, 3));
        let scene = Scene { antialiased: n == 2, ..scene };
        let (back, _) = read("a.sog", &written("sog", &scene)).unwrap();
        assert_within(&format!("{n}"), &scene, &back, [2e-4, 4e-5, 1e-6, 2e-3, 1e-6, 2e-2]);
        assert_eq!(back.antialiased, scene.antialiased);
    }
}

#[test]
fn a_chunk_keeps_its_order_and_is_smaller() {
    let scene = room(3, 3);
    let size = |files: &sog::Files| files.iter().map(|(_, bytes)| bytes.len()).sum::<usize>();
    let files = sog::files_of_chunk("0-1", &scene, 0).unwrap();
    let coarser = sog::files_of_chunk("1-0", &scene, 1).unwrap();
    assert!(size(&coarser) < size(&files));
    assert!(size(&files) * 2 < size(&sog::files("a", &scene).unwrap()));
    let (back, _) = read("a.sog", &zipped(&files)).unwrap();
    assert_within("chunk", &scene, &back, [2e-3, 4e-3, 0.061, 0.02, 0.0072, 0.5]);
    for degree in 0..=3 {
        let mut one = scene.select(&[7]);
        one.cut_sh(degree);
        let files = sog::files_of_chunk("a", &one, 1).unwrap();
        let (back, _) = read("a.sog", &zipped(&files)).unwrap();
        assert_eq!((back.len(), back.sh_degree), (1, degree));
        assert!((0..3).all(|k| (back.sh_of(0)[0][k] - one.sh_of(0)[0][k]).abs() < 0.041));
    }
    // Coarse levels have no higher coefficients.
    let mut plain = scene.clone();
    (0..scene.len()).for_each(|i| plain.sh[16 * i + 1..16 * (i + 1)].fill([0.0; 3]));
    assert_eq!(sog::files_of_chunk("a", &plain, 1).unwrap().len(), 6);
}

#[test]
fn any_number_of_threads_writes_the_same_sog() {
    let scene = room(2, 2);
    let write = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| written("sog", &scene))
    };
    let one = write(1);
    assert!(one == write(2) && one == write(8));
}

#[test]
fn a_scene_that_sog_cannot_hold_is_refused() {
    let refused = |scene: &Scene, why| {
        says(Format::named("sog").unwrap().write_to("a.sog", Vec::new(), scene), why);
    };
    refused(&Scene::default(), "the model is empty");
    let mut scene = room(100, 1);
    scene.log_scales[5][1] = f32::NEG_INFINITY;
    refused(&scene, "SOG holds no number that is infinite or NaN");
    // What a folder holds is several files.
    let json = Format::of_name("folder/meta.json").unwrap();
    says(json.write_to("b/meta.json", Vec::new(), &room(100, 1)), "name a .sog for one file");
    let names: Vec<&str> = sog::files("a", &room(100, 0)).unwrap().iter().map(|f| f.0).collect();
    assert_eq!(
        names,
        ["means_l.webp", "means_u.webp", "quats.webp", "scales.webp", "sh0.webp", "meta.json"]
    );
}

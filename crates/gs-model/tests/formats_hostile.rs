//! Broken and hostile files of the formats beside PLY: a typed error of one line, never a panic, never
//! memory far beyond the file's size.

mod common;

use common::{fixture, is_broken, read, says};
use gs_model::gltf::Compressed;
use gs_model::{Codec, Format, ReadOptions, Scene, model};
use proptest::prelude::*;

const NAMES: [&str; 7] = [
    "small.compressed.ply",
    "small.ksplat",
    "small.sog",
    "small.glb",
    "tiny.1.ksplat",
    "a.spz",
    "a.splat",
];

/// A file of that name: one of other tools, or one that is written here.
fn file(name: &str) -> Vec<u8> {
    if name.starts_with('a') {
        written(name, &common::scene(40, 1))
    } else {
        std::fs::read(fixture("formats").join(name)).unwrap()
    }
}

fn written(name: &str, scene: &Scene) -> Vec<u8> {
    let mut file = Vec::new();
    Format::of_name(name).unwrap().write_to(name, &mut file, scene).unwrap();
    file
}

#[test]
fn files_that_are_cut_short_are_typed_errors() {
    for name in NAMES {
        let file = file(name);
        let (whole, _) = read(name, &file).unwrap();
        // Every length near the ends, and some between.
        let lengths = (0..file.len()).filter(|&n| n < 700 || n % 97 == 0 || n + 300 > file.len());
        for len in lengths {
            match read(name, &file[..len]) {
                Err(error) => {
                    assert!(is_broken(&error) && error.to_string().starts_with(name), "{error}");
                    assert!(!gs_model::chain(&error).contains("{ "), "{error}");
                }
                // Padding may be missing, and a .splat is any number of rows.
                Ok((scene, _)) => assert!(scene == whole || name == "a.splat", "{name} {len}"),
            }
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(600))]

    #[test]
    fn changed_bytes_are_errors_or_scenes(
        which in 0..NAMES.len(),
        changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6),
        in_head in any::<bool>(),
    ) {
        let name = NAMES[which];
        let mut file = file(name);
        let reach = if in_head { file.len().min(1200) } else { file.len() };
        for (at, byte) in changes {
            file[at.index(reach)] = byte;
        }
        match read(name, &file) {
            Ok((scene, _)) => scene.validate().unwrap(),
            Err(error) => prop_assert!(is_broken(&error), "{}", error),
        }
    }

    #[test]
    fn a_glb_comes_back(n in 1usize..40, degree in 0u8..=3, seed in any::<u64>()) {
        let scene = random(n, degree, seed);
        let (back, _) = read("a.glb", &written("a.glb", &scene)).unwrap();
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
    with_json(&written("a.glb", &common::scene(3, 1)), &[(from, to)])
}

/// A `.glb` with things in its JSON replaced.
fn with_json(file: &[u8], changes: &[(&str, &str)]) -> Vec<u8> {
    let len = u32::from_le_bytes(file[12..16].try_into().unwrap()) as usize;
    let mut json = String::from_utf8(file[20..20 + len].to_vec()).unwrap();
    for (from, to) in changes {
        assert!(json.contains(from), "{json}");
        json = json.replacen(from, to, 1);
    }
    let mut changed = json.into_bytes();
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
    let said =
        |from: &str, to: &str, needle: &str| says(read("a.glb", &glb_with(from, to)), needle);
    let space = "\"colorSpace\":\"srgb_rec709_display\"";
    said("ellipse", "cube", "kernel \"cube\"");
    said("srgb_rec709_display", "lin_rec709_display", "colour space");
    let compressed = format!("{space},\"extensions\":{{\"KHR_spz_2\":{{}}}}");
    said(space, &compressed, "compressed (KHR_spz_2)");
    said(space, "\"colorSpace\":7", "not the JSON of a glTF file: ");
    let node = "\"nodes\":[{\"mesh\":0}]";
    let turned = "\"nodes\":[{\"children\":[1],\"translation\":[0,1,0]},{\"mesh\":0}]";
    let flat = turned.replace("\"translation\":[0,1,0]", "\"scale\":[1,1,2]");
    said(node, &flat, "node 1: it, or a node above it, shears, scales its axes apart");
    said(node, &turned.replace("[1]", "[1,0]"), "node 0: it is below two nodes, or below itself");
    let instanced = "\"nodes\":[{\"mesh\":0,\"extensions\":{\"EXT_mesh_gpu_instancing\":{}}}]";
    said(node, instanced, "node 0: it has EXT_mesh_gpu_instancing, which is not read");
    let projection = format!("{space},\"projection\":\"fisheye\"");
    said(space, &projection, "projection \"fisheye\"");
    // A mesh that is shown a thousand times over.
    let many = vec!["{\"mesh\":0}"; 1000].join(",");
    let roots: Vec<String> = (0..1000).map(|k| k.to_string()).collect();
    let file = glb_with(node, &format!("\"nodes\":[{many}]"));
    let text = String::from_utf8_lossy(&file);
    assert!(text.contains("\"scenes\""));
    let said_of_many = with_json(
        &file,
        &[(
            "\"scenes\":[{\"nodes\":[0]}]",
            &format!("\"scenes\":[{{\"nodes\":[{}]}}]", roots.join(",")),
        )],
    );
    says(read("a.glb", &said_of_many), "show the same meshes too often");
    let required = "\"extensionsRequired\":[\"KHR_draco_mesh_compression\"],\"extensionsUsed\"";
    said("\"extensionsUsed\"", required, "requires KHR_draco_mesh_compression");
    said("\"mode\":0", "\"mode\":1", "POINTS");
    said("\"count\":3", "\"count\":9999999999", "more than the file holds");
    said("\"count\":3", "\"count\":2", "different lengths");
    said("KHR_gaussian_splatting:SCALE", "SCALE", "SCALE: it is missing");
    said("SH_DEGREE_1_COEF_2", "SH_DEGREE_1_COEF_5", "COEF_2: it is missing");
    // The same primitive a hundred times over.
    let file = glb_with("\"mode\":0", "\"mode\":0");
    let text = String::from_utf8_lossy(&file).into_owned();
    let start = text.find("\"primitives\":[").unwrap() + 14;
    let end = text[start..].find("]}]").unwrap() + start;
    let one = &text[start..end];
    said(one, &vec![one; 100].join(","), "more Gaussians than the file has data for");
    // A transform that does nothing is none.
    let same = "\"nodes\":[{\"mesh\":0,\"scale\":[1,1,1],\"rotation\":[0,0,0,1]}]";
    assert_eq!(read("a.glb", &glb_with(node, same)).unwrap().0.len(), 3);
}

#[test]
fn compressed_gaussians_beyond_what_their_bytes_may_hold_need_the_callers_word() {
    static CODEC: Codec =
        Codec { extension: "TEST", most: |bytes| bytes, decode: |_, n| Ok(Scene::zeros(n, 0)) };
    let mut file = Vec::new();
    let bounds = [[0.0; 3]; 2];
    Compressed { extension: "TEST", data: &[0; 8], count: 9, sh_degree: 0, bounds }
        .write_to("a.glb", &mut file)
        .unwrap();
    let read = |max_gaussians| {
        let invalid = gs_model::Invalid::Drop;
        let options =
            ReadOptions { invalid, codec: Some(&CODEC), max_gaussians, ..Default::default() };
        model::read_named("a.glb", &file, &options).map(|(_, report)| report.gaussians_in_file)
    };
    for limit in [None, Some(8)] {
        says(read(limit), "more Gaussians than the file has data for");
    }
    assert_eq!(read(Some(9)).unwrap(), 9);
}

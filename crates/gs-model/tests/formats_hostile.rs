//! Broken and hostile files of the formats beside PLY: a typed error of one line, never a panic, never
//! memory far beyond the file's size.

mod common;

use common::{DROP, assert_within, fixture, gltf_of, is_broken, read, says, written};
use gs_model::gltf::CompressedGltf;
use gs_model::{Codec, Format, ReadOptions, Scene, model};
use proptest::prelude::*;
use serde_json::json;

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
        let format = Format::of_name(name).unwrap();
        written(format.name, &common::scene(40, 1))
    } else {
        std::fs::read(fixture("formats").join(name)).unwrap()
    }
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
        let (back, _) = read("a.glb", &written("glb", &scene)).unwrap();
        prop_assert_eq!((&back.means, &back.sh), (&scene.means, &scene.sh));
        assert_within("glb", &scene, &back, [0.0, 1e-7, 5e-6, 6e-8, 0.0, 0.0]);
        let norms = back.rotations.iter().map(|q| q.iter().map(|v| v * v).sum::<f32>());
        prop_assert!(norms.into_iter().all(|n| (n - 1.0).abs() < 1e-6));
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

#[test]
fn what_is_not_read_of_gltf_is_named() {
    let good = gltf_of(&written("glb", &common::scene(3, 1))).to_string();
    let with = |from: &str, to: &str| {
        assert!(good.contains(from), "{good}");
        good.replacen(from, to, 1)
    };
    let said = |from: &str, to: &str, needle: &str| {
        says(read("a.gltf", with(from, to).as_bytes()), needle);
    };
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
    said(space, &format!("{space},\"projection\":\"fisheye\""), "projection \"fisheye\"");
    let required = "\"extensionsRequired\":[\"KHR_draco_mesh_compression\"],\"extensionsUsed\"";
    said("\"extensionsUsed\"", required, "requires KHR_draco_mesh_compression");
    said("\"mode\":0", "\"mode\":1", "POINTS");
    said("\"count\":3", "\"count\":9999999999", "more than the file holds");
    said("\"count\":3", "\"count\":2", "different lengths");
    said("KHR_gaussian_splatting:SCALE", "SCALE", "SCALE: it is missing");
    said("SH_DEGREE_1_COEF_2", "SH_DEGREE_1_COEF_5", "COEF_2: it is missing");
    // A transform that does nothing is none.
    let same = "\"nodes\":[{\"mesh\":0,\"scale\":[1,1,1],\"rotation\":[0,0,0,1]}]";
    assert_eq!(read("a.gltf", with(node, same).as_bytes()).unwrap().0.len(), 3);
}

#[test]
fn gaussians_that_a_gltf_shows_again_and_again_are_refused() {
    let good = gltf_of(&written("glb", &common::scene(3, 1)));
    // A mesh that is shown a thousand times over.
    let mut shown = good.clone();
    shown["nodes"] = vec![json!({ "mesh": 0 }); 1000].into();
    shown["scenes"][0]["nodes"] = (0..1000).collect();
    says(read("a.gltf", shown.to_string().as_bytes()), "show the same meshes too often");
    // The same primitive a hundred times over.
    let mut shared = good;
    let one = shared["meshes"][0]["primitives"][0].clone();
    shared["meshes"][0]["primitives"] = vec![one; 100].into();
    let said = "more Gaussians than the file has data for";
    says(read("a.gltf", shared.to_string().as_bytes()), said);
}

#[test]
fn compressed_gaussians_beyond_what_their_bytes_may_hold_need_the_callers_word() {
    static CODEC: Codec =
        Codec { extension: "TEST", most: |bytes| bytes, decode: |_, n| Ok(Scene::zeros(n, 0)) };
    let mut file = Vec::new();
    let bounds = [[0.0; 3]; 2];
    CompressedGltf { extension: "TEST", data: &[0; 8], count: 9, sh_degree: 0, bounds }
        .write_to("a.glb", &mut file)
        .unwrap();
    let read = |max_gaussians| {
        let options = ReadOptions { codec: Some(&CODEC), max_gaussians, ..DROP };
        model::read_named("a.glb", &file, &options).map(|(_, report)| report.gaussians_in_file)
    };
    for limit in [None, Some(8)] {
        says(read(limit), "more Gaussians than the file has data for");
    }
    assert_eq!(read(Some(9)).unwrap(), 9);
}

//! What is given to readers of models and is none: the message says what it is, and what to do.

mod common;

use common::{gzip, read, says, written, zipped};

fn model() -> Vec<u8> {
    written("ply", &common::scene(5, 0))
}

/// An archive of one member.
fn archive(name: &str, bytes: &[u8]) -> Vec<u8> {
    zipped(&[(name, bytes.to_vec())])
}

#[test]
fn a_file_that_is_no_model_is_named_with_what_to_do() {
    let tar = [&[b'a'; 257][..], b"ustar\0"].concat();
    let cases: &[(&str, &[u8], &str)] = &[
        ("a.ply", b"version https://git-lfs.github.com/spec/v1\noid sha256:0\n", "git lfs pull"),
        ("a.ply", b"\n<!DOCTYPE html><html>", "a web page"),
        ("a.ply", b"<?xml version=\"1.0\"?><Error><Code>AccessDenied", "an XML document"),
        ("a.ply.bz2", b"BZh91AY", "unpack it"),
        ("a.ply", b"\xfd7zXZ\0\0", "unpack it"),
        ("a.ply.zst", b"\x28\xb5\x2f\xfd\0", "unpack it"),
        ("a", b"7z\xbc\xaf\x27\x1c", "unpack it"),
        ("a", b"Rar!\x1a\x07\0", "unpack it"),
        ("a.tar", &tar, "unpack it"),
        ("means_l.webp", b"RIFF\0\0\0\0WEBPVP8L", "a picture"),
        ("a.png", b"\x89PNG\r\n", "a picture"),
        ("a.jpg", b"\xff\xd8\xff\xe0", "a picture"),
        ("a.laz", b"LASF\0", "a point cloud"),
        ("a.e57", b"ASTM-E57", "a point cloud"),
        ("sparse/0/points3D.bin", b"\x05\0\0\0", "a point cloud"),
        ("a.obj", b"v 0 0 0\n", "a mesh"),
        ("a.fbx", b"Kaydara FBX Binary  ", "a mesh"),
        ("a.npy", b"\x93NUMPY\x01\0", "tensors"),
        ("a.ckpt", b"\x80\x02}", "tensors"),
        ("a.usdc", b"PXR-USDC", "an OpenUSD scene"),
        ("a.paper", b"paper\x01\x03", "cargo xtask paper-decode"),
    ];
    for (name, bytes, needle) in cases {
        says(read(name, bytes), &format!("{name}: is no model: it is "));
        says(read(name, bytes), needle);
    }
}

#[test]
fn archives_are_named_by_what_they_hold() {
    let ply = model();
    let luma = archive("point_cloud.ply", &ply);
    says(read("a.zip", &luma), "a zip archive that holds \"point_cloud.ply\"; unzip it");
    says(read("a.ply", &luma), "unzip it");
    let npz = archive("means.npy", b"\x93NUMPY");
    says(read("a.npz", &npz), "tensors");
    says(read("a.pt", &archive("archive/data.pkl", b"")), "tensors");
    says(read("a.usdz", &archive("a.usdc", b"")), "an OpenUSD scene");
    says(read("a.zip", &archive("notes.txt", b"")), "no SOG");
    says(read("a.ply.gz", &gzip(&ply)), "a PLY compressed by gzip and no SPZ; unpack it first");
    says(read("a.tgz", &gzip(&[0; 600])), "tar xzf");
}

#[test]
fn json_that_is_no_model_is_named() {
    let cases = [
        (
            r#"{"lodLevels": 2, "filenames": ["0_0/meta.json"], "tree": {}}"#,
            "such as \"0_0/meta.json\"",
        ),
        (r#"{"asset": {"version": "1.1"}, "geometricError": 1, "root": {}}"#, "3D Tiles"),
        (r#"{"means": {"shape": [9, 3]}, "scales": {}, "opacities": {}, "sh0": {}}"#, "gsplat"),
        (r#"{"camera_model": "OPENCV", "frames": []}"#, "--cameras"),
        (r#"[{"id": 0, "img_name": "a", "rotation": []}]"#, "--cameras"),
        (r#"{"splats": 3}"#, "it has \"splats\""),
    ];
    for (json, needle) in cases {
        for name in ["meta.json", "a"] {
            says(read(name, json.as_bytes()), needle);
        }
        says(read("meta.json", format!("\u{feff} {json}").as_bytes()), needle);
    }
}

#[test]
fn points_and_meshes_in_ply_files_are_no_models() {
    let points = "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\n\
                  property uchar red\nproperty uchar green\nproperty uchar blue\n";
    let cloud = format!("{points}end_header\n0 0 0 1 2 3\n");
    says(read("points3D.ply", cloud.as_bytes()), "point_cloud/iteration_N/point_cloud.ply");
    let mesh = format!(
        "{points}element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0 1 2 3\n3 0 0 0\n"
    );
    says(read("a.ply", mesh.as_bytes()), "a mesh of 1 faces");
}

#[test]
fn the_first_bytes_of_a_model_outweigh_its_name() {
    for name in ["a.splat", "a.ksplat", "a.spz", "a"] {
        assert_eq!(read(name, &model()).unwrap().1.format, "ply");
    }
}

/// The rows of a .splat may start with any byte, those of other files included.
#[test]
fn a_splat_is_read_whatever_its_first_bytes() {
    let mut file = written("splat", &common::mild(3, 0));
    for start in [&b"\x80\x02"[..], b"\xff\xd8\xff", b"PK", b"\x1f\x8b", b"{\"a", b"[12"] {
        file[..start.len()].copy_from_slice(start);
        assert_eq!(read("a.splat", &file).unwrap().0.len(), 3, "{start:?}");
    }
}

#[test]
fn early_files_of_other_tools_that_are_called_splat_are_named() {
    // A header of 1,024 bytes: version 0.0, the number of Gaussians.
    let mut early = vec![0; 1024 + 44 * 8];
    (early[8], early[32]) = (8, 1);
    says(read("old.splat", &early), "an early file of GaussianSplats3D");
    // The header of a .ksplat.
    let mut later = vec![0; 4096];
    later[1] = 1;
    assert_eq!(read("old.splat", &later).unwrap().1.format, "ksplat");
}

#[test]
fn a_sog_in_a_folder_of_its_archive_is_found() {
    let named = zipped(&[
        ("scene/meta.json", b"{\"version\": 2}".to_vec()),
        ("__MACOSX/scene/._meta.json", Vec::new()),
    ]);
    // Its meta.json is read.
    says(read("a.sog", &named), "meta.json");
    let elsewhere = archive("scene/other_meta.json", b"{}");
    says(read("a.sog", &elsewhere), "no SOG");
}

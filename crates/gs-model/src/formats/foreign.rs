//! What a file is that is no model: a sentence that names it and what to do. The table is here; readers that learn
//! more of a file add what they see.

use std::path::Path;

use crate::error::Error;
use crate::formats::Format;

/// Bytes of a file that tell what it is.
pub(crate) const START: usize = 4096;

/// Where a file starts with some bytes, and what it is then.
struct Signature {
    at: usize,
    bytes: &'static [u8],
    what: &'static str,
}

const fn signature(bytes: &'static [u8], what: &'static str) -> Signature {
    Signature { at: 0, bytes, what }
}

const UNPACK: &str = "a compressed archive; unpack it and name the model in it";
const PICTURE: &str =
    "a picture; gsvx reads models (of an unbundled SOG name the meta.json beside its pictures)";
const POINTS: &str = "a point cloud without Gaussians; train a model on it, and name the model";
const MESH: &str = "a mesh; gsvx reads models of Gaussians";
const USD: &str = "an OpenUSD scene; gsvx.from_usd of the Python package reads it, and gsvx.to_usd writes such files";
const TENSORS: &str = "tensors, such as a checkpoint of training; export the model from the trainer as PLY, or pass the \
                       arrays to gsvx.compress of the Python package";

/// Signatures of files that are no models.
const SIGNATURES: &[Signature] = &[
    signature(
        b"version https://git-lfs",
        "a pointer of Git LFS, not the file itself; fetch it: git lfs pull",
    ),
    signature(b"BZh", UNPACK),
    signature(b"\xfd7zXZ\0", UNPACK),
    signature(b"\x28\xb5\x2f\xfd", UNPACK),
    signature(b"\x04\x22\x4d\x18", UNPACK),
    signature(b"7z\xbc\xaf\x27\x1c", UNPACK),
    signature(b"Rar!\x1a\x07", UNPACK),
    Signature { at: 257, bytes: b"ustar", what: UNPACK },
    signature(b"\x89PNG", PICTURE),
    signature(b"\xff\xd8\xff", PICTURE),
    signature(b"GIF8", PICTURE),
    signature(b"II*\0", PICTURE),
    signature(b"MM\0*", PICTURE),
    signature(b"\x76\x2f\x31\x01", PICTURE),
    Signature { at: 8, bytes: b"WEBP", what: PICTURE },
    Signature { at: 4, bytes: b"ftyp", what: "a video or a picture; gsvx reads models" },
    signature(b"%PDF", "a PDF document; gsvx reads models"),
    signature(b"LASF", POINTS),
    signature(b"ASTM-E57", POINTS),
    signature(b"# .PCD", POINTS),
    signature(b"Kaydara FBX", MESH),
    signature(b"PXR-USDC", USD),
    signature(b"#usda", USD),
    signature(
        b"BLENDER",
        "a Blender file; export its Gaussians with the extension of gsvx for Blender",
    ),
    signature(
        b"paper\x01",
        "a stream of the paper's codec; cargo xtask paper-decode STREAM.paper OUT.ply opens it",
    ),
    signature(b"\x93NUMPY", TENSORS),
    signature(b"\x89HDF", TENSORS),
    signature(b"\x80\x02", TENSORS),
];

/// What files with these extensions are that no signature tells.
const EXTENSIONS: &[(&[&str], &str)] = &[
    (&["obj", "stl", "dae", "3ds", "off"], MESH),
    (&["xyz", "pts", "ptx", "csv"], POINTS),
    (&["safetensors", "pt", "pth", "ckpt", "npz", "npy"], TENSORS),
];

/// What a file of that name is that starts with these bytes, if it is known to be no model.
pub(crate) fn refuse(file: &Path, start: &[u8]) -> Option<Error> {
    let format = Format::of(file, start);
    // Files without a signature may start with anything, a short one of others included.
    let least = if format.is_some_and(|f| f.magic.is_empty()) { 4 } else { 0 };
    let here = |s: &&Signature| {
        s.bytes.len() >= least && start.get(s.at..).is_some_and(|rest| rest.starts_with(s.bytes))
    };
    let signed = SIGNATURES.iter().find(here).map(|s| s.what);
    let what = signed.or_else(|| markup(start)).or_else(|| {
        let name = file.file_name()?.to_string_lossy().to_ascii_lowercase();
        // COLMAP's files have no signature.
        if ["points3d.bin", "points3d.txt"].contains(&&*name) {
            return Some(POINTS);
        }
        let extension = name.rsplit_once('.')?.1;
        let known = EXTENSIONS.iter().find(|(names, _)| names.contains(&extension));
        known.filter(|_| format.is_none()).map(|(_, what)| *what)
    });
    what.map(|what| is(file, what))
}

/// The error of a file that is this.
pub(crate) fn is(file: &Path, what: &str) -> Error {
    Error::NoModel { file: file.to_owned(), what: what.to_owned() }
}

fn markup(start: &[u8]) -> Option<&'static str> {
    let start = start.strip_prefix(b"\xef\xbb\xbf").unwrap_or(start).trim_ascii_start();
    let text = start[..start.len().min(16)].to_ascii_lowercase();
    let has = |names: &[&str]| names.iter().any(|name| text.starts_with(name.as_bytes()));
    if has(&["<!doctype", "<html", "<head", "<body", "<script"]) {
        Some("a web page, not the file that it links to; download the file itself")
    } else if has(&["<?xml", "<error"]) {
        Some("an XML document, perhaps a server's error message; download the file again")
    } else {
        None
    }
}

/// What a zip archive with these members is, which is no SOG.
#[cfg(feature = "sog")]
pub(crate) fn zip(file: &Path, members: &[std::borrow::Cow<'_, str>]) -> Error {
    let ends = |ends: &[&str]| {
        let has = |name: &str| ends.iter().any(|e| name.to_ascii_lowercase().ends_with(e));
        let found = members.iter().find(|name| has(name));
        found.map(|name| crate::error::excerpt(name.as_bytes()))
    };
    if let Some(model) = ends(&[".ply", ".spz", ".splat", ".ksplat", ".sog", ".glb", ".gsvx"]) {
        return is(
            file,
            &format!("a zip archive that holds {model:?}; unzip it and name that file"),
        );
    }
    if ends(&["data.pkl", ".npy"]).is_some() {
        return is(file, TENSORS);
    }
    if ends(&[".usd", ".usda", ".usdc"]).is_some() {
        return is(file, USD);
    }
    let names = crate::error::excerpt(members[..members.len().min(3)].join(", ").as_bytes());
    is(file, &format!("a zip archive, but no SOG, which has a meta.json; it holds {names:?}"))
}

/// What a gzip file is that unpacks to something that starts with these bytes.
#[cfg(feature = "formats")]
pub(crate) fn gzip(file: &Path, unpacked: &[u8]) -> Error {
    let model = if unpacked.starts_with(b"ply") { "a PLY compressed" } else { "compressed" };
    is(
        file,
        &format!("{model} by gzip and no SPZ; unpack it first: gunzip, or tar xzf for a .tar.gz"),
    )
}

/// What JSON is that describes no model, by the names in its outermost object. `None` where it may be a model.
#[cfg(feature = "formats")]
pub(crate) fn json(file: &Path, bytes: &[u8]) -> Option<Error> {
    use serde::Deserialize;
    use serde::de::IgnoredAny;
    use std::collections::BTreeMap;

    #[derive(Deserialize)]
    struct FileList {
        filenames: Vec<String>,
    }

    let text = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes).trim_ascii_start();
    const CAMERAS: &str = "cameras, not a model; name the model, and give this file with --cameras";
    if text.starts_with(b"[") {
        let list =
            text.windows(10).take(START).any(|w| w == b"\"img_name\"" || w == b"\"rotation\"");
        return Some(is(file, if list { CAMERAS } else { "a list in JSON, not a model" }));
    }
    if !text.starts_with(b"{") {
        return None;
    }
    let keys: BTreeMap<String, IgnoredAny> = serde_json::from_slice(text).ok()?;
    let has = |name: &str| keys.contains_key(name);
    let what = if has("lodLevels") && has("filenames") {
        let named: Option<FileList> = serde_json::from_slice(text).ok();
        let first = named.and_then(|n| n.filenames.into_iter().next());
        let first = crate::error::excerpt(first.unwrap_or_else(|| "0/meta.json".into()).as_bytes());
        format!(
            "the index of a scene that PlayCanvas streams; its models are files beside it, such as {first:?}"
        )
    } else if has("root") && (has("geometricError") || has("asset")) {
        "the index of 3D Tiles; its models are the .glb files beside it".into()
    } else if has("opacities") && has("means") {
        "the index of gsplat's PngCompression; decompress it with gsplat, and export the model as PLY".into()
    } else if has("frames") || has("camera_model") {
        CAMERAS.into()
    } else if has("asset") || has("means") {
        return None;
    } else {
        let names: Vec<&str> = keys.keys().map(String::as_str).take(4).collect();
        let names = crate::error::excerpt(names.join(", ").as_bytes());
        format!("JSON, but neither the meta.json of a SOG nor glTF; it has {names:?}")
    };
    Some(is(file, &what))
}

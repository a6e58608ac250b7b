//! Small valid inputs of every target, made by the encoders and writers themselves.

use gpcc_lite::coder::RansEncoder;
use gpcc_lite::paper::predict::{Neighbours, encode_lossless};
use gpcc_lite::raht::Rows;
use gpcc_lite::{Octree, attribute, geometry};
use gpcc_lite::paper::rlgr;
use gs_model::ply;
use gsvx::EncodeOptions;
use std::num::NonZeroUsize;

use crate::codec::{self, plans};
use crate::common::{self, forge, scene};
use crate::{readers, streams as targets};
pub use testing::Rng;

/// A fuzz target.
pub struct FuzzTarget {
    /// Its name.
    pub name: &'static str,
    /// What it runs; returns whether the input was accepted.
    pub run: fn(&[u8]) -> bool,
    /// The longest input worth trying.
    pub max_len: usize,
    /// Its seeds. They panic if an encoder fails on its own fixture.
    pub seeds: fn() -> Vec<Vec<u8>>,
}

const fn target(
    name: &'static str,
    run: fn(&[u8]) -> bool,
    max_len: usize,
    seeds: fn() -> Vec<Vec<u8>>,
) -> FuzzTarget {
    FuzzTarget { name, run, max_len, seeds }
}

/// Runs the target of a name on an input.
///
/// # Panics
/// If a promise is broken.
pub fn run(name: &str, data: &[u8]) {
    let target = TARGETS.iter().find(|target| target.name == name);
    (target.expect("a target of the table").run)(data);
}

/// A seed with some of its bytes changed, or cut.
#[must_use]
pub fn mutated(seed: &[u8], rng: &mut Rng) -> Vec<u8> {
    let mut bytes = seed.to_vec();
    let mut below = |n: usize| (rng.bits() % n.max(1) as u64) as usize;
    for _ in 0..1 + below(4) {
        let at = below(bytes.len());
        match below(6) {
            0 => bytes.truncate(at),
            1 => bytes.insert(at, below(256) as u8),
            2 => bytes.iter_mut().skip(at).take(4).for_each(|byte| *byte = 0xff),
            _ => bytes.iter_mut().skip(at).take(1).for_each(|byte| *byte ^= 1 << below(8)),
        }
    }
    bytes
}

/// All targets.
pub const TARGETS: &[FuzzTarget] = &[
    target("ply", readers::ply, 2048, models),
    target("spz", readers::spz, 512, spz),
    target("splat", readers::splat, 256, || vec![vec![0], with(0, &[7; 32]), with(1, &[60; 64])]),
    target("compressed_ply", readers::compressed_ply, 2048, || {
        [(1, 0), (2, 0), (1, 3)].map(|(n, degree)| written("compressed-ply", n, degree)).into()
    }),
    target("ksplat", readers::ksplat, 384, ksplat),
    target("sog", readers::sog, 4096, sog),
    // More coefficients make JSON longer than what is worth trying.
    target("glb", readers::glb, 2048, || vec![written("glb", 2, 0), stream_in_glb()]),
    target("colmap", readers::colmap, 512, colmap),
    target("cameras", readers::cameras, 768, cameras),
    target("gsvx", targets::gsvx, 1024, whole),
    target("reader", targets::reader, 1024, in_pieces),
    target("chunk", targets::chunk, 640, chunks),
    target("lossless", targets::lossless, 768, lossless),
    target("geometry", codec::geometry, 256, octrees),
    target("attribute", codec::attribute, 512, attributes),
    target("coder", codec::coder, 256, coded),
    target("rlgr", codec::rlgr, 256, golomb),
    target("predict", codec::predict, 256, predicted),
    target("checkpoint", readers::checkpoint, 512, || vec![checkpoint()]),
];

fn with(byte: u8, rest: &[u8]) -> Vec<u8> {
    [&[byte], rest].concat()
}

fn values(n: usize, seed: u64) -> Vec<i32> {
    let mut r = Rng::seeded(seed);
    (0..n).map(|_| (r.bits() % 200) as i32 - 100 + ((r.bits() % 50 == 0) as i32) * 70_000).collect()
}

fn models() -> Vec<Vec<u8>> {
    let mut out = Vec::new();
    for (n, degree) in [(0, 0), (2, 0), (1, 3)] {
        let mut file = Vec::new();
        ply::write_to(&mut file, &scene(n, degree, 1)).expect("written to memory");
        out.push(with(0, &file));
        out.push(with(3, &file));
    }
    let names: [&str; 14] = [
        "x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "opacity", "scale_0", "scale_1", "scale_2",
        "rot_0", "rot_1", "rot_2", "rot_3",
    ];
    let header = |form: &str, kind: &str| {
        let properties: String = names.iter().map(|n| format!("property {kind} {n}\n")).collect();
        format!(
            "ply\nformat {form} 1.0\ncomment c\nelement vertex 2\n{properties}element face 1\n\
             property list uchar int vertex_indices\nend_header\n"
        )
    };
    let row = "0 1 2 .1 .2 .3 -1e0 -3 -3 -3 1 0 0 0\n";
    let face = "3 0 1 2\n";
    out.push(with(0, format!("{}{row}{row}{face}", header("ascii", "float")).as_bytes()));
    let mut big = header("binary_big_endian", "double").into_bytes();
    for _ in 0..2 {
        (0..14).for_each(|i| big.extend((f64::from(i) / 8.0).to_be_bytes()));
    }
    big.extend([1, 0, 0, 0, 0]);
    out.push(with(2, &big));
    out
}

fn spz() -> Vec<Vec<u8>> {
    let file = |version: u32, n: u32, degree: u8| {
        let sh = [0, 9, 24, 45][usize::from(degree)];
        let row = 9 + 1 + 3 + 3 + if version == 2 { 3 } else { 4 } + sh;
        let mut out = b"NGSP".to_vec();
        out.extend(version.to_le_bytes());
        out.extend(n.to_le_bytes());
        out.extend([degree, 12, 0, 0]);
        out.extend((0..n as usize * row).map(|i| (i * 37 % 251) as u8));
        out
    };
    let inner = [file(2, 2, 0), file(3, 1, 3), file(3, 0, 0), file(2, 1, 1)];
    let mut out: Vec<Vec<u8>> = inner.iter().map(|f| with(4, f)).collect();
    out.push(with(0, &readers::gzip(&inner[0])));
    out.push(written("spz", 2, 1));
    out
}

/// Strict options, then a file of that format with so many Gaussians of that SH degree.
fn written(format: &str, n: usize, degree: u8) -> Vec<u8> {
    let mut file = vec![0];
    let format = gs_model::Format::named(format).expect("a format of the table");
    format.write_to("<seed>", &mut file, &scene(n, degree, 1)).expect("written");
    file
}

/// A `.glb` that holds a stream.
fn stream_in_glb() -> Vec<u8> {
    let (_, data) = &streams()[2];
    let header = gsvx::Index::parse(data).expect("parsed").header;
    let file = gs_model::gltf::CompressedGltf {
        extension: gsvx::gltf::CODEC.extension,
        data,
        count: header.count as usize,
        sh_degree: header.sh_degree,
        bounds: [[0.0; 3], [1.0; 3]],
    };
    let mut out = vec![0];
    file.write_to("<seed>", &mut out).expect("written");
    out
}

/// The meaningful bytes of both headers, then the section: a row of each level.
fn ksplat() -> Vec<Vec<u8>> {
    let file = |level: u16| {
        let mut heads = vec![0; readers::KSPLAT_HEADS];
        heads[1] = 1;
        heads[4] = 1;
        heads[20..22].copy_from_slice(&level.to_le_bytes());
        let section = &mut heads[44..];
        let words =
            [(0, 1), (4, 1), (8, 256), (12, u32::from(level > 0)), (36, u32::from(level > 0))];
        for (at, word) in words {
            section[at..at + 4].copy_from_slice(&u32::to_le_bytes(word));
        }
        section[16..20].copy_from_slice(&5.0f32.to_le_bytes());
        section[20] = 12;
        let number = if level == 0 { 4 } else { 2 };
        let bucket = if level == 0 { vec![] } else { [vec![1, 0, 0, 0], vec![0; 12]].concat() };
        // 1.0 as float and as half float.
        let one: &[u8] = if level == 0 { &[0, 0, 0x80, 0x3f] } else { &[0, 0x3c] };
        let row = [&one.repeat(10)[..], &[9; 4]].concat();
        debug_assert_eq!(row.len(), 10 * number + 4);
        [&[0], &heads[..], &bucket, &row].concat()
    };
    [0, 1, 2].map(file).into()
}

/// A lossless WebP image of 4 x 4 pixels with alpha, written by splat-transform for two rotations.
const ROTATIONS: [u8; 52] = [
    82, 73, 70, 70, 44, 0, 0, 0, 87, 69, 66, 80, 86, 80, 56, 76, 31, 0, 0, 0, 47, 3, 192, 0, 16,
    23, 32, 16, 72, 113, 0, 131, 44, 22, 76, 118, 230, 111, 148, 217, 100, 204, 127, 192, 95, 96,
    12, 34, 250, 31, 1, 0,
];
/// A lossless WebP image of 960 x 1 pixels, written by splat-transform for a palette of degree 3.
const PALETTE: [u8; 128] = [
    82, 73, 70, 70, 120, 0, 0, 0, 87, 69, 66, 80, 86, 80, 56, 76, 107, 0, 0, 0, 47, 191, 3, 0, 16,
    181, 184, 13, 0, 128, 108, 98, 78, 118, 38, 219, 118, 82, 247, 255, 207, 124, 10, 131, 0, 0,
    146, 208, 221, 252, 159, 193, 176, 198, 86, 97, 219, 70, 202, 53, 247, 184, 255, 174, 76, 253,
    207, 253, 190, 230, 147, 1, 192, 248, 73, 208, 11, 129, 240, 31, 246, 91, 83, 168, 211, 175,
    240, 49, 10, 67, 127, 238, 240, 246, 44, 159, 115, 55, 114, 23, 4, 40, 88, 76, 222, 40, 242,
    121, 114, 1, 187, 189, 116, 212, 96, 220, 186, 45, 41, 31, 158, 60, 21, 228, 255, 2, 5, 0,
];

/// A `meta.json` of SOG version 1.
const VERSION_1: &str = r#"{"means":{"shape":[16,3],"mins":[0,-1,0],"maxs":[1,1,2],"files":["a","a"]},
"scales":{"shape":[16,3],"mins":[-9,-9,-9],"maxs":[-3,-3,-3],"files":["a"]},"quats":{"files":["a"]},
"sh0":{"shape":[16,1,4],"mins":[-1,-1,-1,-5],"maxs":[2,2,2,5],"files":["a"]},
"shN":{"shape":[16,45],"mins":-0.5,"maxs":0.5,"files":["b","a"]}}"#;

fn sog() -> Vec<Vec<u8>> {
    let numbers = vec!["0.5"; 256].join(",");
    let meta = |count: usize, numbers: &str, palette: bool| {
        let sh =
            format!(r#","shN":{{"count":9,"bands":3,"codebook":[{numbers}],"files":["b","a"]}}"#);
        let sh = if palette { &sh[..] } else { "" };
        format!(
            r#"{{"version":2,"count":{count},"means":{{"mins":[0,-1,0],"maxs":[1,1,2],"files":["a","a"]}},
            "scales":{{"codebook":[{numbers}],"files":["a"]}},"quats":{{"files":["a"]}},
            "sh0":{{"codebook":[{numbers}],"files":["a"]}}{sh}}}"#
        )
    };
    let packed = |options: u8, meta: &str| {
        let json = (meta.len() as u16).to_le_bytes();
        let a = (ROTATIONS.len() as u16).to_le_bytes();
        [&[options], &json[..], meta.as_bytes(), &a, &ROTATIONS, &PALETTE].concat()
    };
    // Where an index points at nothing, the Gaussian is invalid and is dropped.
    vec![
        packed(5, &meta(2, "1,2", false)),
        packed(5, &meta(16, "1,2,3", true)),
        packed(4, &meta(2, &numbers, false)),
        packed(5, VERSION_1),
    ]
}

fn colmap() -> Vec<Vec<u8>> {
    let split = |byte: u8, cameras: &[u8], images: &[u8]| {
        [&[byte], &(cameras.len() as u16).to_le_bytes()[..], cameras, images].concat()
    };
    let text = split(
        1,
        b"# c\n1 PINHOLE 64 48 50 50 32 24\n2 SIMPLE_PINHOLE 64 48 50 32 24\n",
        b"1 1 0 0 0 0 0 2 1 a.png\n1 2 3\n2 0.5 0.5 0.5 0.5 1 1 1 2 b c.png\n\n",
    );
    let mut cameras = 1u64.to_le_bytes().to_vec();
    cameras.extend([1, 0, 0, 0, 1, 0, 0, 0]);
    [64u64, 48].iter().for_each(|v| cameras.extend(v.to_le_bytes()));
    [50.0f64, 50.0, 32.0, 24.0].iter().for_each(|v| cameras.extend(v.to_le_bytes()));
    let mut images = 1u64.to_le_bytes().to_vec();
    images.extend(1u32.to_le_bytes());
    [1.0f64, 0., 0., 0., 0., 0., 2.].iter().for_each(|v| images.extend(v.to_le_bytes()));
    images.extend(1u32.to_le_bytes());
    images.extend(b"a.png\0");
    images.extend(1u64.to_le_bytes());
    images.extend([0; 24]);
    vec![text, split(0, &cameras, &images)]
}

fn cameras() -> Vec<Vec<u8>> {
    let inria = br#"[{"id":0,"img_name":"a","width":64,"height":48,"position":[0,0,1.5],
"rotation":[[1,0,0],[0,1,0],[0,0,1]],"fy":50.0,"fx":50}]"#;
    let nerf = br#"{"camera_angle_x":0.8,"w":64,"h":48.0,"k1":0,"frames":[{"file_path":"./a.png",
"transform_matrix":[[1,0,0,0],[0,1,0,0],[0,0,1,2],[0,0,0,1]]},{"file_path":"b","fl_x":40,"cx":3,
"transform_matrix":[[1,0,0,0],[0,1,0,0],[0,0,1,2]]}]}"#;
    vec![with(0, inria), with(1, nerf)]
}

/// Streams of few Gaussians in every mode, with their SH degrees.
fn streams() -> Vec<(u8, Vec<u8>)> {
    let base = EncodeOptions::default();
    let mut chunks = base;
    chunks.code.chunk_leaves = NonZeroUsize::new(3).expect("a positive number");
    let mut out = Vec::new();
    for (n, degree, options) in
        [(0, 0, &base), (1, 1, &base), (6, 0, &base), (3, 3, &base), (4, 1, &base), (9, 1, &chunks)]
    {
        let bytes = gsvx::encode(&scene(n, degree, 7), None, 20.0, options).expect("encoded").bytes;
        out.push((degree, bytes));
    }
    let outliers = gsvx::encode(&common::with_floaters(scene(12, 1, 7)).0, None, 20.0, &base);
    out.push((1, outliers.expect("encoded").bytes));
    out.push((0, levels()));
    for n in [0, 2] {
        out.push((0, gsvx::encode_lossless(&scene(n, 0, 3), n == 2).expect("encoded").bytes));
    }
    out
}

/// Two levels of detail. No encoder makes one for so few Gaussians: the coarse level is that of a stream
/// of its own.
fn levels() -> Vec<u8> {
    let mut uniform = EncodeOptions::default();
    uniform.prepare.leaves = gsvx::Leaves::Uniform { depth: 6 };
    let coded = |scene| gsvx::encode(&scene, None, 80.0, &uniform).expect("encoded").bytes;
    let fine = scene(9, 0, 7);
    let (mut index, mut layers) = forge::take_apart(&coded(fine.clone()));
    let (mut coarse, of_coarse) = forge::take_apart(&coded(fine.select(&[0, 4])));
    coarse.chunks[0].lod = 1;
    index.chunks.insert(0, coarse.chunks.remove(0));
    layers.splice(0..0, of_coarse);
    forge::assemble(&index, &layers)
}

fn whole() -> Vec<Vec<u8>> {
    let mut out = Vec::new();
    for (degree, bytes) in streams() {
        out.push([&[degree, 0], &bytes[..]].concat());
        out.push([&[3, 1], &bytes[..]].concat());
        // The head is whole.
        let end = gsvx::Index::parse(&bytes).expect("parsed").head_len as usize;
        let cut = end + (bytes.len() - end) / 2;
        out.push([&[8 | degree, 0], &bytes[..cut]].concat());
    }
    out
}

fn in_pieces() -> Vec<Vec<u8>> {
    let mut out = Vec::new();
    for (_, bytes) in streams() {
        out.push(with(0, &bytes));
        let pieces: [u16; 6] = [90, 5000, 0, 40, 30, 100];
        let pieces: Vec<u8> = pieces.iter().flat_map(|v| v.to_le_bytes()).collect();
        out.push([&[3], &pieces[..], &bytes].concat());
    }
    out
}

fn chunks() -> Vec<Vec<u8>> {
    let mut out = Vec::new();
    let options = EncodeOptions::default();
    for n in [20, 1, 7] {
        let bytes = gsvx::encode(&scene(n, 1, 7), None, 85.0, &options).expect("encoded").bytes;
        let (index, layers) = forge::take_apart(&bytes);
        let count = index.chunks[0].count as u16 - 1;
        let [base, sh] = &layers[0][..] else { continue };
        let len = base.len() as u16;
        let cell = index.chunks[0].first_cell.to_le_bytes();
        let head = [&count.to_le_bytes()[..], &cell, &len.to_le_bytes()].concat();
        out.push([&head[..], base, sh].concat());
    }
    out
}

fn lossless() -> Vec<Vec<u8>> {
    let mut out = Vec::new();
    for (n, degree, keep_order) in [(1, 0, true), (9, 0, false), (3, 1, true)] {
        let bytes = gsvx::encode_lossless(&scene(n, degree, 3), keep_order).expect("encoded").bytes;
        let (_, layers) = forge::take_apart(&bytes);
        out.push([&[degree], &(n as u16 - 1).to_le_bytes()[..], &layers[0][0]].concat());
    }
    out
}

fn octrees() -> Vec<Vec<u8>> {
    let code = |tree: &Octree| geometry::encode(tree).expect("encoded");
    let mut out: Vec<Vec<u8>> = codec::octrees().iter().map(|tree| with(0, &code(tree))).collect();
    out.push(with(1, &code(&codec::octrees()[3])));
    let far = (0..20u64).map(|i| gpcc_lite::Leaf { morton: i << 55, depth: 21 }).collect();
    out.push(with(1, &code(&Octree::of_points(21, far).expect("valid leaves"))));
    out
}

fn attributes() -> Vec<Vec<u8>> {
    let mut out = Vec::new();
    for (at, plan) in plans().iter().enumerate() {
        for channels in [1usize, 3, 8] {
            let v = values(plan.len() * channels, at as u64);
            let mut rows = Rows::new(plan.len(), channels);
            for i in 0..plan.len() {
                for (to, &v) in rows.row_mut(i).iter_mut().zip(&v[i * channels..]) {
                    *to = v as f32;
                }
            }
            let byte = at as u8 + 8 * (channels as u8 - 1);
            let mut coder = RansEncoder::default();
            let steps = vec![0.5; channels];
            // Coarse enough that some seeds are short.
            (0..plan.len()).for_each(|i| rows.row_mut(i).iter_mut().for_each(|v| *v /= 30.0));
            attribute::encode(&mut coder, plan, &attribute::Quantisation::new(&steps), &mut rows)
                .expect("encoded");
            out.push(with(byte, &coder.finish()));
            let words: Vec<u8> = v.iter().flat_map(|v| (*v as i16).to_le_bytes()).collect();
            out.push(with(byte | 128, &words[..words.len().min(160)]));
        }
    }
    out
}

fn coded() -> Vec<Vec<u8>> {
    let what: Vec<u8> = (0..40u8).map(|i| i.wrapping_mul(37)).collect();
    let head = |byte: u8| [&[byte, what.len() as u8], &what[..]].concat();
    let data: Vec<u8> = values(40, 3).iter().map(|v| *v as u8).collect();
    let mut encoder = RansEncoder::default();
    crate::codec::drive(&mut encoder, &what, &data);
    vec![[head(0), encoder.finish()].concat(), [head(1), data].concat(), vec![0, 0], vec![1, 1, 3]]
}

fn golomb() -> Vec<Vec<u8>> {
    let v: Vec<i32> = values(60, 5).iter().map(|v| v / 40).collect();
    let n = (v.len() as u16).to_le_bytes();
    let plain: Vec<u8> = v.iter().take(30).flat_map(|v| v.to_le_bytes()).collect();
    vec![[&[0], &n[..], &rlgr::encode(&v)].concat(), with(1, &plain)]
}

fn predicted() -> Vec<Vec<u8>> {
    let mut out = Vec::new();
    for (at, tree) in codec::octrees().iter().enumerate() {
        let near = Neighbours::new(tree);
        for v in [values(tree.len(), 1), (0..tree.len() as i32).map(|i| i % 3 * 1000).collect()] {
            let coded = encode_lossless(&near, &[&v, &v]).expect("encoded");
            out.push(with(at as u8 + 8, &coded));
        }
    }
    out
}

fn checkpoint() -> Vec<u8> {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let path = dir.path().join("checkpoint");
    let run = readers::fine_tune(path.clone()).expect("valid input");
    run.run(|_| ()).expect("no GPU is involved");
    std::fs::read(path).expect("read back")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn seeds_are_accepted_and_short_enough() {
        let mut bad = Vec::new();
        for target in TARGETS {
            let seeds = (target.seeds)();
            let accepted = seeds.iter().filter(|s| (target.run)(s)).count();
            let longest = seeds.iter().map(Vec::len).max().unwrap_or(0);
            let name = target.name;
            println!("{name}: {accepted} of {} seeds accepted, {longest} bytes", seeds.len());
            if accepted * 2 <= seeds.len() || longest > target.max_len {
                bad.push(name);
            }
        }
        assert!(bad.is_empty(), "{bad:?}");
    }
}

//! Small valid inputs of every target, made by the encoders and writers themselves.

#[path = "../../../crates/gsvx/tests/common/mod.rs"]
mod common;

use common::{scene, voxelized};
use gpcc_lite::coeffs::Mode;
use gpcc_lite::predict::{Lifting, Neighbours, encode_lifting, encode_lossless};
use gpcc_lite::quant::Step;
use gpcc_lite::{attribute, coeffs, geometry, rlgr};
use gs_model::ply;
use gsvx::lossless::LosslessOptions;
use gsvx::stream::{Container, SectionKind};
use gsvx::{CovarianceMode, EncodeOptions, Entropy, PaperQp};
use voxel::Strategy;

use crate::codec::{leaves, plans};

/// A target: its name, what it runs, and the longest input worth trying.
pub type Target = (&'static str, fn(&[u8]) -> bool, usize);

/// All targets.
pub const TARGETS: [Target; 14] = [
    ("ply", crate::ply, 2048),
    ("spz", crate::spz, 512),
    ("splat", crate::splat, 256),
    ("colmap", crate::colmap, 512),
    ("cameras", crate::cameras, 768),
    ("gsvx", crate::gsvx, 1024),
    ("lossless", crate::lossless, 640),
    ("geometry", crate::geometry, 256),
    ("attribute", crate::attribute, 384),
    ("coeffs", crate::coeffs, 256),
    ("rlgr", crate::rlgr, 256),
    ("predict", crate::predict, 256),
    ("codebook", crate::codebook, 256),
    ("checkpoint", crate::checkpoint, 512),
];

/// Seeds of a target.
///
/// # Panics
/// If an encoder fails on its own fixture, or there is no such target.
#[must_use]
pub fn of(target: &str) -> Vec<Vec<u8>> {
    match target {
        "ply" => models(),
        "spz" => spz(),
        "splat" => vec![vec![0], with(0, &[7; 32]), with(1, &[60; 64])],
        "colmap" => colmap(),
        "cameras" => cameras(),
        "gsvx" => streams(),
        "lossless" => lossless(),
        "geometry" => octrees(),
        "attribute" => attributes(),
        "coeffs" => coefficients(),
        "rlgr" => golomb(),
        "predict" => predicted(),
        "codebook" => codebooks(),
        "checkpoint" => vec![checkpoint()],
        _ => panic!("{target}: no such target"),
    }
}

fn with(byte: u8, rest: &[u8]) -> Vec<u8> {
    [&[byte], rest].concat()
}

fn values(n: usize, seed: u64) -> Vec<i32> {
    let mut r = common::Rng(seed);
    (0..n).map(|_| (r.next() % 200) as i32 - 100 + ((r.next() % 50 == 0) as i32) * 70_000).collect()
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
    out.push(with(0, &crate::seal::gzip(&inner[0])));
    let mut latest = Vec::new();
    gs_model::spz::write_to(&mut latest, &scene(2, 1, 1), &Default::default()).expect("written");
    out.push(with(0, &latest));
    out
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
    let mut points = 1u64.to_le_bytes().to_vec();
    points.extend(7u64.to_le_bytes());
    [1.0f64, 2.0, 3.0].iter().for_each(|v| points.extend(v.to_le_bytes()));
    points.extend([9, 8, 7]);
    points.extend(0.5f64.to_le_bytes());
    points.extend(1u64.to_le_bytes());
    points.extend([0; 8]);
    let lines = b"# points\n1 0.1 0.2 0.3 1 2 3 0.5 1 2\n2 1 2 3 4 5 6 7\n";
    vec![text, split(0, &cameras, &images), with(2, &points), with(3, lines)]
}

fn cameras() -> Vec<Vec<u8>> {
    let inria = br#"[{"id":0,"img_name":"a","width":64,"height":48,"position":[0,0,1.5],
"rotation":[[1,0,0],[0,1,0],[0,0,1]],"fy":50.0,"fx":50}]"#;
    let nerf = br#"{"camera_angle_x":0.8,"w":64,"h":48.0,"k1":0,"frames":[{"file_path":"./a.png",
"transform_matrix":[[1,0,0,0],[0,1,0,0],[0,0,1,2],[0,0,0,1]]},{"file_path":"b","fl_x":40,"cx":3,
"transform_matrix":[[1,0,0,0],[0,1,0,0],[0,0,1,2]]}]}"#;
    vec![with(0, inria), with(1, nerf)]
}

fn streams() -> Vec<Vec<u8>> {
    let base = EncodeOptions::from_quality(20.0).expect("a quality");
    let qp = PaperQp { ac: 40, dc: 28, opacity: 40 };
    let mut out = Vec::new();
    for (n, degree, options) in [
        (0, 0, base.clone()),
        (1, 1, base.clone()),
        (6, 0, base.clone()),
        (3, 3, base.clone()),
        (6, 0, EncodeOptions { entropy: Entropy::Symbols, ..base.clone() }),
        (6, 0, EncodeOptions { entropy: Entropy::Fast, ..base.clone() }),
        (5, 0, EncodeOptions { entropy: Entropy::Rlgr, ..base.clone() }),
        (4, 0, EncodeOptions { covariance: CovarianceMode::Vq { bits: 8 }, ..base }),
        (4, 1, EncodeOptions::paper(qp, CovarianceMode::Lossless { bits: 8 })),
    ] {
        let (merged, voxels) = voxelized(&scene(n, degree, 7), &Strategy::paper(2, 6));
        let bytes = gsvx::encode(&merged, &voxels, &options).expect("encoded").bytes;
        out.push([&[3, 0], &bytes[..]].concat());
        out.push([&[4 | degree, 3], &bytes[..]].concat());
        out.push([&[8 | degree, 0], &bytes[..bytes.len() - bytes.len() / 4]].concat());
    }
    // Predictions do not pay for so few Gaussians: factors are put in.
    let (merged, voxels) = voxelized(&scene(2, 3, 7), &Strategy::paper(2, 6));
    let options = EncodeOptions::from_quality(40.0).expect("a quality");
    let bytes = gsvx::encode(&merged, &voxels, &options).expect("encoded").bytes;
    let container = Container::parse(&bytes).expect("parsed");
    let with_factors = |kind: SectionKind| {
        let mut payload = container.section(kind).expect("whole").expect("there").to_vec();
        let factors: &[u8] = match kind {
            SectionKind::Sh2 => &[9; 15],
            SectionKind::Sh3 => &[250; 35],
            _ => return (kind, payload),
        };
        payload.splice(0..1, [&[12], factors].concat());
        (kind, payload)
    };
    let sections: Vec<_> = container.toc.iter().map(|e| with_factors(e.kind)).collect();
    let bytes = gsvx::stream::assemble(&container.header, &sections);
    out.push([&[3, 0], &bytes[..]].concat());
    out.push([&[8 | 3, 0], &bytes[..bytes.len() - 9]].concat());
    for n in [0, 2] {
        let bytes = gsvx::encode_lossless(&scene(n, 0, 3)).expect("encoded").bytes;
        out.push([&[0, 0], &bytes[..]].concat());
    }
    out
}

fn lossless() -> Vec<Vec<u8>> {
    let mut out = Vec::new();
    for (n, degree, keep_order) in [(0, 0, false), (1, 0, true), (9, 0, false), (3, 1, true)] {
        let options = LosslessOptions { keep_order };
        let bytes = gsvx::lossless::encode(&scene(n, degree, 3), &options).expect("encoded").bytes;
        let container = Container::parse(&bytes).expect("parsed");
        let payload = container.section(SectionKind::Lossless).expect("whole").expect("there");
        out.push([&[degree], &(n as u16).to_le_bytes()[..], payload].concat());
    }
    out
}

fn octrees() -> Vec<Vec<u8>> {
    let code = |(l, j): &(Vec<_>, u8)| geometry::encode(l, *j).expect("encoded");
    let mut out: Vec<Vec<u8>> = leaves().iter().map(|set| with(22, &code(set))).collect();
    out.push(with(4, &code(&leaves()[3])));
    out.push(with(128 + 22, &code(&leaves()[3])));
    let far = (0..20u64).map(|i| gpcc_lite::Leaf { morton: i << 55, depth: 21 }).collect();
    out.push(with(22, &code(&(far, 21))));
    out
}

fn attributes() -> Vec<Vec<u8>> {
    let mut out = Vec::new();
    for (at, plan) in plans().iter().enumerate() {
        for (mode, prediction) in [
            (Mode::Range, true),
            (Mode::Symbols, false),
            (Mode::Rlgr, false),
            (Mode::RlgrMalvar, true),
        ] {
            let v = values(plan.len(), at as u64);
            let o = attribute::Options { mode, prediction, ..Default::default() };
            let coded = attribute::encode(plan, &[&v, &v, &v], &[Step::from_qp(28); 3], &o);
            out.push(with(at as u8 + 16, &coded.expect("encoded").bytes));
            let o = attribute::Options { by_means: true, ..o };
            let alone = attribute::encode(plan, &[&v], &[Step::from_qp(28)], &o);
            out.push(with(at as u8 + 16, &alone.expect("encoded").bytes));
        }
    }
    out
}

fn coefficients() -> Vec<Vec<u8>> {
    let mut out = Vec::new();
    for (at, plan) in plans().iter().enumerate() {
        for mode in [Mode::Range, Mode::Symbols, Mode::Rlgr, Mode::RlgrMalvar] {
            let v: Vec<i32> = values(plan.len(), at as u64).iter().map(|v| v / 30).collect();
            let coded = coeffs::encode(plan, &[&v, &v], mode).expect("encoded");
            out.push(with(at as u8 + 8, &coded));
            out.push(with(at as u8 + 8 + 64, &coded));
            // Flags of whole coefficients are there with two chunks or more.
            let coded = coeffs::encode(plan, &[&v[..]; 6], mode).expect("encoded");
            out.push(with(at as u8 + 5 * 8, &coded));
            out.push(with(at as u8 + 5 * 8 + 192, &coded));
        }
    }
    out
}

fn golomb() -> Vec<Vec<u8>> {
    let mut out = Vec::new();
    for (byte, params) in [(0, rlgr::Params::REMOTE_FX), (1, rlgr::Params::MALVAR)] {
        let v: Vec<i32> = values(60, 5).iter().map(|v| v / 40).collect();
        let n = (v.len() as u16).to_le_bytes();
        out.push([&[byte], &n[..], &rlgr::encode(&v, &params)].concat());
        let plain: Vec<u8> = v.iter().take(30).flat_map(|v| v.to_le_bytes()).collect();
        out.push(with(byte | 2, &plain));
    }
    out
}

fn predicted() -> Vec<Vec<u8>> {
    let mut out = Vec::new();
    for (at, (l, j)) in leaves().iter().enumerate() {
        let near = Neighbours::new(l, *j).expect("valid leaves");
        let coarser = Neighbours::coarser(l, *j).expect("valid leaves");
        for v in [values(l.len(), 1), (0..l.len() as i32).map(|i| i % 3 * 1000).collect()] {
            let coded = encode_lossless(&near, &[&v, &v]).expect("encoded");
            out.push(with(at as u8 + 8, &coded));
            let lift = Lifting::new(&coarser);
            let coded = encode_lifting(&lift, &[&v], &[Step::from_qp(20)]).expect("encoded");
            out.push(with(at as u8 + 4, &coded));
        }
    }
    out
}

fn codebooks() -> Vec<Vec<u8>> {
    let s = scene(60, 0, 1);
    let covariances: Vec<_> = (0..s.len())
        .map(|i| vq::Covariance::split(s.rotations[i], s.log_scales[i]).expect("valid").0)
        .collect();
    let options = vq::Options::with_codewords(16);
    let book = vq::Codebook::train(&covariances, &vec![1.0; s.len()], &options).expect("trained");
    let indices: Vec<u32> = book.assign(&covariances);
    let mut out = vec![with(0, &book.to_bytes())];
    for codewords in [book.len(), 1000] {
        let coded = vq::index::encode(&indices, codewords).expect("coded");
        let (n, k) = (indices.len() as u16, codewords as u16);
        out.push([&[1], &n.to_le_bytes()[..], &k.to_le_bytes(), &coded].concat());
    }
    out
}

fn checkpoint() -> Vec<u8> {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let path = dir.path().join("checkpoint");
    finetune::probe::write_checkpoint(&crate::tiny_scene(), 3, &path).expect("written");
    std::fs::read(path).expect("read back")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn seeds_are_accepted_and_short_enough() {
        let mut bad = Vec::new();
        for (target, run, max_len) in TARGETS {
            let seeds = of(target);
            let accepted = seeds.iter().filter(|s| run(s)).count();
            let longest = seeds.iter().map(Vec::len).max().unwrap_or(0);
            println!("{target}: {accepted} of {} seeds accepted, {longest} bytes", seeds.len());
            if accepted * 2 <= seeds.len() || longest > max_len {
                bad.push(target);
            }
        }
        assert!(bad.is_empty(), "{bad:?}");
    }
}

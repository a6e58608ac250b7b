//! SPZ: files of all versions, made by hand and by other tools.

mod common;

use common::{gzip, read, says, shared};
use gs_model::spz::{self, ShBits};
use gs_model::{FileAxes, ReadOptions, Scene, model};

fn spz_header(version: u32, n: u32, degree: u8) -> Vec<u8> {
    let mut data = b"NGSP".to_vec();
    data.extend(version.to_le_bytes());
    data.extend(n.to_le_bytes());
    data.extend([degree, 12, 0, 0]);
    data
}

/// Two Gaussians of degree 1.
fn spz_file(version: u32) -> Vec<u8> {
    let mut data = spz_header(version, 2, 1);
    for v in [4096i32, -8192, 1, -4096 * 100, 0, 2048] {
        data.extend(&v.to_le_bytes()[..3]);
    }
    data.extend([51, 255]);
    data.extend([0, 255, 51, 204, 102, 153]);
    data.extend([0, 160, 255, 96, 112, 128]);
    if version == 2 {
        data.extend([255, 128, 128, 0, 255, 0]);
    } else {
        data.extend((3u32 << 30 | (512 + 511) << 20 | 511).to_le_bytes());
        data.extend(0u32.to_le_bytes());
    }
    data.extend([0, 128, 255, 64, 192, 1, 129, 130, 131]);
    data.extend([128; 9]);
    data
}

#[test]
fn spz_is_decoded_and_turned_to_ply_axes() {
    for version in [2, 3] {
        let (scene, report) = read("a.spz", &gzip(&spz_file(version))).unwrap();
        assert_eq!(report.form, format!("SPZ, version {version}"));
        assert_eq!((report.gaussians_in_file, scene.len(), scene.sh_degree), (2, 2, 1));
        assert_eq!(scene.means, [[1.0, 2.0, -1.0 / 4096.0], [-100.0, 0.0, -0.5]]);
        assert_eq!(scene.log_scales, [[-10.0, 0.0, 5.9375], [-4.0, -3.0, -2.0]]);
        // 51 / 255 = 1/5: ln(1/4). 255 is the middle of its half step.
        assert!((scene.opacity_logits[0] + 1.386_294_4).abs() < 1e-6);
        assert!((scene.opacity_logits[1] - 6.926_577).abs() < 1e-5, "{}", scene.opacity_logits[1]);
        let close = |a: f32, b: f32| (a - b).abs() < 1e-6;
        assert!(close(scene.sh[0][0], -0.5 / 0.15) && close(scene.sh[0][1], 0.5 / 0.15));
        assert!(close(scene.sh[0][2], -0.3 / 0.15), "{:?}", scene.sh[0]);
        // Degree 1 is y, z, x: the first two change sign.
        assert_eq!(scene.sh_of(0)[1], [1.0, 0.0, -127.0 / 128.0]);
        assert_eq!(scene.sh_of(0)[2], [0.5, -0.5, 127.0 / 128.0]);
        assert_eq!(scene.sh_of(0)[3], [1.0 / 128.0, 2.0 / 128.0, 3.0 / 128.0]);
        let q = scene.rotations;
        let half = std::f32::consts::FRAC_1_SQRT_2;
        let expected = if version == 2 {
            // x = 1, y and z half a step above 0; then x = -1, y = 1, z = -1, too long.
            [[0.0, 1.0, -1.0 / 255.0, -1.0 / 255.0], [0.0, -1.0, -1.0, 1.0]]
        } else {
            [[0.0, -half, 0.0, -half], [0.0, 1.0, 0.0, 0.0]]
        };
        for (a, b) in q.as_flattened().iter().zip(expected.as_flattened()) {
            assert!((a - b).abs() < 1e-3, "{q:?}");
        }
    }
}

/// The same attributes as `spz_file(3)`, in the container of version 4.
fn spz4() -> Vec<u8> {
    let body = &spz_file(3)[16..];
    let mut rest = body;
    let streams: Vec<(usize, Vec<u8>)> = [9, 1, 3, 3, 4, 9]
        .map(|size| {
            let (part, after) = rest.split_at(2 * size);
            rest = after;
            let level = ruzstd::encoding::CompressionLevel::Uncompressed;
            (part.len(), ruzstd::encoding::compress_to_vec(part, level))
        })
        .into();
    let mut data = spz_header(4, 2, 1);
    // An extension record of one byte before the table of contents.
    data[14] = 2;
    data[15] = streams.len() as u8;
    data.extend(41u32.to_le_bytes());
    data.extend([0; 12]);
    data.extend([7, 0, 0, 0, 1, 0, 0, 0, 99]);
    for (raw, part) in &streams {
        data.extend((part.len() as u64).to_le_bytes());
        data.extend((*raw as u64).to_le_bytes());
    }
    streams.iter().for_each(|(_, part)| data.extend(part));
    data
}

#[test]
fn spz_4_holds_what_spz_3_holds() {
    let (old, _) = read("a.spz", &gzip(&spz_file(3))).unwrap();
    let (new, report) = read("b.spz", &spz4()).unwrap();
    assert_eq!((new, &report.form[..]), (old, "SPZ, version 4"));
}

/// `file` of version 4, or of version 3 before compression, with this extension record instead of others.
fn with_record(mut file: Vec<u8>, kind: u32, contents: &[u8]) -> Vec<u8> {
    let record =
        [&kind.to_le_bytes()[..], &(contents.len() as u32).to_le_bytes(), contents].concat();
    file[14] |= 2;
    if file[4] != 4 {
        return [file, record].concat();
    }
    file[16] = 32 + record.len() as u8;
    file.splice(32..41, record);
    file
}

#[test]
fn the_coordinate_system_that_an_spz_declares_is_honoured() {
    const AXES: u32 = 0xadbe_0003;
    let keep = ReadOptions { axes: FileAxes::Keep, ..ReadOptions::default() };
    let (turned, _) = read("a.spz", &spz4()).unwrap();
    let (kept, _) = model::read_named("a.spz", &spz4(), &keep).unwrap();
    assert_eq!(kept.means[0], turned.means[0].map(|v| if v == 1.0 { v } else { -v }));
    for system in [0u32, 4, 6, 12] {
        let contents = system.to_le_bytes();
        let expected: [f32; 3] = match system {
            // Right, down, forward: as PLY files have it.
            6 => kept.means[0],
            // Right, forward, up.
            12 => [kept.means[0][0], -kept.means[0][2], kept.means[0][1]],
            _ => turned.means[0],
        };
        for bytes in
            [with_record(spz4(), AXES, &contents), gzip(&with_record(spz_file(3), AXES, &contents))]
        {
            let (scene, report) = read("a.spz", &bytes).unwrap();
            assert_eq!((scene.means[0], report.notes.len()), (expected, 0), "{system}");
            let (scene, _) = model::read_named("a.spz", &bytes, &keep).unwrap();
            assert_eq!(scene, kept);
        }
    }
    let unknown = with_record(spz4(), AXES, &17u32.to_le_bytes());
    says(read("a.spz", &unknown), "SPZ_ADOBE_coordinate_system is 17; 1 to 16 are known");
    assert_eq!(model::read_named("a.spz", &unknown, &keep).unwrap().0, kept);
    says(read("a.spz", &with_record(spz4(), AXES, &[6])), "not a number of 4 bytes");
}

#[test]
fn what_an_spz_holds_and_the_model_does_not_is_said() {
    let (_, report) = read("a.spz", &with_record(spz4(), 0xadbe_0002, &[0; 12])).unwrap();
    let said =
        "the extension record 0xadbe0002 (SPZ_ADOBE_safe_orbit_camera) of 12 bytes is not used";
    assert_eq!(report.notes, [said]);
    let mut flags = spz4();
    flags[14] |= 0x40;
    let (_, report) = read("a.spz", &flags).unwrap();
    assert!(report.notes.iter().any(|note| note.contains("not known: 0x40")), "{report:?}");
    // Of degree 4 the first 15 coefficients of each Gaussian are read.
    let mut file = spz_header(3, 1, 4);
    file.extend([0; 9 + 1 + 3 + 3 + 4]);
    file.extend(128..200);
    let (scene, report) = read("a.spz", &gzip(&file)).unwrap();
    assert_eq!((scene.sh_degree, scene.sh_of(0)[15][2]), (3, 44.0 / 128.0));
    assert!(report.notes[0].contains("degree 4"), "{report:?}");
    let mut cut = with_record(spz4(), 7, &[1]);
    cut[36] = 200;
    says(read("a.spz", &cut), "extension records: they are not whole");
}

#[test]
fn broken_spz_files_are_named() {
    let mut short = spz_file(3);
    short.pop();
    let said = format!("{} bytes after decompression", spz_file(3).len());
    says(read("a.spz", &gzip(&short)), &said);
    for n in [u32::MAX, 1 << 24] {
        says(read("a.spz", &gzip(&spz_header(3, n, 3))), &format!("promises {n} Gaussians"));
    }
    for version in [1, 4, 5] {
        let said = format!("SPZ version {version}: not read (2 to 4 are)");
        says(read("a.spz", &gzip(&spz_header(version, 0, 0))), &said);
    }
    says(read("a.spz", &gzip(&spz_header(3, 0, 5))), "an SH degree above 4");
    says(read("a.spz", &gzip(b"not what it should be")), "no SPZ");
    let good = spz4();
    let changed = |at: usize, bytes: &[u8]| {
        let mut file = good.clone();
        file[at..at + bytes.len()].copy_from_slice(bytes);
        read("a.spz", &file)
    };
    says(changed(8, &[255; 4]), "promises 4294967295 Gaussians");
    says(changed(4, &[5]), "SPZ version 5");
    // The magic number of the first stream.
    let at = good.windows(4).position(|w| w == [0x28, 0xb5, 0x2f, 0xfd]).unwrap();
    says(changed(at, &[0]), "its compressed data is broken; get it again");
    let zipped = gzip(&spz_file(3));
    says(read("a.spz", &zipped[..zipped.len() - 9]), "is cut short; get it again");
}

#[test]
fn a_real_spz_4_is_read() {
    let Some(path) = shared("models/biker.spz") else { return };
    let (scene, report) = model::read(path, &ReadOptions::default()).unwrap();
    assert_eq!(report.form, "SPZ, version 4");
    assert_eq!((scene.len(), scene.sh_degree), (152_746, 0));
    // A wrong order or width of the streams would leave no plausible scales and opacities.
    let sane = scene.log_scales.as_flattened().iter().filter(|l| (-9.9..3.0).contains(*l)).count();
    assert!(sane * 10 > 3 * 9 * scene.len(), "{sane}");
    let norms = scene.rotations.iter().map(|q| q.iter().map(|v| v * v).sum::<f32>());
    assert!(norms.into_iter().all(|n| (0.99..1.51).contains(&n)));
}

#[test]
fn spz_3_that_is_written_holds_what_spz_4_holds() {
    for (scene, rest) in
        [(common::room(36, 1), 8), (common::scene(5000, 3), 6), (Scene::default(), 6)]
    {
        let bits = ShBits { degree_1: 6, rest };
        let packed = spz::pack_version_3("a.spz", &scene, bits).unwrap();
        let (old, report) = read("a.spz", &packed).unwrap();
        assert_eq!(report.form, "SPZ, version 3");
        assert_eq!(old, read("a.spz", &spz::pack("a.spz", &scene, bits).unwrap()).unwrap().0);
    }
}

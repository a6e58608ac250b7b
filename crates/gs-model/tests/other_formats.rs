//! SPZ and `.splat`: hand-made files, broken ones, and one model in both formats.

mod common;

use std::collections::BTreeMap;
use std::io::Write;
use std::path::{Path, PathBuf};

use common::shared;
use gs_model::model::{self, Format, Report};
use gs_model::options::Invalid;
use gs_model::{Error, ReadOptions, Result, Scene};

fn read(dir: &Path, name: &str, bytes: &[u8]) -> Result<(Scene, Report)> {
    let path: PathBuf = dir.join(name);
    std::fs::write(&path, bytes).unwrap();
    model::read(path, &ReadOptions::default())
}

fn gzip(data: &[u8]) -> Vec<u8> {
    let mut gz = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
    gz.write_all(data).unwrap();
    gz.finish().unwrap()
}

fn spz_header(version: u32, n: u32, degree: u8) -> Vec<u8> {
    let mut data = b"NGSP".to_vec();
    data.extend(version.to_le_bytes());
    data.extend(n.to_le_bytes());
    data.extend([degree, 12, 0, 0]);
    data
}

/// Two Gaussians of degree 1.
fn spz(version: u32) -> Vec<u8> {
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
    let dir = tempfile::tempdir().unwrap();
    for version in [2, 3] {
        let (scene, report) = read(dir.path(), "a.spz", &gzip(&spz(version))).unwrap();
        assert_eq!(report.format, Format::Spz { version });
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

#[test]
fn broken_spz_files_are_typed_errors() {
    let dir = tempfile::tempdir().unwrap();
    let good = gzip(&spz(3));
    for len in 0..good.len() {
        assert!(read(dir.path(), "a.spz", &good[..len]).is_err(), "{len}");
    }
    // gzip's CRC notices every flip of a bit that matters; none panics.
    let mut noticed = 0;
    for bit in 0..8 * good.len() {
        let mut flipped = good.clone();
        flipped[bit / 8] ^= 1 << (bit % 8);
        noticed += usize::from(read(dir.path(), "a.spz", &flipped).is_err());
    }
    assert!(noticed * 10 > 8 * good.len() * 7, "{noticed} of {}", 8 * good.len());

    let mut short = spz(3);
    short.pop();
    match read(dir.path(), "a.spz", &gzip(&short)) {
        Err(Error::SpzTruncated { promised: 2, needed, len, .. }) => {
            assert_eq!((needed as usize, len), (spz(3).len(), spz(3).len() - 1));
        }
        other => panic!("{other:?}"),
    }
    for n in [u32::MAX, 1 << 24] {
        let outcome = read(dir.path(), "a.spz", &gzip(&spz_header(3, n, 3)));
        assert!(matches!(outcome, Err(Error::SpzTruncated { promised, .. }) if promised == n));
    }
    let version = |data: &[u8]| match read(dir.path(), "a.spz", data) {
        Err(Error::SpzVersion { version, .. }) => version,
        other => panic!("{other:?}"),
    };
    assert_eq!(version(&gzip(&spz_header(1, 0, 0))), 1);
    assert_eq!(version(&gzip(&spz_header(5, 0, 0))), 5);
    assert_eq!(version(&gzip(&spz_header(4, 0, 0))), 4);
    let outcome = read(dir.path(), "a.spz", &gzip(&spz_header(3, 0, 4)));
    assert!(matches!(outcome, Err(Error::SpzHeader { .. })), "{outcome:?}");
    let outcome = read(dir.path(), "a.spz", &gzip(b"not what it should be"));
    assert!(matches!(outcome, Err(Error::SpzHeader { .. })), "{outcome:?}");
}

fn splat_row(mean: [f32; 3], scale: [f32; 3], rgba: [u8; 4], rotation: [u8; 4]) -> Vec<u8> {
    let mut row: Vec<u8> = mean.iter().chain(&scale).flat_map(|v| v.to_le_bytes()).collect();
    row.extend(rgba);
    row.extend(rotation);
    row
}

#[test]
fn splat_is_decoded() {
    let dir = tempfile::tempdir().unwrap();
    let good = splat_row([1.0, -2.0, 3.5], [1.0, 0.5, 2.0], [255, 0, 51, 51], [255, 128, 0, 64]);
    let (scene, report) = read(dir.path(), "a.SPLAT", &good).unwrap();
    assert_eq!(report.format, Format::Splat);
    assert_eq!(scene.means, [[1.0, -2.0, 3.5]]);
    assert_eq!(scene.rotations, [[127.0 / 128.0, 0.0, -1.0, -0.5]]);
    let ln2 = std::f32::consts::LN_2;
    assert_eq!(scene.log_scales, [[0.0, -ln2, ln2]]);
    assert!((scene.opacity_logits[0] + 2.0 * ln2).abs() < 1e-6);
    let colour = scene.sh[0].map(|c| 0.5 + gs_model::SH_C0 * c);
    for (a, b) in colour.iter().zip([1.0, 0.0, 0.2]) {
        assert!((a - b).abs() < 1e-6, "{colour:?}");
    }
    assert!(matches!(
        read(dir.path(), "a.splat", &good[..31]),
        Err(Error::SplatLength { len: 31, .. })
    ));
    assert!(read(dir.path(), "a.splat", b"").unwrap().0.is_empty());

    // A scale of 0 and a quaternion of 0 are invalid, and dropped on request.
    let flat = splat_row([0.0; 3], [1.0, 0.0, 1.0], [9; 4], [255; 4]);
    let unturned = splat_row([0.0; 3], [1.0; 3], [9; 4], [128; 4]);
    let all = [flat, unturned, good].concat();
    let outcome = read(dir.path(), "a.splat", &all);
    assert!(
        matches!(outcome, Err(Error::InvalidGaussian { index: 0, count: 2, .. })),
        "{outcome:?}"
    );
    let drop = ReadOptions { invalid: Invalid::Drop, ..ReadOptions::default() };
    let (kept, report) = model::read(dir.path().join("a.splat"), &drop).unwrap();
    assert_eq!((kept, report.dropped.count), (scene, 2));
}

/// R S S R^T.
fn covariance(scene: &Scene, i: usize) -> glam::DMat3 {
    let [w, x, y, z] = scene.rotations[i].map(f64::from);
    let r = glam::DMat3::from_quat(glam::DQuat::from_xyzw(x, y, z, w).normalize());
    let s = glam::DVec3::from_array(scene.log_scales[i].map(|v| libm::exp(2.0 * f64::from(v))));
    r * glam::DMat3::from_diagonal(s) * r.transpose()
}

#[test]
fn one_model_in_two_formats_is_the_same_model() {
    let (Some(spz), Some(splat)) = (shared("models/flower.spz"), shared("models/flower.splat"))
    else {
        return;
    };
    let (a, report) = model::read(spz, &ReadOptions::default()).unwrap();
    assert_eq!(report.format, Format::Spz { version: 3 });
    assert_eq!((a.len(), a.sh_degree), (116_549, 3));
    let (b, _) = model::read(splat, &ReadOptions::default()).unwrap();
    assert_eq!((b.len(), b.sh_degree), (116_549, 0));

    // The .splat has its rows in another order and the model elsewhere: turned, moved, and larger
    // by a factor that the log-scales show. Gaussians are paired by log-scales and opacity.
    let mean = |s: &Scene| {
        let all = s.log_scales.as_flattened();
        all.iter().map(|&v| f64::from(v)).sum::<f64>() / all.len() as f64
    };
    let log_factor = mean(&b) - mean(&a);
    let opacity = |s: &Scene, i: usize| 1.0 / (1.0 + libm::exp(-f64::from(s.opacity_logits[i])));
    let key = |s: &Scene, i: usize, shift: f64| {
        let l = s.log_scales[i].map(|v| ((f64::from(v) - shift) * 16.0).round() as i64);
        (l, (opacity(s, i) * 255.0).round() as i64)
    };
    let mut by_key = BTreeMap::new();
    for i in 0..a.len() {
        by_key.entry(key(&a, i, 0.0)).or_insert_with(Vec::new).push(i);
    }
    let mut of_b = BTreeMap::new();
    for j in 0..b.len() {
        of_b.entry(key(&b, j, log_factor)).or_insert_with(Vec::new).push(j);
    }
    let pairs: Vec<(usize, usize)> = of_b
        .iter()
        .filter_map(|(k, js)| match (by_key.get(k)?.as_slice(), js.as_slice()) {
            (&[i], &[j]) => Some((i, j)),
            _ => None,
        })
        .collect();

    // What does not change when a model is turned, moved and scaled: ratios of distances, and
    // how a Gaussian lies with respect to the way to another one.
    let at = |s: &Scene, i: usize| glam::DVec3::from_array(s.means[i].map(f64::from));
    let (mut right, mut tried) = ([0; 3], 0);
    for ab in pairs.windows(2) {
        let [(i1, j1), (i2, j2)] = [ab[0], ab[1]];
        let (d, e) = (at(&a, i2) - at(&a, i1), at(&b, j2) - at(&b, j1));
        let colour = (0..3).all(|c| {
            let rgb = |s: &Scene, i: usize| 0.5 + gs_model::SH_C0 * s.sh_of(i)[0][c];
            // The .splat clips colours to 0..1.
            (rgb(&a, i1).clamp(0.0, 1.0) - rgb(&b, j1)).abs() < 0.01
        });
        let along = |s: &Scene, i: usize, d: glam::DVec3| {
            let c = covariance(s, i);
            d.normalize().dot(c * d.normalize()) / (c.x_axis.x + c.y_axis.y + c.z_axis.z)
        };
        tried += 1;
        right[0] += usize::from(colour);
        right[1] +=
            usize::from((e.length() / d.length() / libm::exp(log_factor) - 1.0).abs() < 0.01);
        right[2] += usize::from((along(&a, i1, d) - along(&b, j1, e)).abs() < 0.03);
    }
    println!("{tried} paired; of these agree in colour, distance, rotation: {right:?}");
    assert!(tried > 20_000, "{tried}");
    // Some pairs are wrong: a log-scale at the edge of its step falls on the next one.
    assert!(right.iter().all(|&r| r * 10 > tried * 9), "{right:?} of {tried}");
}

/// The same attributes as `spz(3)`, in the container of version 4.
fn spz4() -> Vec<u8> {
    let body = &spz(3)[16..];
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
    let dir = tempfile::tempdir().unwrap();
    let (old, _) = read(dir.path(), "a.spz", &gzip(&spz(3))).unwrap();
    let (new, report) = read(dir.path(), "b.spz", &spz4()).unwrap();
    assert_eq!((new, report.format), (old, Format::Spz { version: 4 }));
}

#[test]
fn broken_spz_4_files_are_typed_errors() {
    let dir = tempfile::tempdir().unwrap();
    let good = spz4();
    for len in 0..good.len() {
        assert!(read(dir.path(), "a.spz", &good[..len]).is_err(), "{len}");
    }
    // No checksum: a flip may go unnoticed, but none panics or hangs.
    for bit in 0..8 * good.len() {
        let mut flipped = good.clone();
        flipped[bit / 8] ^= 1 << (bit % 8);
        let _ = read(dir.path(), "a.spz", &flipped);
    }
    let mut many = good.clone();
    many[8..12].copy_from_slice(&u32::MAX.to_le_bytes());
    let outcome = read(dir.path(), "a.spz", &many);
    assert!(matches!(outcome, Err(Error::SpzTruncated { promised: u32::MAX, .. })), "{outcome:?}");
    let mut version = good;
    version[4] = 5;
    let outcome = read(dir.path(), "a.spz", &version);
    assert!(matches!(outcome, Err(Error::SpzVersion { version: 5, .. })), "{outcome:?}");
}

/// A message contained `MagicNumberReadError(Error { kind`.
#[test]
fn messages_about_broken_compression_are_plain_words() {
    let dir = tempfile::tempdir().unwrap();
    let message = |bytes: &[u8]| {
        let error = read(dir.path(), "a.spz", bytes).unwrap_err();
        let plain = !error.to_string().contains(['{', '}', '(', ')']);
        assert!(plain && error.to_string().lines().count() == 1, "{error}");
        error
    };
    let good = gzip(&spz(3));
    for len in 2..good.len() {
        let error = message(&good[..len]);
        let cut = matches!(error, Error::SpzCompressedData { reason: "cut short", .. });
        assert!(cut || matches!(error, Error::SpzTruncated { .. }), "{error}");
    }
    let good = spz4();
    for len in 4..good.len() {
        message(&good[..len]);
    }
    // The magic number of the first stream.
    let mut bad_magic = good;
    let at = bad_magic.windows(4).position(|w| w == [0x28, 0xb5, 0x2f, 0xfd]).unwrap();
    bad_magic[at] = 0;
    let error = message(&bad_magic);
    assert!(error.to_string().ends_with("a.spz: the Zstandard data is broken"), "{error}");
}

/// The command blamed a full disk.
#[test]
fn a_coordinate_beyond_the_range_of_spz_is_named() {
    let mut scene = common::scene(3, 0);
    scene.means[1][2] = -600_000.0;
    let error = gs_model::spz::write_to(Vec::new(), &scene, &Default::default()).unwrap_err();
    assert!(matches!(error, Error::SpzRange { index: 1, value: -600_000.0, limit: 524_287.0, .. }));
    let said = "Gaussian 1: coordinate -600000 is outside the range of SPZ, -524287 to 524287";
    assert!(error.to_string().ends_with(said), "{error}");
    scene.means[1][2] = -524_287.0;
    let mut file = Vec::new();
    gs_model::spz::write_to(&mut file, &scene, &Default::default()).unwrap();
    let (back, _) = model::read_named("a.spz", &file, &ReadOptions::default()).unwrap();
    assert_eq!(back.means[1][2], -524_287.0);
}

#[test]
fn a_real_spz_4_is_read() {
    let Some(path) = shared("models/biker.spz") else { return };
    let (scene, report) = model::read(path, &ReadOptions::default()).unwrap();
    assert_eq!(report.format, Format::Spz { version: 4 });
    assert_eq!((scene.len(), scene.sh_degree), (152_746, 0));
    // A wrong order or width of the streams would leave no plausible scales and opacities.
    let sane = scene.log_scales.as_flattened().iter().filter(|l| (-9.9..3.0).contains(*l)).count();
    assert!(sane * 10 > 3 * 9 * scene.len(), "{sane}");
    let norms = scene.rotations.iter().map(|q| q.iter().map(|v| v * v).sum::<f32>());
    assert!(norms.into_iter().all(|n| (0.99..1.51).contains(&n)));
}

/// Every attribute is within the documented steps of the written formats.
fn assert_close(a: &Scene, b: &Scene, spz: bool) {
    assert_eq!(a.len(), b.len());
    let mean_step = if spz { 1.0 / 4096.0 } else { 0.0 };
    for i in 0..a.len() {
        for (x, y) in a.means[i].iter().zip(b.means[i]) {
            assert!((x - y).abs() <= mean_step, "{i}: {:?} {:?}", a.means[i], b.means[i]);
        }
        for (x, y) in a.log_scales[i].iter().zip(b.log_scales[i]) {
            let step = if spz { 1.0 / 32.0 + 1e-5 } else { 1e-5 };
            // What the bytes, and the floats of a .splat, hold at all.
            let (low, high) = if spz { (-10.0, 5.9375) } else { (-87.33, 88.72) };
            let x = x.clamp(low, high);
            assert!((x - y).abs() <= step + if spz { 0.0 } else { 0.01 }, "{i}: {x} {y}");
        }
        let alpha = |l: f32| 1.0 / (1.0 + libm::expf(-l));
        assert!((alpha(a.opacity_logits[i]) - alpha(b.opacity_logits[i])).abs() < 0.0021);
        let [p, q] = [a, b].map(|s| glam::Vec4::from_array(s.rotations[i]).normalize());
        assert!(p.dot(q).abs() > if spz { 0.9999 } else { 0.999 }, "{i}: {p} {q}");
        for (k, (x, y)) in a.sh_of(i).iter().zip(b.sh_of(i)).enumerate() {
            for (x, y) in x.iter().zip(y) {
                let (bound, limit) = match (k, spz) {
                    (0, true) => (0.5 / 255.0 / 0.15, 0.5 / 0.15),
                    (0, false) => (0.5 / 255.0 / gs_model::SH_C0, 0.5 / gs_model::SH_C0),
                    _ => (1.0 / 128.0, 1.0),
                };
                assert!((x.clamp(-limit, limit) - y).abs() <= bound + 1e-5, "{i} {k}: {x} {y}");
            }
        }
    }
}

#[test]
fn spz_and_splat_round_trip() {
    let dir = tempfile::tempdir().unwrap();
    for degree in 0..=3 {
        for n in [0, 1, 700] {
            let scene = common::scene(n, degree);
            let path = dir.path().join("a.spz");
            gs_model::spz::write(&path, &scene, &Default::default()).unwrap();
            let (back, report) = model::read(&path, &ReadOptions::default()).unwrap();
            assert_eq!((report.format, back.sh_degree), (Format::Spz { version: 4 }, degree));
            assert_close(&scene, &back, true);
            // Values that are already on the lattice stay the same.
            gs_model::spz::write(&path, &back, &Default::default()).unwrap();
            let (again, _) = model::read(&path, &ReadOptions::default()).unwrap();
            assert_eq!((&again.means, &again.log_scales), (&back.means, &back.log_scales));
            assert_eq!((&again.sh, &again.opacity_logits), (&back.sh, &back.opacity_logits));
        }
        let scene = common::scene(300, degree);
        let path = dir.path().join("a.splat");
        gs_model::splat::write(&path, &scene).unwrap();
        let (back, _) = model::read(&path, &ReadOptions::default()).unwrap();
        assert_eq!(back.sh_degree, 0);
        let mut flat = scene.clone();
        flat.sh = (0..scene.len()).map(|i| scene.sh_of(i)[0]).collect();
        flat.sh_degree = 0;
        assert_close(&flat, &back, false);
    }
}

#[test]
fn a_ply_file_is_read_whatever_its_name() {
    let dir = tempfile::tempdir().unwrap();
    let scene = common::scene(3, 1);
    let mut bytes = Vec::new();
    gs_model::ply::write_to(&mut bytes, &scene).unwrap();
    let (back, report) = read(dir.path(), "model", &bytes).unwrap();
    assert_eq!(back, scene);
    assert_eq!(report.format, Format::Ply(gs_model::ply::Format::BinaryLittleEndian));
    assert!(report.ply.is_some());
}

//! Streams of several slices.

mod common;

use common::{Rng, scene, voxelized};
use gs_model::Scene;
use gsvx::stream::{Container, SectionKind};
use gsvx::{CovarianceMode, DecodeOptions, Decoder, EncodeOptions, Entropy, Error, decode, encode};
use std::borrow::Cow;
use std::num::NonZeroUsize;
use std::sync::Mutex;
use voxel::{Strategy, Voxelization};

fn model() -> (Scene, Voxelization) {
    let (merged, voxels) = voxelized(&scene(14_000, 1, 5), &Strategy::Uniform { depth: 12 });
    assert!(merged.len() > 3 * 4096, "{}", merged.len());
    (merged, voxels)
}

fn options(slices: usize, entropy: Entropy) -> EncodeOptions {
    let slices = NonZeroUsize::new(slices);
    EncodeOptions { slices, entropy, ..EncodeOptions::from_quality(50.0).unwrap() }
}

fn sections(bytes: &[u8]) -> Vec<(SectionKind, Vec<u8>)> {
    let container = Container::parse(bytes).unwrap();
    let payload = |kind| container.section(kind).unwrap().unwrap().to_vec();
    container.toc.iter().map(|e| (e.kind, payload(e.kind))).collect()
}

#[test]
fn slices_hold_what_one_does() {
    let (merged, voxels) = model();
    for entropy in [Entropy::Range, Entropy::Symbols, Entropy::Fast, Entropy::Rlgr] {
        let one = encode(&merged, &voxels, &options(1, entropy)).unwrap().bytes;
        let whole = decode(&one, &DecodeOptions::default()).unwrap();
        for (wanted, slices) in [(2, 2), (3, 3), (100, merged.len() as u64 / 4096)] {
            let bytes = encode(&merged, &voxels, &options(wanted, entropy)).unwrap().bytes;
            assert_eq!(Container::parse(&bytes).unwrap().header.slices, slices);
            let decoded = decode(&bytes, &DecodeOptions::default()).unwrap();
            assert_eq!(decoded.leaves, voxels.leaves);
            assert_eq!(decoded.scene.means, merged.means);
            // The classes are rounded apart, and so are the steps: errors are alike, not equal.
            let error = |s: &Scene| -> f64 {
                let pairs = s.opacity_logits.iter().zip(&merged.opacity_logits);
                pairs.map(|(a, b)| f64::from((a - b) * (a - b))).sum()
            };
            let ratio = error(&decoded.scene) / error(&whole.scene);
            assert!((0.9..1.1).contains(&ratio), "{ratio}");
        }
    }
}

#[test]
fn merging_slice_by_slice_gives_the_same_bytes() {
    let model = scene(14_000, 1, 5);
    let strategy = |_: &[f32], _| Ok(Strategy::Uniform { depth: 12 });
    let prepared = gsvx::prepare(&model, strategy, None).unwrap();
    let encoded = |model: Cow<Scene>, o: &EncodeOptions| {
        let (encoded, leaves) = gsvx::encode_model(model, strategy, None, o).unwrap();
        assert_eq!(leaves, prepared.voxels.len());
        encoded.bytes
    };
    for (slices, entropy) in [1, 2, 3]
        .into_iter()
        .flat_map(|n| [Entropy::Fast, Entropy::Range, Entropy::Symbols].map(|entropy| (n, entropy)))
    {
        let mut o = options(slices, entropy);
        o.outliers = Some(model.select(&[5, 9]));
        let got = [Cow::Borrowed(&model), Cow::Owned(model.clone())].map(|m| encoded(m, &o));
        o.importance = Some(prepared.importance.clone());
        let want = encode(&prepared.scene, &prepared.voxels, &o).unwrap().bytes;
        assert!(got.iter().all(|got| *got == want), "{slices} slices, {entropy:?}");
    }
    // Coded whole, with values that others look at.
    for covariance in [CovarianceMode::Vq { bits: 8 }, CovarianceMode::Lossless { bits: 16 }] {
        let o = EncodeOptions { covariance, ..options(1, Entropy::Range) };
        let got = [Cow::Borrowed(&model), Cow::Owned(model.clone())].map(|m| encoded(m, &o));
        assert!(got[0] == got[1], "{covariance:?}");
    }
}

#[test]
fn threads_change_neither_bytes_nor_floats() {
    let (merged, voxels) = model();
    let mut seen: Option<(Vec<u8>, Scene)> = None;
    for threads in [1, 2, 5] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let (bytes, scene) = pool.install(|| {
            let bytes = encode(&merged, &voxels, &options(3, Entropy::Range)).unwrap().bytes;
            let scene = decode(&bytes, &DecodeOptions::default()).unwrap().scene;
            (bytes, scene)
        });
        match &seen {
            None => seen = Some((bytes, scene)),
            Some(first) => assert!(first.0 == bytes && first.1 == scene, "{threads} threads"),
        }
    }
}

#[test]
fn parts_are_the_scene_in_order() {
    let (merged, voxels) = model();
    let mut o = options(3, Entropy::Range);
    o.outliers = Some(merged.select(&[5, 9]));
    let bytes = encode(&merged, &voxels, &o).unwrap().bytes;
    for max_sh_degree in [0, 3] {
        let options = DecodeOptions { max_sh_degree, ..Default::default() };
        let whole = decode(&bytes, &options).unwrap();
        let decoder = Decoder::new(&bytes, &options).unwrap();
        assert_eq!((decoder.len(), decoder.sh_degree()), (merged.len() + 2, max_sh_degree.min(1)));
        let mut parts = 0;
        let mut scene = Scene { sh_degree: decoder.sh_degree(), ..Scene::default() };
        let take = |part: gsvx::Part| -> Result<(), Error> {
            parts += 1;
            scene.append(&part.scene);
            Ok(())
        };
        decoder.parts(|part| part, take).unwrap();
        assert_eq!(scene, whole.scene);
        assert_eq!(parts, 4);
        let stop = decoder.parts(|_| (), |()| Err(Error::NotGsvx));
        assert!(matches!(stop, Err(Error::NotGsvx)));
    }
}

/// What [`Decoder::blocks`] visits, put together.
fn by_blocks(bytes: &[u8], options: &DecodeOptions) -> Scene {
    let decoder = Decoder::new(bytes, options).unwrap();
    let seen: Mutex<Vec<(usize, Scene)>> = Mutex::default();
    let visit = |visits: &mut usize, first: usize, block: &Scene| -> Result<(), Error> {
        *visits += 1;
        seen.lock().unwrap().push((first, block.clone()));
        Ok(())
    };
    decoder.blocks(visit).unwrap();
    let mut blocks = seen.into_inner().unwrap();
    blocks.sort_by_key(|(first, _)| *first);
    let mut scene = Scene { sh_degree: decoder.sh_degree(), ..Scene::default() };
    for (first, block) in blocks {
        assert_eq!(first, scene.len());
        scene.append(&block);
    }
    scene
}

#[test]
fn blocks_are_the_scene() {
    let (merged, voxels) = model();
    let outliers = Some(merged.select(&[5, 9]));
    let coded = |slices, covariance| {
        let o = EncodeOptions {
            outliers: outliers.clone(),
            covariance,
            ..options(slices, Entropy::Range)
        };
        encode(&merged, &voxels, &o).unwrap().bytes
    };
    let streams = [
        coded(1, CovarianceMode::Transform),
        coded(3, CovarianceMode::Transform),
        coded(1, CovarianceMode::Lossless { bits: 12 }),
        gsvx::encode_lossless(&merged).unwrap().bytes,
    ];
    for bytes in &streams {
        for max_sh_degree in [0, 3] {
            let o = DecodeOptions { max_sh_degree, ..Default::default() };
            let whole = decode(bytes, &o).unwrap().scene;
            for threads in [1, 3] {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
                assert!(pool.install(|| by_blocks(bytes, &o)) == whole, "{threads} threads");
            }
        }
        let decoder = Decoder::new(bytes, &DecodeOptions::default()).unwrap();
        let stop = decoder.blocks(|(), _, _: &Scene| Err(Error::NotGsvx));
        assert!(matches!(stop, Err(Error::NotGsvx)));
    }
}

#[test]
fn prefixes_decode() {
    let (merged, voxels) = model();
    let bytes = encode(&merged, &voxels, &options(3, Entropy::Range)).unwrap().bytes;
    let last = sections(&bytes).last().unwrap().1.len();
    let cut = &bytes[..bytes.len() - last / 2];
    let lenient = DecodeOptions { allow_truncated: true, ..Default::default() };
    assert!(decode(cut, &DecodeOptions::default()).is_err());
    let part = decode(cut, &lenient).unwrap();
    assert_eq!((part.scene.sh_degree, part.skipped.len()), (0, 1));
    let base = DecodeOptions { max_sh_degree: 0, ..Default::default() };
    assert_eq!(part.scene, decode(&bytes, &base).unwrap().scene);
}

#[test]
fn forged_slices_are_refused() {
    let (merged, voxels) = model();
    let bytes = encode(&merged, &voxels, &options(2, Entropy::Fast)).unwrap().bytes;
    let header = Container::parse(&bytes).unwrap().header;
    let good = sections(&bytes);
    for slices in [0, 1, 3, 4, u64::MAX] {
        let mut header = header.clone();
        header.slices = slices;
        let forged = gsvx::stream::assemble(&header, &good);
        assert!(decode(&forged, &DecodeOptions::default()).is_err(), "{slices}");
    }
    // The two slices of every section change places.
    let swap = |payload: &[u8]| {
        let mut r = gsvx::stream::Reader::new(payload, "test");
        let len = r.varint().unwrap() as usize;
        let first = r.take(len).unwrap();
        let second = r.take(r.remaining()).unwrap();
        let mut w = gsvx::stream::Writer::default();
        w.varint(second.len() as u64);
        [w.bytes, second.to_vec(), first.to_vec()].concat()
    };
    let swapped: Vec<_> = good.iter().map(|(kind, p)| (*kind, swap(p))).collect();
    let forged = gsvx::stream::assemble(&header, &swapped);
    let error = decode(&forged, &DecodeOptions::default()).unwrap_err();
    assert!(matches!(error, Error::Corrupt { what: "slice out of order", .. }), "{error}");
    let mut rng = Rng(3);
    for round in 0..60 {
        let mut broken = good.clone();
        let (_, payload) = &mut broken[round % good.len()];
        let at = (rng.next() % if round % 2 == 0 { 4 } else { payload.len() as u64 }) as usize;
        payload[at] = rng.next() as u8;
        let forged = gsvx::stream::assemble(&header, &broken);
        if let Ok(decoded) = decode(&forged, &DecodeOptions::default()) {
            assert!(decoded.scene.validate().is_ok(), "round {round}: not finite");
        }
    }
}

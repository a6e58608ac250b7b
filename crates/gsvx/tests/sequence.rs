//! Sequences: frames come back, cost little, and damage is an error.
#![cfg(feature = "encode")]

mod common;

use common::Rng;
use common::forge::damage;
use common::golden::{frames, sequence};
use gs_model::Scene;
use gsvx::sequence::{Sequence, is_sequence};
use gsvx::{EncodeOptions, Error, SequenceEncoder, SequenceOptions, encode};

const QUALITY: f32 = 70.0;

/// All frames of a sequence.
fn decoded(bytes: &[u8]) -> Result<Vec<Scene>, Error> {
    let sequence = Sequence::parse(bytes)?;
    let mut all = Vec::new();
    for number in 0..sequence.groups.len() {
        let group = sequence.group(bytes, number, None)?;
        all.extend((0..group.len()).map(|t| group.frame(t)));
    }
    Ok(all)
}

/// Root of the mean square of the distances of the means of `a` to the nearest of `b`.
fn off(a: &Scene, b: &Scene) -> f64 {
    let squared =
        |p: &[f32; 3], q: &[f32; 3]| (0..3).map(|k| f64::from(p[k] - q[k])).map(|d| d * d).sum();
    let nearest =
        |p: &[f32; 3]| b.means.iter().map(|q| squared(p, q)).fold(f64::INFINITY, f64::min);
    (a.means.iter().map(nearest).sum::<f64>() / a.len() as f64).sqrt()
}

fn alone(frame: &Scene) -> Vec<u8> {
    encode(frame, None, QUALITY, &EncodeOptions::default()).unwrap().bytes
}

#[test]
fn tracked_frames_come_back_at_a_small_part_of_their_cost() {
    let given = frames(2000, 1, 30, false);
    let bytes = sequence(given.clone(), QUALITY, 30);
    assert!(is_sequence(&bytes) && !is_sequence(&alone(&given[0])));
    assert!(matches!(gsvx::decode(&bytes), Err(Error::IsSequence)));
    assert!(matches!(Sequence::parse(&alone(&given[0])), Err(Error::IsStatic)));
    let back = decoded(&bytes).unwrap();
    assert_eq!(back.len(), 30);
    let mut cost = 0;
    for (given, back) in given.iter().zip(&back) {
        let single = alone(given);
        cost += single.len();
        // As near as the frame alone, or nearly so.
        let alone = off(&gsvx::decode(&single).unwrap(), given);
        assert!(off(back, given) < 1.5 * alone + 1e-4, "{} {alone}", off(back, given));
        back.validate().unwrap();
    }
    assert!(10 * bytes.len() < 3 * cost, "{} of {cost}", bytes.len());
}

#[test]
fn the_static_stream_of_frames_that_stand_still_is_the_stream_of_one() {
    let frame = common::scene(500, 2, 3);
    let bytes = sequence(vec![frame.clone(); 5], QUALITY, 60);
    let sequence = Sequence::parse(&bytes).unwrap();
    let (stream, motion) = sequence.bytes_of(&bytes, 0).unwrap();
    assert_eq!((stream, motion), (&alone(&frame)[..], &[0][..]));
}

#[test]
fn rows_in_another_order_are_matched_and_rows_come_and_go() {
    let mut given = frames(1000, 0, 20, true);
    for (t, frame) in given.iter_mut().enumerate() {
        let n = frame.len();
        *frame = frame.select(&(0..n).map(|i| (i * 7 + t) % n).collect::<Vec<_>>());
    }
    let bytes = sequence(given.clone(), QUALITY, 60);
    assert_eq!(Sequence::parse(&bytes).unwrap().groups.len(), 1);
    let cost: usize = given.iter().map(|frame| alone(frame).len()).sum();
    assert!(2 * bytes.len() < cost, "{} of {cost}", bytes.len());
    for (given, back) in given.iter().zip(decoded(&bytes).unwrap()) {
        assert!(off(given, &back) < 0.02 && off(&back, given) < 0.02);
    }
}

#[test]
fn frames_without_a_common_gaussian_cost_what_they_cost_alone() {
    let given: Vec<Scene> = (0..4).map(|seed| common::scene(800, 0, seed)).collect();
    let cost: usize = given.iter().map(|frame| alone(frame).len()).sum();
    let bytes = sequence(given, QUALITY, 60);
    assert_eq!(Sequence::parse(&bytes).unwrap().groups.len(), 4);
    assert!(100 * bytes.len() <= 101 * cost, "{} of {cost}", bytes.len());
}

#[test]
fn what_moves_alone_and_what_does_not_make_the_frames() {
    for births in [false, true] {
        let still = common::scene(300, 1, 4);
        let mut given = frames(600, 1, 5, births);
        given.iter_mut().for_each(|frame| frame.append(&still));
        let bytes = sequence(given, QUALITY, 5);
        let sequence = Sequence::parse(&bytes).unwrap();
        let whole = sequence.group(&bytes, 0, None).unwrap();
        let (base, moving, alone) = sequence.group(&bytes, 0, None).unwrap().parted();
        assert!(moving.is_sorted() && (500..base.len()).contains(&moving.len()));
        for t in 0..5 {
            let ((mut wanted, there), (some, some_there)) = (whole.all(t), alone.all(t));
            for i in (0..base.len()).filter(|i| !moving.contains(i)) {
                assert!(there[i] && wanted.select(&[i]) == base.select(&[i]));
            }
            assert!(moving.iter().map(|&i| there[i]).eq(some_there));
            wanted.keep(&moving);
            wanted.cut_sh(some.sh_degree);
            assert_eq!(some, wanted);
        }
    }
}

#[test]
fn frames_that_do_not_fit_are_refused() {
    let options = SequenceOptions::default();
    let mut encoder = SequenceEncoder::new(options).unwrap();
    encoder.push(common::scene(9, 1, 1)).unwrap();
    let other = encoder.push(common::scene(9, 2, 1));
    assert!(matches!(other, Err(Error::FrameDegree { found: 2, expected: 1 })));
    let mut broken = common::scene(9, 1, 1);
    broken.means[3][1] = f32::NAN;
    assert!(matches!(encoder.push(broken), Err(Error::NonFinite { index: 3, .. })));
    for bad in [SequenceOptions { fps: 0.0, ..options }, SequenceOptions { group: 0, ..options }] {
        assert!(matches!(SequenceEncoder::new(bad), Err(Error::Option { .. })));
    }
}

#[test]
fn a_cut_or_changed_sequence_is_an_error_and_other_groups_are_whole() {
    let bytes = sequence(frames(60, 1, 6, false), QUALITY, 3);
    let whole = decoded(&bytes).unwrap();
    for end in 0..bytes.len() {
        assert!(decoded(&bytes[..end]).is_err(), "cut at {end}");
    }
    for at in 0..bytes.len() {
        let mut broken = bytes.clone();
        broken[at] ^= 1 << (at % 8);
        assert!(decoded(&broken).is_err(), "byte {at}");
    }
    let sequence = Sequence::parse(&bytes).unwrap();
    let cut = &bytes[..bytes.len() - 1];
    let first = sequence.group(cut, 0, None).unwrap();
    assert_eq!((0..3).map(|t| first.frame(t)).collect::<Vec<_>>(), whole[..3]);
    assert!(matches!(sequence.group(cut, 1, None), Err(Error::Truncated { .. })));
}

/// What moves is damaged behind valid checksums: what an attacker sends.
#[test]
fn damage_behind_valid_checksums_never_panics() {
    let mut rng = Rng::seeded(1);
    for births in [false, true] {
        let bytes = sequence(frames(200, 1, 5, births), QUALITY, 5);
        let group = Sequence::parse(&bytes).unwrap().groups[0].clone();
        let [head, stream, end] =
            [group.stream.start, group.motion.start, group.motion.end].map(|v| v as usize);
        for round in 0..1500 {
            let mut motion = bytes[stream..end].to_vec();
            if round % 2 == 0 {
                // Without the length of the block, which damage would mostly hit.
                let at = 2 + rng.below(40.min(motion.len() - 2));
                motion[at] = rng.bits() as u8;
            } else {
                damage(&mut motion, &mut rng);
            }
            motion.resize(end - stream, 0);
            let mut broken = [&bytes[..stream], &motion].concat();
            let crc = crc32c::crc32c(&broken[head..]);
            broken[head - 8..head - 4].copy_from_slice(&crc.to_le_bytes());
            let crc = crc32c::crc32c(&broken[..head - 4]);
            broken[head - 4..head].copy_from_slice(&crc.to_le_bytes());
            for frame in decoded(&broken).into_iter().flatten() {
                assert!(frame.validate().is_ok(), "round {round}: not finite");
            }
        }
    }
}

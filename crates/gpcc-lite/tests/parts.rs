//! The small parts: tables, counters, steps.

use gpcc_lite::mix::{Mixer, squash, stretch};
use gpcc_lite::model::Bit;
use gpcc_lite::quant::Step;
use gpcc_lite::{Leaf, Limits, geometry, morton};

#[test]
#[allow(clippy::disallowed_methods, reason = "the definition the tables are compared with")]
fn squash_is_the_logistic_function() {
    for x in -2047..=2047 {
        let want = 65536.0 / (1.0 + (-f64::from(x) / 256.0).exp());
        let got = f64::from(squash(x));
        assert!((got - want.clamp(32.0, 65504.0)).abs() <= 1.0, "{x}: {got} {want}");
    }
    assert_eq!(squash(i32::MIN), squash(-2047));
    assert_eq!(squash(i32::MAX), squash(2047));
    for p in (64..65472).step_by(16) {
        let back = squash(stretch(p)) as i32;
        assert!((back - p as i32).abs() <= 16 + p.min(65536 - p) as i32 / 100, "{p} {back}");
    }
}

#[test]
fn a_counter_learns_and_never_becomes_certain() {
    let mut b = Bit::default();
    for i in 0..100_000u32 {
        b.update(true, 255);
        assert!(b.p1() <= 65504 && b.count() <= 255, "{i}");
    }
    assert_eq!(b.p1(), 65504);
    for _ in 0..20_000 {
        b.update(false, 255);
    }
    assert_eq!(b.p1(), 32);
    // Half of the time: the first observations count as 1/n.
    let mut b = Bit::default();
    (0..1000).for_each(|i| b.update(i % 2 == 0, 1023));
    assert!(b.p1().abs_diff(32768) < 400);
}

#[test]
fn a_mixer_finds_the_input_that_knows() {
    let mut m = Mixer::<2>::new(65_536);
    let mut s = 1u32;
    let mut right = 0;
    for i in 0..4000 {
        s = s.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        let bit = s >> 31 == 1;
        let noise = if s >> 20 & 1 == 1 { 600 } else { -600 };
        let inputs = [if bit { 600 } else { -600 }, noise];
        let p1 = m.mix(&inputs);
        right += u32::from(i >= 2000 && (p1 > 65536 * 3 / 4) == bit);
        m.update(&inputs, p1, bit, 4);
    }
    assert!(right > 1990, "{right}");
}

#[test]
fn steps_follow_the_quantisation_parameter() {
    for (qp, step) in [(4, 1.0), (10, 2.0), (16, 4.0), (28, 16.0), (40, 64.0)] {
        assert_eq!(Step::from_qp(qp).value(), step);
    }
    assert!((Step::from_qp(5).value() - 1.122_462).abs() < 1e-5);
    assert_eq!(Step::new(0.0), Step(1));
    assert_eq!(Step::new(f64::NAN), Step(1));
}

#[test]
fn morton_codes_invert() {
    for p in [[0, 0, 0], [1, 2, 4], [(1 << 21) - 1; 3], [1 << 20, 5, 77]] {
        assert_eq!(morton::decode(morton::encode(p)), p);
    }
    assert_eq!(morton::encode([1, 0, 0]), 4);
}

/// A cloud born on a lattice costs much less than one of the same size that was not.
#[test]
fn lattices_are_learned() {
    let cloud = |mask: u32| -> Vec<Leaf> {
        let mut s = 12_345u32;
        let mut next = || {
            s = s.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (s >> 8) & 4095 & mask
        };
        let mut l: Vec<Leaf> = (0..20_000)
            .map(|_| Leaf { morton: morton::encode([next(), next(), next()]), depth: 12 })
            .collect();
        l.sort();
        l.dedup();
        l
    };
    let (free, born) = (cloud(4095), cloud(0xfc0));
    let bits = |l: &[Leaf]| geometry::encode(l, 12).unwrap().len() as f64 * 8.0 / l.len() as f64;
    assert!(bits(&free) - bits(&born) > 14.0, "{} {}", bits(&free), bits(&born));
    let bytes = geometry::encode(&born, 12).unwrap();
    assert_eq!(geometry::decode(&bytes, &Limits::for_stream(bytes.len())).unwrap().leaves, born);
}

//! The small parts: steps and Morton codes.

use gpcc_lite::morton;
use gpcc_lite::quant::Step;

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

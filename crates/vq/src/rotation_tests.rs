use proptest::prelude::*;

use super::*;
use crate::canonical::canonicalise;

fn angle_between(a: [f32; 4], b: [f32; 4]) -> f64 {
    // 2 asin of half the chord: exact for small angles, where acos of the dot is not.
    let (a, b) = (normalised(a), normalised(b));
    let chord = |sign: f64| (0..4).map(|k| a[k] - sign * b[k]).map(|d| d * d).sum::<f64>().sqrt();
    4.0 * libm::asin((chord(1.0).min(chord(-1.0)) / 2.0).min(1.0))
}

fn is_unit(q: [f32; 4]) -> bool {
    (q.iter().map(|&c| f64::from(c) * f64::from(c)).sum::<f64>() - 1.0).abs() < 1e-6
}

proptest! {
    #[test]
    fn grid_error_is_within_half_a_step(q in prop::array::uniform4(-1.0f32..1.0), bits in 2u8..=20) {
        let (q, _) = canonicalise(q, [0.0, -1.0, -2.0]);
        let grid = Grid::with_bits(bits);
        let point = grid.quantise(q);
        prop_assert_eq!(point, grid.quantise(q.map(|c| -c)));
        let top = (1 << (bits - 1)) - 1;
        prop_assert!(point.iter().all(|i| i.abs() <= top + 1), "{point:?}");
        let decoded = grid.dequantise(point);
        prop_assert!(is_unit(decoded));
        // |d angle / d parameter| is at most 4, at the origin, and three half steps add up as
        // sqrt(3) / 2.
        let bound = 4.0 * grid.step * 0.5 * 3f64.sqrt() * 1.01 + 1e-6;
        prop_assert!(angle_between(q, decoded) <= bound);
        prop_assert_eq!(grid.quantise(decoded), point);
    }

    #[test]
    fn any_integers_give_a_rotation(point in prop::array::uniform3(any::<i32>()), bits in 2u8..=24) {
        prop_assert!(is_unit(Grid::with_bits(bits).dequantise(point)));
    }
}

#[test]
fn decoded_bits_are_fixed() {
    // Golden values (checked against the formula in Python): a change here changes what existing
    // streams decode to.
    let grid = Grid::with_bits(10);
    let bits = |q: [f32; 4]| q.map(f32::to_bits);
    assert_eq!(bits(grid.dequantise([0, 0, 0])), bits([1.0, 0.0, 0.0, 0.0]));
    assert_eq!(
        bits(grid.dequantise([100, -37, 511])),
        [1_064_022_728, 1_033_444_995, 3_168_968_141, 1_053_006_874],
    );
}

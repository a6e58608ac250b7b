use proptest::prelude::*;

use super::*;
use crate::canonical::canonicalise_as;

const CHARTS: [Chart; 3] = [Chart::Vector, Chart::Rodrigues, Chart::ModifiedRodrigues];
const FORMS: [Form; 2] = [Form::NearestIdentity, Form::Sorted];

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
    fn parameters_invert(q in prop::array::uniform4(-1.0f32..1.0)) {
        prop_assume!(q[0].abs() > 0.01);
        for chart in CHARTS {
            prop_assert!(angle_between(q, chart.quaternion(chart.parameters(q))) < 1e-5);
            prop_assert_eq!(chart.parameters(q), chart.parameters(q.map(|c| -c)));
        }
    }

    #[test]
    fn canonical_rotations_fit_the_stated_width(
        q in prop::array::uniform4(-1.0f32..1.0), s in prop::array::uniform3(-5.0f32..0.0),
    ) {
        for form in FORMS {
            let (q, _) = canonicalise_as(q, s, form);
            for chart in CHARTS {
                for p in chart.parameters(q) {
                    prop_assert!(p.abs() <= chart.half_width(form) + 2e-6, "{chart:?} {form:?} {p}");
                }
            }
        }
    }

    #[test]
    fn grid_error_is_within_half_a_step(
        q in prop::array::uniform4(-1.0f32..1.0), bits in 2u8..=20,
    ) {
        for form in FORMS {
            let (q, _) = canonicalise_as(q, [0.0, -1.0, -2.0], form);
            for chart in CHARTS {
                let grid = Grid::with_bits(chart, form, bits).unwrap();
                let point = grid.quantise(q);
                let top = (1 << (bits - 1)) - 1;
                prop_assert!(point.iter().all(|i| i.abs() <= top + 1), "{point:?}");
                let decoded = grid.dequantise(point);
                prop_assert!(is_unit(decoded));
                // |d angle / d parameter| is at most 4 (modified Rodrigues, at the origin;
                // the vector chart at w = 1/2), and three half steps add up as sqrt(3)/2.
                let bound = 4.0 * grid.step() * 0.5 * 3f64.sqrt() * 1.3 + 1e-6;
                prop_assert!(angle_between(q, decoded) <= bound);
                // Coarse vector grids can leave the unit ball, which changes the point.
                if chart != Chart::Vector || bits > 4 {
                    prop_assert_eq!(grid.quantise(decoded), point);
                }
            }
        }
    }

    #[test]
    fn any_parameters_give_a_rotation(
        p in prop::array::uniform3(prop::num::f64::ANY), i in prop::array::uniform3(any::<i32>()),
    ) {
        for chart in CHARTS {
            prop_assert!(is_unit(chart.quaternion(p)));
            prop_assert!(is_unit(Grid::new(chart, 0.01).unwrap().dequantise(i)));
        }
        for k in 0..4 {
            prop_assert!(is_unit(from_smallest_three(k, i, 10).unwrap()));
        }
    }

    #[test]
    fn smallest_three_round_trip(q in prop::array::uniform4(-1.0f32..1.0), bits in 4u8..=20) {
        prop_assume!(q.iter().map(|c| c * c).sum::<f32>() > 1e-6);
        let (index, rest) = smallest_three(q, bits).unwrap();
        let decoded = from_smallest_three(index, rest, bits).unwrap();
        let step = std::f64::consts::FRAC_1_SQRT_2 / f64::from((1 << (bits - 1)) - 1);
        prop_assert!(angle_between(q, decoded) <= 4.0 * step * 3f64.sqrt() + 1e-6);
    }
}

#[test]
fn bad_arguments_are_refused() {
    assert!(matches!(Grid::new(Chart::Vector, 0.0), Err(Error::BadStep { .. })));
    assert!(matches!(Grid::new(Chart::Vector, f64::NAN), Err(Error::BadStep { .. })));
    let grid = Grid::with_bits(Chart::Rodrigues, Form::Sorted, 25);
    assert!(matches!(grid, Err(Error::BadBits { bits: 25, .. })));
    assert!(matches!(from_smallest_three(4, [0; 3], 8), Err(Error::BadComponent { index: 4 })));
    assert!(matches!(smallest_three([1.0; 4], 1), Err(Error::BadBits { bits: 1, .. })));
}

#[test]
fn decoded_bits_are_fixed() {
    // Golden values (checked against the formula in Python): a change here changes what existing streams decode to.
    let grid = Grid::with_bits(Chart::ModifiedRodrigues, Form::NearestIdentity, 10).unwrap();
    let bits = |q: [f32; 4]| q.map(f32::to_bits);
    assert_eq!(bits(grid.dequantise([0, 0, 0])), bits([1.0, 0.0, 0.0, 0.0]));
    assert_eq!(
        bits(grid.dequantise([100, -37, 511])),
        [1_064_022_728, 1_033_444_995, 3_168_968_141, 1_053_006_874],
    );
}

use proptest::prelude::*;

use super::*;
use crate::quaternion::{IDENTITY, to_matrix};

/// R diag(exp(2 log s)) Rᵀ from first principles.
fn covariance(q: [f32; 4], log_scales: [f32; 3]) -> [[f64; 3]; 3] {
    let r = to_matrix(normalised(q));
    let mut out = [[0.0; 3]; 3];
    for i in 0..3 {
        for j in 0..3 {
            for k in 0..3 {
                out[i][j] += r[i][k] * libm::exp(2.0 * f64::from(log_scales[k])) * r[j][k];
            }
        }
    }
    out
}

fn assert_same_covariance(a: ([f32; 4], [f32; 3]), b: ([f32; 4], [f32; 3])) {
    let (ca, cb) = (covariance(a.0, a.1), covariance(b.0, b.1));
    let size = ca[0][0] + ca[1][1] + ca[2][2];
    for i in 0..3 {
        for j in 0..3 {
            assert!((ca[i][j] - cb[i][j]).abs() <= 1e-6 * size, "{a:?} {b:?}\n{ca:?}\n{cb:?}");
        }
    }
}

fn gaussian() -> impl Strategy<Value = ([f32; 4], [f32; 3])> {
    (prop::array::uniform4(-1.0f32..1.0), prop::array::uniform3(-8.0f32..2.0))
        .prop_filter("some length", |(q, _)| q.iter().map(|c| c * c).sum::<f32>() > 1e-6)
}

#[test]
fn the_table_is_the_group_of_the_cube() {
    for (n, e) in CUBE.iter().enumerate() {
        let m = to_matrix(e.quaternion);
        for column in 0..3 {
            for row in 0..3 {
                let wanted = f64::from(u8::from(e.axis[column] as usize == row));
                assert!((m[row][column].abs() - wanted).abs() < 1e-15, "element {n}: {m:?}");
            }
        }
        for other in &CUBE[..n] {
            let dot: f64 = (0..4).map(|k| e.quaternion[k] * other.quaternion[k]).sum();
            assert!(dot.abs() < 0.9, "element {n} twice");
        }
    }
    // `canonicalise_as` relies on runs of four with one permutation each.
    for run in CUBE.chunks(4) {
        assert!(run.iter().all(|e| e.axis == run[0].axis));
    }
    assert_eq!(CUBE[0].quaternion, IDENTITY);
}

#[test]
fn degenerate_input_is_the_identity() {
    for q in [[0.0; 4], [f32::NAN; 4]] {
        assert_eq!(canonicalise(q, [1.0, 2.0, 3.0]), ([1.0, 0.0, 0.0, 0.0], [1.0, 2.0, 3.0]));
    }
}

proptest! {
    #[test]
    fn covariance_is_kept(g in gaussian(), near in gaussian()) {
        for form in [Form::NearestIdentity, Form::Sorted] {
            assert_same_covariance(g, canonicalise_as(g.0, g.1, form));
        }
        assert_same_covariance(g, canonicalise_near(g.0, g.1, near, 0.1));
    }

    #[test]
    fn every_representative_gives_the_same_result(g in gaussian(), n in 0usize..24, flip: bool) {
        let sign = if flip { -1.0 } else { 1.0 };
        let other = product(normalised(g.0), CUBE[n].quaternion).map(|c| (sign * c) as f32);
        let scales = CUBE[n].axis.map(|k| g.1[usize::from(k)]);
        for form in [Form::NearestIdentity, Form::Sorted] {
            let (qa, sa) = canonicalise_as(g.0, g.1, form);
            let (qb, sb) = canonicalise_as(other, scales, form);
            let dot: f64 = (0..4).map(|k| f64::from(qa[k]) * f64::from(qb[k])).sum();
            prop_assert!((qa[0] - qb[0]).abs() < 2e-6);
            // On the border of the zone either side is right.
            prop_assert!(dot > 1.0 - 1e-5 && sa == sb || on_border(g, form));
        }
    }

    #[test]
    fn bounds_of_the_forms(g in gaussian()) {
        let (q, _) = canonicalise_as(g.0, g.1, Form::NearestIdentity);
        prop_assert!(q[0] >= 0.8535, "{q:?}");
        let (q, s) = canonicalise_as(g.0, g.1, Form::Sorted);
        prop_assert!(q[0] >= 0.5 - 1e-6 && s[0] >= s[1] && s[1] >= s[2], "{q:?} {s:?}");
    }

    #[test]
    fn a_second_pass_changes_nothing(g in gaussian()) {
        for form in [Form::NearestIdentity, Form::Sorted] {
            let (q, s) = canonicalise_as(g.0, g.1, form);
            let (again, scales) = canonicalise_as(q, s, form);
            prop_assert_eq!(s, scales);
            for k in 0..4 {
                prop_assert!((q[k] - again[k]).abs() <= 1.2e-7);
            }
        }
    }

    #[test]
    fn the_nearest_representative_is_found_again(g in gaussian(), n in 0usize..24) {
        // The reference is g itself: whatever representative is given, g comes back.
        let unit = normalised(g.0);
        let other = product(unit, CUBE[n].quaternion).map(|c| c as f32);
        let scales = CUBE[n].axis.map(|k| g.1[usize::from(k)]);
        let (q, _) = canonicalise_near(other, scales, g, 1.0);
        for k in 0..4 {
            prop_assert!((f64::from(q[k]) - unit[k]).abs() < 1e-5);
        }
    }
}

/// Whether two representatives are within rounding of each other in |w| (or in scale).
fn on_border(g: ([f32; 4], [f32; 3]), form: Form) -> bool {
    let q = normalised(g.0);
    let order = descending(g.1);
    let mut sizes: Vec<f64> = CUBE
        .iter()
        .filter(|e| form == Form::NearestIdentity || e.axis == order)
        .map(|e| product(q, e.quaternion)[0].abs())
        .collect();
    sizes.sort_by(|a, b| b.total_cmp(a));
    let s = order.map(|k| g.1[usize::from(k)]);
    sizes[0] - sizes[1] < 2e-6 || (form == Form::Sorted && (s[0] == s[1] || s[1] == s[2]))
}

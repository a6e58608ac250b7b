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
    fn covariance_is_kept(g in gaussian()) {
        assert_same_covariance(g, canonicalise(g.0, g.1));
    }

    #[test]
    fn every_representative_gives_the_same_result(g in gaussian(), n in 0usize..24, flip: bool) {
        let sign = if flip { -1.0 } else { 1.0 };
        let other = product(normalised(g.0), CUBE[n].quaternion).map(|c| (sign * c) as f32);
        let scales = CUBE[n].axis.map(|k| g.1[usize::from(k)]);
        let (qa, sa) = canonicalise(g.0, g.1);
        let (qb, sb) = canonicalise(other, scales);
        let dot: f64 = (0..4).map(|k| f64::from(qa[k]) * f64::from(qb[k])).sum();
        prop_assert!((qa[0] - qb[0]).abs() < 2e-6);
        // On the border between two representatives either is right.
        prop_assert!(dot > 1.0 - 1e-5 && sa == sb || on_border(g.0));
    }

    #[test]
    fn the_angle_is_bounded(g in gaussian()) {
        let (q, _) = canonicalise(g.0, g.1);
        prop_assert!(q[0] >= 0.8535, "{q:?}");
    }

    #[test]
    fn a_second_pass_changes_nothing(g in gaussian()) {
        let (q, s) = canonicalise(g.0, g.1);
        let (again, scales) = canonicalise(q, s);
        prop_assert_eq!(s, scales);
        for k in 0..4 {
            prop_assert!((q[k] - again[k]).abs() <= 1.2e-7);
        }
    }
}

/// Whether two representatives are within rounding of each other in |w|.
fn on_border(q: [f32; 4]) -> bool {
    let q = normalised(q);
    let mut sizes = CUBE.each_ref().map(|e| product(q, e.quaternion)[0].abs());
    sizes.sort_by(|a, b| b.total_cmp(a));
    sizes[0] - sizes[1] < 2e-6
}

//! Unit quaternions as their three smallest components, which several formats store.

/// A quaternion at unit norm; the identity for one without direction.
pub(crate) fn unit(q: [f32; 4]) -> [f64; 4] {
    let q = q.map(f64::from);
    let norm = q.iter().map(|v| v * v).sum::<f64>().sqrt();
    let known = norm > 0.0 && norm.is_finite();
    if known { q.map(|v| v / norm) } else { [1.0, 0.0, 0.0, 0.0] }
}

/// The place of the largest component, in any order of the components, and the others. Their signs are
/// those of the quaternion whose largest component is positive.
pub(crate) fn smallest_three(q: [f64; 4]) -> (usize, [f64; 3]) {
    let largest = (1..4).fold(0, |best, k| if q[k].abs() > q[best].abs() { k } else { best });
    let sign = if q[largest] < 0.0 { -1.0 } else { 1.0 };
    let mut others = (0..4).filter(|&k| k != largest);
    (largest, std::array::from_fn(|_| others.next().map_or(0.0, |k| sign * q[k])))
}

/// The quaternion of three components and the place of the fourth, which makes the norm 1.
pub(crate) fn completed(largest: usize, others: [f64; 3]) -> [f32; 4] {
    let mut q = [0.0; 4];
    let slots = q.iter_mut().enumerate().filter(|&(k, _)| k != largest);
    slots.zip(others).for_each(|((_, slot), v)| *slot = v);
    q[largest] = (1.0 - q.iter().map(|v| v * v).sum::<f64>()).max(0.0).sqrt();
    q.map(|v| v as f32)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_quaternion_is_completed_to_itself() {
        for q in [[1.0f32, 0.0, 0.0, 0.0], [-0.1, 0.9, -0.3, 0.2], [0.5, -0.5, 0.5, -0.5], [0.0; 4]]
        {
            let (largest, others) = smallest_three(unit(q));
            let back = completed(largest, others);
            let dot: f64 = unit(q).iter().zip(back).map(|(a, b)| a * f64::from(b)).sum();
            assert!((dot.abs() - 1.0).abs() < 1e-6 && back[largest] > 0.0, "{q:?} -> {back:?}");
        }
    }
}

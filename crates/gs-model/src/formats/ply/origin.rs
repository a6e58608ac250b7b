//! Positions far from the origin: doubles that floats would round are kept relative to an origin, which files name in
//! a comment, `comment origin X Y Z`.

/// Rows that decide whether positions need an origin.
pub(super) const SAMPLE: usize = 1000;
/// A step of floats above this part of a Gaussian's largest axis is avoided.
const FINE: f64 = 1.0 / 64.0;
/// An origin is chosen if the steps are too large for one Gaussian in so many.
const ONE_IN: usize = 10;

/// What to subtract from the positions of a model of which these are positions and log-scales of the largest axis; 0
/// where floats hold them well.
pub(super) fn choose(sample: &[([f64; 3], f64)]) -> [f64; 3] {
    let finite = |(position, size): &&([f64; 3], f64)| {
        position.iter().all(|x| x.is_finite()) && size.is_finite()
    };
    let sample: Vec<_> = sample.iter().filter(finite).collect();
    let rounded = |x: f64| f64::from(x as f32);
    let is_coarse = |(position, log_size): &([f64; 3], f64)| {
        let far = position.iter().fold(0f64, |far, x| far.max(x.abs()));
        let step = f64::from((far as f32).next_up()) - rounded(far);
        // Doubles that hold floats have already lost their precision: an origin would not help.
        step > FINE * libm::exp(*log_size) && position.iter().any(|&x| rounded(x) != x)
    };
    if sample.iter().filter(|row| is_coarse(row)).count() * ONE_IN <= sample.len() {
        return [0.0; 3];
    }
    let sorted = |k: usize| {
        let mut values: Vec<f64> = sample.iter().map(|(position, _)| position[k]).collect();
        values.sort_unstable_by(f64::total_cmp);
        values
    };
    let axes = [0, 1, 2].map(sorted);
    // A round number: a power of two about as large as the model.
    let part = |values: &[f64]| values[values.len() * 9 / 10] - values[values.len() / 10];
    let width = axes.iter().map(|values| part(values)).fold(0.0, f64::max);
    let unit = if width > 0.0 { libm::exp2(libm::floor(libm::log2(width))) } else { 1.0 };
    axes.map(|values| libm::round(values[values.len() / 2] / unit) * unit)
}

/// The comment of an origin; nothing if it is 0.
pub(super) fn comment(origin: [f64; 3]) -> String {
    let [x, y, z] = origin;
    if origin == [0.0; 3] { String::new() } else { format!("comment origin {x} {y} {z}\n") }
}

/// The origin that a comment names.
pub(super) fn of_comment(comment: &str) -> Option<[f64; 3]> {
    let mut words = comment.split_ascii_whitespace();
    let named = words.next()?.eq_ignore_ascii_case("origin");
    let mut next = || words.next()?.parse().ok().filter(|x: &f64| x.is_finite());
    let origin = [next()?, next()?, next()?];
    (named && words.next().is_none()).then_some(origin)
}

/// The origin that a file names; 0 without one.
pub(super) fn of_file(comments: &[String]) -> [f64; 3] {
    comments.iter().find_map(|c| of_comment(c)).unwrap_or_default()
}

/// A sentence about an origin that was chosen.
pub(super) fn note([x, y, z]: [f64; 3]) -> String {
    format!(
        "floats lack the precision for its positions, which are kept relative to the origin ({x}, {y}, {z})"
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sample(at: f64, log_size: f64) -> Vec<([f64; 3], f64)> {
        (0..100).map(|i| ([at + 0.1 * f64::from(i), -at, 3.3], log_size)).collect()
    }

    #[test]
    fn an_origin_is_chosen_where_floats_are_coarse_beside_the_gaussians() {
        assert_eq!(choose(&sample(5_400_000.0, -4.0)), [5_400_008.0, -5_400_000.0, 0.0]);
        assert_eq!(choose(&sample(5_400_000.0, 6.0)), [0.0; 3], "large Gaussians");
        assert_eq!(choose(&sample(5.0, -4.0)), [0.0; 3]);
        assert_eq!(choose(&[]), [0.0; 3]);
        let floats = sample(5_400_000.0, -4.0).into_iter();
        let floats: Vec<_> = floats.map(|(p, s)| (p.map(|x| f64::from(x as f32)), s)).collect();
        assert_eq!(choose(&floats), [0.0; 3], "nothing is won");
        assert_eq!(choose(&[([f64::NAN; 3], -4.0), ([f64::INFINITY, 0.0, 0.0], -4.0)]), [0.0; 3]);
    }

    #[test]
    fn a_comment_gives_the_origin_back_bit_for_bit() {
        for origin in [[500_000.1, -5_400_000.25, 0.0], [1e-300, 1e300, -0.1]] {
            let line = comment(origin);
            assert_eq!(of_comment(line.strip_prefix("comment ").unwrap()), Some(origin));
        }
        assert_eq!(comment([0.0; 3]), "");
        for bad in ["origin 1 2", "origin 1 2 3 4", "origin 1 2 inf", "original 1 2 3", ""] {
            assert_eq!(of_comment(bad), None, "{bad}");
        }
    }
}

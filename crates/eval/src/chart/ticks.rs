//! Lays out an axis: its range, and its ticks with their labels.

/// An axis laid out: places are values, or their decimal logarithms.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Placed {
    /// Ends, in places.
    pub(super) range: (f64, f64),
    /// Places with their labels, ascending.
    pub(super) ticks: Vec<(f64, String)>,
}

/// Share of the span left free on either side.
const AIR: f64 = 0.04;
/// Labels aimed at along an axis.
const LABELS: f64 = 7.0;

fn ends(values: impl Iterator<Item = f64>) -> Option<(f64, f64)> {
    let (low, high) = values
        .filter(|v| v.is_finite())
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
    (low <= high).then_some((low, high))
}

fn airy((low, high): (f64, f64)) -> (f64, f64) {
    let pad = ((high - low) * AIR).max(1e-3 * high.abs().max(1e-3));
    (low - pad, high + pad)
}

/// Multiples of 1, 2 or 5 times a power of ten.
pub(super) fn linear(values: impl Iterator<Item = f64>) -> Placed {
    let range = airy(ends(values).unwrap_or((0.0, 1.0)));
    let rough = (range.1 - range.0) / LABELS;
    let power = 10f64.powf(rough.log10().floor());
    let step = [1.0, 2.0, 5.0, 10.0].map(|m| m * power).into_iter().find(|s| *s >= rough);
    let step = step.unwrap_or(10.0 * power);
    let decimals = (-step.log10().floor()).clamp(0.0, 9.0) as usize;
    let first = (range.0 / step).ceil() as i64;
    let last = (range.1 / step).floor() as i64;
    let tick = |i: i64| {
        let value = i as f64 * step;
        (value, format!("{value:.decimals$}"))
    };
    Placed { range, ticks: (first..=last).map(tick).collect() }
}

/// 1, 2 and 5 of each decade, or more of them where the axis is short.
pub(super) fn logarithmic(values: impl Iterator<Item = f64>) -> Placed {
    let range = airy(ends(values.map(f64::log10)).unwrap_or((0.0, 1.0)));
    let candidates = |mantissas: &[f64]| -> Vec<f64> {
        let (first, last) = (range.0.floor() as i32, range.1.ceil() as i32);
        let all = (first..=last).flat_map(|d| mantissas.iter().map(move |m| m * 10f64.powi(d)));
        all.filter(|v| (range.0..=range.1).contains(&v.log10())).collect()
    };
    let sets: [&[f64]; 4] = [
        &[1.0],
        &[1.0, 2.0, 5.0],
        &[1.0, 1.5, 2.0, 3.0, 5.0, 7.0],
        &[1.0, 1.2, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0],
    ];
    let chosen = sets.into_iter().map(candidates).find(|t| t.len() >= 4);
    let chosen = chosen.unwrap_or_else(|| candidates(sets[3]));
    if chosen.len() < 2 {
        // Too narrow for round numbers of a decade.
        let ends = [range.0, range.1].map(|p| 10f64.powf(p));
        let ticks = linear(ends.into_iter()).ticks.into_iter().map(|(v, text)| (v.log10(), text));
        let inside = |t: &(f64, String)| (range.0..=range.1).contains(&t.0);
        return Placed { range, ticks: ticks.filter(inside).collect() };
    }
    let label = |v: f64| {
        if !(1e-3..1e6).contains(&v) {
            return format!("{v:.1e}").replace(".0e", "e");
        }
        let decimals = (1.0 - v.log10().floor()).clamp(0.0, 9.0) as usize;
        let text = format!("{v:.decimals$}");
        if text.contains('.') {
            text.trim_end_matches('0').trim_end_matches('.').to_owned()
        } else {
            text
        }
    };
    Placed { range, ticks: chosen.into_iter().map(|v| (v.log10(), label(v))).collect() }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn labels(placed: &Placed) -> Vec<&str> {
        placed.ticks.iter().map(|t| t.1.as_str()).collect()
    }

    #[test]
    fn decibels_get_round_numbers() {
        assert_eq!(
            labels(&linear([26.1, 31.9].into_iter())),
            ["26", "27", "28", "29", "30", "31", "32"]
        );
        assert_eq!(labels(&linear([30.0, 30.1].into_iter())), ["30.00", "30.05", "30.10"]);
    }

    #[test]
    fn sizes_over_a_decade_are_1_2_5() {
        assert_eq!(labels(&logarithmic([0.16, 4.5].into_iter())), ["0.2", "0.5", "1", "2", "5"]);
        assert_eq!(labels(&logarithmic([0.9, 2.1].into_iter())), ["1", "1.2", "1.5", "2"]);
    }

    #[test]
    fn a_narrow_logarithmic_axis_has_numbers() {
        let narrow = logarithmic([0.0241, 0.0254].into_iter());
        assert!(labels(&narrow).len() >= 2, "{narrow:?}");
        assert!(
            narrow.ticks.iter().all(|(at, text)| {
                (10f64.powf(*at) - text.parse::<f64>().unwrap()).abs() < 1e-9
            })
        );
        assert!(!labels(&logarithmic([47.0].into_iter())).is_empty());
    }

    #[test]
    fn ranges_are_never_empty_and_hold_the_values() {
        for values in [vec![], vec![3.0], vec![1.0, 2.0], vec![f64::NAN, 5.0], vec![1e-4, 1e5]] {
            for placed in [linear(values.iter().copied()), logarithmic(values.iter().copied())] {
                assert!(placed.range.0 < placed.range.1, "{placed:?}");
                let inside = |t: &(f64, String)| (placed.range.0..=placed.range.1).contains(&t.0);
                assert!(placed.ticks.iter().all(inside) && placed.ticks.len() < 16, "{placed:?}");
            }
        }
    }
}

//! Bjontegaard differences between rate-distortion curves (VCEG-M33): between the upper-left convex hulls, by monotone
//! interpolation (pchip).

/// One operating point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Point {
    /// Rate, any unit, positive.
    pub(crate) rate: f64,
    /// How good the pictures are, by any measure of which more is better.
    pub(crate) score: f64,
}

impl Point {
    /// The point in MB of one in bytes, as charts have it.
    pub(crate) fn in_mb(self) -> (f64, f64) {
        (self.rate / 1e6, self.score)
    }
}

/// BD-rate: mean rate difference at equal score of `test` against `anchor`, per cent (negative: `test` is smaller).
/// `None` if the curves share no range of scores or have fewer than two points on their hulls.
pub(crate) fn bd_rate(anchor: &[Point], test: &[Point]) -> Option<f64> {
    let by_score = |points: &[Point]| -> (Vec<f64>, Vec<f64>) {
        hull(points).iter().map(|p| (p.score, p.rate.log10())).unzip()
    };
    Some((10f64.powf(mean_gap(by_score(anchor), by_score(test))?) - 1.0) * 100.0)
}

/// Mean difference of the score at equal rate of `test` against `anchor`; of PSNR it is the BD-PSNR, dB.
pub(crate) fn bd_score(anchor: &[Point], test: &[Point]) -> Option<f64> {
    let by_rate = |points: &[Point]| -> (Vec<f64>, Vec<f64>) {
        hull(points).iter().map(|p| (p.rate.log10(), p.score)).unzip()
    };
    mean_gap(by_rate(anchor), by_rate(test))
}

/// Mean difference of two curves over the interval that both cover.
fn mean_gap(anchor: (Vec<f64>, Vec<f64>), test: (Vec<f64>, Vec<f64>)) -> Option<f64> {
    let (anchor, test) = (Pchip::through(anchor)?, Pchip::through(test)?);
    let low = anchor.xs[0].max(test.xs[0]);
    let high = anchor.xs[anchor.xs.len() - 1].min(test.xs[test.xs.len() - 1]);
    let mean = (test.integral(low, high) - anchor.integral(low, high)) / (high - low);
    (low < high && mean.is_finite()).then_some(mean)
}

/// The rate of a curve at a score, linear between the points of its hull; `None` beyond its ends.
pub(crate) fn rate_at(curve: &[Point], score: f64) -> Option<f64> {
    at(hull(curve).iter().map(|p| (p.score, p.rate)).collect(), score)
}

/// The score of a curve at a rate, on its hull; `None` outside the rates of its points.
pub(crate) fn score_at(curve: &[Point], rate: f64) -> Option<f64> {
    at(hull(curve).iter().map(|p| (p.rate, p.score)).collect(), rate)
}

/// The ordinate at `x` of a line through points of rising abscissae; `None` beyond its ends.
pub(crate) fn at(line: Vec<(f64, f64)>, x: f64) -> Option<f64> {
    line.windows(2).find_map(|w| {
        let ((x0, y0), (x1, y1)) = (w[0], w[1]);
        (x0..=x1).contains(&x).then(|| y0 + (y1 - y0) * (x - x0) / (x1 - x0))
    })
}

/// The upper-left convex hull (rate linear): the points that no mixture of others beats, by
/// rising rate and score.
pub(crate) fn hull(points: &[Point]) -> Vec<Point> {
    let mut sorted: Vec<Point> = points.iter().copied().filter(|p| p.rate.is_finite()).collect();
    sorted.sort_by(|a, b| a.rate.total_cmp(&b.rate).then(b.score.total_cmp(&a.score)));
    let mut out: Vec<Point> = Vec::new();
    for p in sorted {
        if out.last().is_some_and(|last| p.score <= last.score) {
            continue;
        }
        while let [.., a, b] = out[..] {
            let slope = |u: Point, v: Point| (v.score - u.score) / (v.rate - u.rate);
            if slope(a, b) > slope(b, p) {
                break;
            }
            out.pop();
        }
        out.push(p);
    }
    out
}

/// Piecewise cubic Hermite interpolation with Fritsch and Butland's slopes (1984), as in SciPy
/// and Matlab: monotone where the data are.
struct Pchip {
    xs: Vec<f64>,
    ys: Vec<f64>,
    slopes: Vec<f64>,
}

impl Pchip {
    /// Through points of strictly rising `xs`; `None` otherwise or for fewer than two.
    fn through((xs, ys): (Vec<f64>, Vec<f64>)) -> Option<Self> {
        if xs.len() < 2 || !xs.is_sorted_by(|a, b| a < b) {
            return None;
        }
        let slopes = slopes(&xs, &ys);
        Some(Self { xs, ys, slopes })
    }

    /// Integral from the left end of piece `i` to `x` inside it.
    fn part(&self, i: usize, x: f64) -> f64 {
        let h = self.xs[i + 1] - self.xs[i];
        let t = (x - self.xs[i]) / h;
        let (t2, t3, t4) = (t * t, t * t * t, t * t * t * t);
        // Antiderivatives of the four Hermite basis functions.
        let h00 = t4 / 2.0 - t3 + t;
        let h10 = t4 / 4.0 - 2.0 * t3 / 3.0 + t2 / 2.0;
        let h01 = -t4 / 2.0 + t3;
        let h11 = t4 / 4.0 - t3 / 3.0;
        h * (self.ys[i] * h00
            + self.ys[i + 1] * h01
            + h * (self.slopes[i] * h10 + self.slopes[i + 1] * h11))
    }

    fn integral(&self, a: f64, b: f64) -> f64 {
        (0..self.xs.len() - 1)
            .map(|i| {
                let (low, high) = (a.max(self.xs[i]), b.min(self.xs[i + 1]));
                if low < high { self.part(i, high) - self.part(i, low) } else { 0.0 }
            })
            .sum()
    }
}

fn slopes(xs: &[f64], ys: &[f64]) -> Vec<f64> {
    let h: Vec<f64> = xs.windows(2).map(|w| w[1] - w[0]).collect();
    let d: Vec<f64> = ys.windows(2).zip(&h).map(|(w, h)| (w[1] - w[0]) / h).collect();
    let n = xs.len();
    if n == 2 {
        return vec![d[0]; 2];
    }
    let mut out = vec![0.0; n];
    for i in 1..n - 1 {
        if d[i - 1] * d[i] > 0.0 {
            let (w1, w2) = (2.0 * h[i] + h[i - 1], h[i] + 2.0 * h[i - 1]);
            out[i] = (w1 + w2) / (w1 / d[i - 1] + w2 / d[i]);
        }
    }
    out[0] = end_slope(h[0], h[1], d[0], d[1]);
    out[n - 1] = end_slope(h[n - 2], h[n - 3], d[n - 2], d[n - 3]);
    out
}

/// Three-point slope at an end, limited so that the piece stays monotone.
fn end_slope(h0: f64, h1: f64, d0: f64, d1: f64) -> f64 {
    let m = ((2.0 * h0 + h1) * d0 - h0 * d1) / (h0 + h1);
    if m * d0 <= 0.0 {
        0.0
    } else if d0 * d1 <= 0.0 && m.abs() > 3.0 * d0.abs() {
        3.0 * d0
    } else {
        m
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::published;

    fn points(list: &[(f64, f64)]) -> Vec<Point> {
        list.iter().map(|&(rate, score)| Point { rate, score }).collect()
    }

    /// The paper's curves: figures of the reference notes, computed with NumPy and SciPy.
    #[test]
    fn the_papers_curves() {
        for (scene, rate, gain) in [("playroom", -13.05, 0.112), ("truck", -12.00, 0.233)] {
            let [anchor, test] = published::uniform_and_adaptive(scene).unwrap();
            let got = bd_rate(&anchor, &test).unwrap();
            assert!((got - rate).abs() < 0.01, "{scene}: {got}");
            let got = bd_score(&anchor, &test).unwrap();
            assert!((got - gain).abs() < 0.001, "{scene}: {got}");
        }
    }

    #[test]
    fn half_the_rate_is_minus_fifty_per_cent_and_a_constant_lift_is_the_bd_score() {
        let anchor = points(&[(10.0, 30.0), (20.0, 32.0), (40.0, 33.5), (80.0, 34.5)]);
        let half: Vec<Point> = anchor.iter().map(|p| Point { rate: p.rate / 2.0, ..*p }).collect();
        assert!((bd_rate(&anchor, &half).unwrap() + 50.0).abs() < 1e-9);
        assert!(bd_rate(&anchor, &anchor).unwrap().abs() < 1e-9);
        let lifted = |p: &Point| Point { score: p.score + 0.7, ..*p };
        let lifted: Vec<Point> = anchor.iter().map(lifted).collect();
        assert!((bd_score(&anchor, &lifted).unwrap() - 0.7).abs() < 1e-9);
    }

    #[test]
    fn no_overlap_and_too_few_points_are_none() {
        let low = points(&[(1.0, 20.0), (2.0, 21.0), (3.0, 22.0), (4.0, 23.0)]);
        let high = points(&[(1.0, 30.0), (2.0, 31.0), (3.0, 32.0), (4.0, 33.0)]);
        assert_eq!(bd_rate(&low, &high), None);
        assert_eq!(bd_rate(&low[..1], &low), None);
    }

    #[test]
    fn hull_drops_what_a_mixture_beats() {
        let all = points(&[(1.0, 20.0), (2.0, 21.0), (3.0, 26.0), (4.0, 25.0), (5.0, 28.0)]);
        assert_eq!(hull(&all), points(&[(1.0, 20.0), (3.0, 26.0), (5.0, 28.0)]));
    }

    #[test]
    fn a_rate_is_read_off_between_points() {
        let curve = points(&[(100.0, 20.0), (200.0, 30.0), (400.0, 32.0)]);
        assert_eq!(rate_at(&curve, 25.0), Some(150.0));
        assert_eq!(score_at(&curve, 150.0), Some(25.0));
        assert_eq!(rate_at(&curve, 32.0), Some(400.0));
        assert_eq!((rate_at(&curve, 33.0), rate_at(&curve, 19.0)), (None, None));
    }
}

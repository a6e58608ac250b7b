//! Bjontegaard differences between rate-distortion curves (VCEG-M33), by cubic fit as in the
//! paper and by monotone interpolation (pchip), and the upper-left convex hull.

mod cubic;
mod pchip;

/// One operating point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Point {
    /// Rate, any unit, positive.
    pub rate: f64,
    /// PSNR in dB.
    pub psnr_db: f64,
}

/// How a curve is drawn through the points.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Method {
    /// Least-squares cubic of one axis over the other; any point set of four or more.
    Cubic,
    /// Shape-preserving piecewise cubic through the points; they must rise together, so pass
    /// a hull. Two or more.
    Pchip,
}

/// An integrable curve over an interval.
trait Curve {
    /// Integral from `a` to `b` inside the interval of the data.
    fn integral(&self, a: f64, b: f64) -> f64;
}

fn curve(method: Method, xs: &[f64], ys: &[f64]) -> Option<Box<dyn Curve>> {
    match method {
        Method::Cubic => cubic::Cubic::fit(xs, ys).map(|c| Box::new(c) as _),
        Method::Pchip => pchip::Pchip::through(xs, ys).map(|c| Box::new(c) as _),
    }
}

/// Mean difference of two curves over the interval that both cover. `None` if they do not
/// overlap or a curve cannot be drawn.
fn mean_gap(method: Method, anchor: &Columns, test: &Columns) -> Option<f64> {
    let ends = |xs: &[f64]| {
        let low = xs.iter().copied().fold(f64::INFINITY, f64::min);
        (low, xs.iter().copied().fold(f64::NEG_INFINITY, f64::max))
    };
    let ((a0, a1), (t0, t1)) = (ends(&anchor.x), ends(&test.x));
    let (low, high) = (a0.max(t0), a1.min(t1));
    if low.is_nan() || high.is_nan() || low >= high {
        return None;
    }
    let gap = curve(method, &test.x, &test.y)?.integral(low, high)
        - curve(method, &anchor.x, &anchor.y)?.integral(low, high);
    let mean = gap / (high - low);
    mean.is_finite().then_some(mean)
}

/// The coordinates of points.
struct Columns {
    x: Vec<f64>,
    y: Vec<f64>,
}

impl Columns {
    /// PSNR over the logarithm of the rate.
    fn of(points: &[Point]) -> Self {
        let mut sorted = points.to_vec();
        sorted.sort_by(|a, b| a.rate.total_cmp(&b.rate));
        let (x, y) = sorted.iter().map(|p| (p.rate.log10(), p.psnr_db)).unzip();
        Self { x, y }
    }

    fn turned(self) -> Self {
        Self { x: self.y, y: self.x }
    }
}

/// BD-rate: mean rate difference at equal PSNR of `test` against `anchor`, per cent (negative:
/// `test` is smaller). `None` if the PSNR ranges do not overlap or there are too few points.
pub fn bd_rate(anchor: &[Point], test: &[Point], method: Method) -> Option<f64> {
    let [anchor, test] = [anchor, test].map(|points| Columns::of(points).turned());
    let gap = mean_gap(method, &anchor, &test)?;
    Some((10f64.powf(gap) - 1.0) * 100.0)
}

/// BD-PSNR: mean PSNR difference at equal rate of `test` against `anchor`, dB.
pub fn bd_psnr(anchor: &[Point], test: &[Point], method: Method) -> Option<f64> {
    mean_gap(method, &Columns::of(anchor), &Columns::of(test))
}

/// The rate of a curve at a PSNR, linear between the points of its hull; `None` beyond its ends.
pub fn rate_at(curve: &[Point], psnr_db: f64) -> Option<f64> {
    hull(curve).windows(2).find_map(|w| {
        let (a, b) = (w[0], w[1]);
        ((a.psnr_db..=b.psnr_db).contains(&psnr_db))
            .then(|| a.rate + (b.rate - a.rate) * (psnr_db - a.psnr_db) / (b.psnr_db - a.psnr_db))
    })
}

/// The PSNR of a curve at a rate, on its hull; `None` outside the rates of its points.
pub fn psnr_at(curve: &[Point], rate: f64) -> Option<f64> {
    hull(curve).windows(2).find_map(|w| {
        let (a, b) = (w[0], w[1]);
        ((a.rate..=b.rate).contains(&rate))
            .then(|| a.psnr_db + (b.psnr_db - a.psnr_db) * (rate - a.rate) / (b.rate - a.rate))
    })
}

/// The upper-left convex hull (rate linear): the points that no mixture of others beats, by
/// rising rate and PSNR.
pub fn hull(points: &[Point]) -> Vec<Point> {
    let mut sorted: Vec<Point> = points.iter().copied().filter(|p| p.rate.is_finite()).collect();
    sorted.sort_by(|a, b| a.rate.total_cmp(&b.rate).then(b.psnr_db.total_cmp(&a.psnr_db)));
    let mut out: Vec<Point> = Vec::new();
    for p in sorted {
        if out.last().is_some_and(|last| p.psnr_db <= last.psnr_db) {
            continue;
        }
        while let [.., a, b] = out[..] {
            let slope = |u: Point, v: Point| (v.psnr_db - u.psnr_db) / (v.rate - u.rate);
            if slope(a, b) > slope(b, p) {
                break;
            }
            out.pop();
        }
        out.push(p);
    }
    out
}

#[cfg(test)]
mod tests;

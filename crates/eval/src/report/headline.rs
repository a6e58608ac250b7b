//! What a reader wants first: how many bytes gsvx needs for the same picture, beside what.

use crate::bd;
use crate::measure::Metric;
use crate::published::PAPER_CHAIN;
use crate::rd_curve::plan::{
    ALL_KEPT, GSVX, NO_CAMERAS, PAPER, PAPER_CRITERIA, PAPER_TUNED, TUNED, UNIFORM,
};
use crate::record::{Curve, Record, Run};

/// The bytes of gsvx beside those of something else at an equal score.
pub(super) struct Comparison {
    /// Of the curve of `gsvx tune`.
    pub(super) tuned: bool,
    /// Per cent; negative if gsvx is smaller.
    pub(super) difference: f64,
    /// Name of the curve that it is compared with.
    pub(super) anchor: String,
    /// The same in words.
    pub(super) against: String,
    /// At which quality.
    pub(super) at: String,
}

/// What a curve is, for someone who has not seen its name before.
pub(crate) fn in_words(name: &str) -> String {
    match name {
        GSVX => "gsvx without tuning (`gsvx`)".into(),
        UNIFORM => "the same coding on an octree of one depth (`uniform`)".into(),
        PAPER_CRITERIA => {
            "the same merging and coding on an octree by the paper's criteria (`paper's criteria`)"
                .into()
        }
        PAPER => "the paper that gsvx follows, not fine-tuned either (`paper, not tuned`)".into(),
        PAPER_TUNED => "the paper that gsvx follows, fine-tuned (`paper, fine-tuned`)".into(),
        NO_CAMERAS => "gsvx without cameras".into(),
        ALL_KEPT => "gsvx with cameras, which keeps what they hardly see".into(),
        PAPER_CHAIN => {
            "the paper's authors' tools, not fine-tuned, covariances without loss only".into()
        }
        other => other.into(),
    }
}

/// All comparisons, the strongest first.
pub(super) fn comparisons(run: &Run) -> Vec<Comparison> {
    let mut out: Vec<Comparison> = Vec::new();
    for bd in run.bd.iter().filter(|b| [GSVX, TUNED].contains(&b.test.as_str())) {
        // The metric that favours gsvx least.
        let least = Metric::ALL.iter().zip(bd.rates).filter_map(|(m, rate)| Some((m, rate?)));
        if let Some((metric, difference)) = least.max_by(|a, b| a.1.total_cmp(&b.1)) {
            let known = bd.rates.iter().flatten().count();
            let at = match known {
                1 => format!("at equal {}, on average over the curve", metric.name()),
                _ => format!(
                    "at equal {}, the least favourable of {known} metrics, on average over the curve",
                    metric.name()
                ),
            };
            let (tuned, anchor) = (bd.test == TUNED, bd.anchor.clone());
            let against = in_words(&anchor);
            out.push(Comparison { tuned, difference, anchor, against, at });
        }
    }
    // Codecs of one setting have no curve.
    let single = |o: &&Curve| !o.is_published() && !run.bd.iter().any(|b| b.anchor == o.name);
    if let Some(gsvx) = run.curves.iter().find(|c| c.name == GSVX) {
        for other in run.others.iter().filter(single) {
            let difference = |p: &Record| {
                // A lossless archive is no competitor.
                let lossy = 2 * p.bytes <= run.original.bytes;
                let against = |metric| {
                    let rate = bd::rate_at(&gsvx.rates(metric), metric.of(&p.score))?;
                    Some(100.0 * (rate / p.bytes.max(1) as f64 - 1.0))
                };
                Metric::ALL.into_iter().filter(|_| lossy).filter_map(against).reduce(f64::max)
            };
            let weakest = other.points.iter().filter_map(difference).reduce(f64::max);
            if let Some(difference) = weakest {
                let at = "at its own picture quality, by the least favourable metric".into();
                let (anchor, against) = (other.name.clone(), in_words(&other.name));
                out.push(Comparison { tuned: false, difference, anchor, against, at });
            }
        }
    }
    out.sort_by(|a, b| a.difference.total_cmp(&b.difference));
    out
}

/// "84 % fewer", "3 % more", without a line break inside.
fn amount(difference: f64) -> String {
    let word = if difference <= 0.0 { "fewer" } else { "more" };
    format!("{:.0}\u{a0}%\u{a0}{word}", difference.abs())
}

/// What stands in brackets is for the cards.
fn without_brackets(text: &str) -> &str {
    text.split(" (`").next().unwrap_or(text)
}

/// The strongest comparison, after the name of the scene.
pub(super) fn title(scene: &str, all: &[Comparison]) -> String {
    match all.iter().find(|c| c.is_on_a_card()) {
        Some(c) => format!(
            "{scene}: for the same picture quality, gsvx{} needs {} bytes than {}",
            if c.tuned { " tune" } else { "" },
            amount(c.difference),
            without_brackets(&c.against)
        ),
        None => format!("{scene}: picture quality over size"),
    }
}

impl Comparison {
    /// Like with like: tuned against the paper fine-tuned and against untuned, untuned against the paper untuned and SPZ.
    fn is_on_a_card(&self) -> bool {
        match (self.anchor.as_str(), self.tuned) {
            (anchor, true) => [GSVX, PAPER_TUNED].contains(&anchor),
            (anchor, false) => anchor == PAPER || anchor.starts_with("SPZ"),
        }
    }
}

/// Figures with what they are, one a line.
pub(super) fn highlights(run: &Run, all: &[Comparison]) -> Vec<(String, String)> {
    let mut out: Vec<(String, String)> = all
        .iter()
        .filter(|c| c.is_on_a_card())
        .map(|c| {
            let tuned = if c.tuned { ", tuned," } else { "" };
            (amount(c.difference), format!("bytes{tuned} than {}, {}", c.against, c.at))
        })
        .collect();
    // The smallest stream that equals the uncompressed model by all metrics, or else by PSNR.
    let equals = |p: &Record, metrics: &[Metric]| {
        metrics.iter().all(|m| m.of(&p.score) >= m.of(&run.original.score))
    };
    let ours = run.curves.iter().filter(|c| [GSVX, TUNED].contains(&c.name.as_str()));
    let points = ours.flat_map(|c| c.points.iter().map(|p| (p, c.name == TUNED)));
    let points: Vec<(&Record, bool)> = points.collect();
    let smallest = |metrics: &[Metric]| {
        points.iter().filter(|(p, _)| equals(p, metrics)).min_by_key(|(p, _)| p.bytes)
    };
    let by_all = smallest(&Metric::ALL);
    if let Some(&(p, tuned)) = by_all.or_else(|| smallest(&[Metric::Psnr])) {
        let by = if by_all.is_some() {
            "PSNR, SSIM and SSIMULACRA2"
        } else {
            "PSNR, not in SSIM and SSIMULACRA2"
        };
        out.push((
            format!("{:.0}x", run.original.bytes as f64 / p.bytes.max(1) as f64),
            format!(
                "smaller than the model's PLY and equal to it in {by}: {} MB, {}at quality {:.0}",
                p.megabytes(),
                if tuned { "tuned " } else { "" },
                p.quality
            ),
        ));
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_strongest_comparison_comes_first_in_plain_words() {
        let comparison = |difference, name| {
            let against = in_words(name);
            Comparison { tuned: false, difference, anchor: name.into(), against, at: String::new() }
        };
        let all =
            [comparison(-90.0, PAPER_CHAIN), comparison(-54.2, PAPER), comparison(2.6, UNIFORM)];
        assert_eq!(
            title("fox", &all).replace('\u{a0}', " "),
            "fox: for the same picture quality, gsvx needs 54 % fewer bytes than the paper that gsvx follows, not \
             fine-tuned either"
        );
        let tuned = [Comparison { tuned: true, ..comparison(-90.0, GSVX) }];
        assert_eq!(
            title("fox", &tuned).replace('\u{a0}', " "),
            "fox: for the same picture quality, gsvx tune needs 90 % fewer bytes than gsvx without tuning"
        );
        assert_eq!(title("fox", &[]), "fox: picture quality over size");
    }
}

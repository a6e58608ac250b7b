//! What a reader wants first: how many bytes gsvx needs for the same picture, beside what.

use crate::bd;
use crate::published::Other;
use crate::rd_curve::plan::{GSVX, PAPER_CODING, PAPER_CRITERIA, UNIFORM};
use crate::rd_curve::record::{Coded, Run};

/// Comparisons in the sentence.
const MOST: usize = 3;

/// The bytes of gsvx beside those of something else at equal PSNR.
pub(super) struct Comparison {
    /// Per cent; negative if gsvx is smaller.
    pub(super) difference: f64,
    /// What it is compared with, in words.
    pub(super) against: String,
    /// How.
    pub(super) how: &'static str,
}

/// What a curve is, for someone who has not seen its name before.
pub(crate) fn in_words(name: &str) -> String {
    match name {
        UNIFORM => "the same coding on an octree of one depth (`uniform`)".into(),
        PAPER_CRITERIA => {
            "the same coding on the paper's adaptive octree (`paper's criteria`)".into()
        }
        PAPER_CODING => "the paper's coding".into(),
        other => other.into(),
    }
}

/// All comparisons, the strongest first.
pub(super) fn comparisons(run: &Run) -> Vec<Comparison> {
    let mut out: Vec<Comparison> = Vec::new();
    for bd in run.bd.iter().filter(|b| b.test == GSVX) {
        if let Some(difference) = bd.rate_pchip.or(bd.rate_cubic) {
            let how = "mean over all qualities that both reach (BD-rate)";
            out.push(Comparison { difference, against: in_words(&bd.anchor), how });
        }
    }
    // Codecs of one setting have no curve.
    let single = |o: &&Other| !o.is_published() && !run.bd.iter().any(|b| b.anchor == o.name);
    if let Some(gsvx) = run.curves.iter().find(|c| c.name == GSVX) {
        for other in run.others.iter().filter(single) {
            let difference = |p: &crate::published::OtherPoint| {
                // A lossless archive is no competitor.
                let lossy = 2 * p.bytes <= run.original.file_bytes;
                let rate = bd::rate_at(&gsvx.rates(), p.psnr_db).filter(|_| lossy)?;
                Some(100.0 * (rate / p.bytes.max(1) as f64 - 1.0))
            };
            let weakest = other.points.iter().filter_map(difference).reduce(f64::max);
            if let Some(difference) = weakest {
                let how = "at its own PSNR";
                out.push(Comparison { difference, against: other.name.clone(), how });
            }
        }
    }
    out.sort_by(|a, b| a.difference.total_cmp(&b.difference));
    out
}

/// "84 % fewer bytes", "3 % more bytes".
fn amount(difference: f64) -> String {
    let word = if difference <= 0.0 { "fewer" } else { "more" };
    format!("{:.0} % {word} bytes", difference.abs())
}

/// The strongest comparison, after the name of the scene.
pub(super) fn title(scene: &str, all: &[Comparison]) -> String {
    match all.first() {
        Some(c) => format!(
            "{scene}: for the same picture quality, gsvx needs {} than {}",
            amount(c.difference),
            c.against.replace('`', "")
        ),
        None => format!("{scene}: picture quality over size"),
    }
}

/// The strongest comparisons in one sentence; empty if there is none.
pub(super) fn sentence(all: &[Comparison]) -> String {
    let parts: Vec<String> = all
        .iter()
        .take(MOST)
        .map(|c| format!("{} than {}", amount(c.difference), c.against))
        .collect();
    match parts.split_last() {
        None => String::new(),
        Some((only, [])) => format!("For the same picture quality, gsvx needs {only}. "),
        Some((last, before)) => {
            format!("For the same picture quality, gsvx needs {}, and {last}. ", before.join(", "))
        }
    }
}

/// Figures with what they are, one a line.
pub(super) fn highlights(run: &Run, all: &[Comparison]) -> Vec<(String, String)> {
    let mut out: Vec<(String, String)> = all
        .iter()
        .map(|c| {
            let what = format!("bytes of gsvx at equal PSNR against {}, {}", c.against, c.how);
            (format!("{:+.0} %", c.difference), what)
        })
        .collect();
    // The smallest stream within half a dB of the uncompressed model.
    let close = |p: &&Coded| p.score.psnr_db > run.original.score.psnr_db - 0.5;
    let points = run.curves.iter().filter(|c| c.name == GSVX).flat_map(|c| &c.points);
    if let Some(p) = points.filter(close).min_by_key(|p| p.bytes) {
        out.push((
            format!("{:.0}x", run.original.file_bytes as f64 / p.bytes.max(1) as f64),
            format!(
                "smaller than the model's PLY, {:+.2} dB from its PSNR: {:.3} MB at quality {:.0}",
                p.score.psnr_db - run.original.score.psnr_db,
                p.bytes as f64 / 1e6,
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
        let comparison =
            |difference, name| Comparison { difference, against: in_words(name), how: "" };
        let all = [
            comparison(-84.2, PAPER_CODING),
            comparison(-80.0, "SPZ v4"),
            comparison(2.6, UNIFORM),
        ];
        assert_eq!(
            title("fox", &all),
            "fox: for the same picture quality, gsvx needs 84 % fewer bytes than the paper's coding"
        );
        assert_eq!(
            sentence(&all),
            "For the same picture quality, gsvx needs 84 % fewer bytes than the paper's coding, 80 % fewer \
             bytes than SPZ v4, and 3 % more bytes than the same coding on an octree of one depth (`uniform`). "
        );
        assert_eq!(
            (sentence(&[]), title("fox", &[])),
            (String::new(), "fox: picture quality over size".into())
        );
    }
}

//! What `gsvx encode` says of a stream.

use crate::commands::info::parts;
use crate::content::transparent;
use crate::max_error;
use crate::output::counted;
use gsvx::{EncoderOutput, Measure, MissedAim, Preset};
use serde_json::{Value, json};
use std::path::Path;
use tune::{EncodeOutcome, VisibilityCount};

/// For a person. `most_bytes` is the target, if it is a size.
pub(super) fn remarks(
    outcome: &EncodeOutcome,
    most_bytes: Option<u64>,
    preset: Option<Preset>,
) -> String {
    let encoded = &outcome.output.encoded;
    let outliers = encoded.outliers();
    let mut remarks = vec![aimed(&outcome.output, most_bytes, preset)];
    if encoded.transparent > 0 {
        remarks.push(transparent(encoded.transparent));
    }
    if encoded.pruned > 0 {
        remarks.push(format!("{} pruned", encoded.pruned));
    }
    // With bounds on errors the first remark says how many are exact.
    if outliers > 0 && encoded.max_error.is_none() {
        remarks.push(format!(
            "{} coded exactly, far from all others: {:.0} % of the bytes",
            counted(outliers, "outlier"),
            100.0 * encoded.exact_share()
        ));
    }
    let seen = outcome.seen.as_ref().filter(|_| !outcome.cameras_ignored());
    remarks.extend(seen.and_then(|seen| unseen(seen, encoded.index.header.count)));
    remarks.join("; ")
}

/// What the stream aimed for, and how near it came.
fn aimed(output: &EncoderOutput, most_bytes: Option<u64>, preset: Option<Preset>) -> String {
    let Some(quality) = output.quality else {
        let bounds = max_error::human(&output.encoded);
        return bounds.unwrap_or_else(|| "every float bit for bit".into());
    };
    let reached = match (output.missed, output.measured) {
        (Some(MissedAim::Bytes { .. }), _) => "above the target".into(),
        (_, Some((measure, value))) => format!("{} from the input's renders", measure.words(value)),
        (None, None) if output.encodes > 1 || most_bytes.is_some() => {
            let most = most_bytes.unwrap_or_default().max(1);
            let share = 100.0 * output.encoded.bytes.len() as f64 / most as f64;
            format!("{share:.1} % of the target")
        }
        _ => {
            return match preset {
                Some(preset) => format!("preset {}, quality {quality}", preset.name),
                None => format!("quality {quality}"),
            };
        }
    };
    format!("quality {quality:.1}, {reached}, {} encodes", output.encodes)
}

/// What is said of Gaussians that cameras see too little of, in a stream of so many.
fn unseen(count: &VisibilityCount, gaussians: u64) -> Option<String> {
    let VisibilityCount { unseen, hardly_seen, kept, .. } = *count;
    if unseen + hardly_seen == 0 {
        return None;
    }
    let these = format!("{unseen} Gaussians that no camera sees and {hardly_seen} hardly seen");
    Some(match kept {
        0 => format!("{these} are left out"),
        _ => format!(
            "{these}: {kept} of them kept, coarsely; --drop-unseen leaves them out, which saves at most about \
             {:.1} %",
            100.0 * kept.min(gaussians as usize) as f64 / gaussians.max(1) as f64
        ),
    })
}

/// For a script.
pub(super) fn json(outcome: &EncodeOutcome) -> Value {
    let EncodeOutcome { output: EncoderOutput { encoded, measured, .. }, seen, .. } = outcome;
    let measured = |of: Measure| measured.filter(|m| m.0 == of).map(|m| m.1);
    json!({
        "gaussians": encoded.index.header.count,
        "quality": outcome.output.quality,
        "psnr": measured(Measure::Psnr),
        "ssimulacra2": measured(Measure::Ssimulacra2),
        "encodes": outcome.output.encodes,
        "transparent": encoded.transparent,
        "pruned": encoded.pruned,
        "outliers": encoded.outliers(),
        "cameras_doubted": outcome.cameras_ignored(),
        "seen_opacity_share": seen.map(|s| s.share),
        "unseen": seen.map(|s| s.unseen),
        "hardly_seen": seen.map(|s| s.hardly_seen),
        "hardly_seen_kept": seen.map(|s| s.kept),
        "left_out": encoded.left_out,
        "max_error": max_error::json(encoded),
        "target_reached": outcome.output.missed.is_none(),
        "parts": parts(&encoded.parts()),
        "estimate_seconds": outcome.estimate_seconds,
    })
}

/// What shows a stream in a page, by the npm package.
pub(super) fn embed(output: &Path) -> String {
    let file = output.file_name().map_or("scene.gsvx".into(), |n| n.to_string_lossy());
    format!("import {{ GSVXSplats }} from 'gsvx/spark'; scene.add(new GSVXSplats('{file}'));")
}

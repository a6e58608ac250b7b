//! What `gsvx info` says of a model that is no stream.

use crate::input::{self, LoadedModel};
use crate::report::Reporter;
use anyhow::Result;
use gs_model::Scene;
use gs_model::ply::Parts;
use indicatif::DecimalBytes;
use serde_json::{Value, json};
use std::path::Path;

/// Describes a model.
pub(crate) fn model(loaded: &LoadedModel, path: &Path, report: Reporter) -> Result<()> {
    let LoadedModel { scene, bytes, report: file } = loaded;
    let (name, size) = (input::name(path), DecimalBytes(*bytes));
    let bits = 8.0 * *bytes as f64 / file.gaussians_in_file.max(1) as f64;
    let mut text = format!(
        "{name}: {size} ({bytes} bytes)\n  format         {}\n  Gaussians      {}\n  \
         SH degree      {}\n  bits/Gaussian  {bits:.2}\n",
        file.form,
        scene.len(),
        scene.sh_degree,
    );
    if scene.antialiased {
        text += "  antialiased    yes: opacity is compensated for the blur\n";
    }
    let [low, high] = scene.bounds();
    let spread = (!scene.is_empty()).then(|| Spread::of(scene));
    if let Some(spread) = &spread {
        let [x, y, z] = low;
        let [u, v, w] = high;
        text += &format!("  from           ({x}, {y}, {z})\n  to             ({u}, {v}, {w})\n");
        text += &origin(scene.origin);
        text += &spread.human();
    }
    let json = json!({
        "format": file.form,
        "bytes": bytes,
        "gaussians": scene.len(),
        "gaussians_in_file": file.gaussians_in_file,
        "sh_degree": scene.sh_degree,
        "antialiased": scene.antialiased,
        "low": low,
        "high": high,
        "origin": scene.origin,
        "spread": spread.map(|s| s.json()),
        "notes": file.sentences(),
    });
    report.say(false, text.trim_end(), &json)
}

/// Describes a model whose Gaussians have not been read.
pub(crate) fn unread(parts: &Parts, path: &Path, report: Reporter) -> Result<()> {
    let (file, gaussians) = (parts.report(), parts.gaussians_in_file());
    let bytes = std::fs::metadata(path)?.len();
    let text = format!(
        "{}: {} ({bytes} bytes)\n  format         {}\n  Gaussians      {gaussians}\n  SH degree      {}\n\n  \
         Only the head was read, not the Gaussians; gsvx encode finds faults in them",
        input::name(path),
        DecimalBytes(bytes),
        file.form,
        parts.sh_degree(),
    );
    let json = json!({
        "format": file.form,
        "bytes": bytes,
        "gaussians_in_file": gaussians,
        "sh_degree": parts.sh_degree(),
        "notes": file.sentences(),
    });
    report.say(false, &text, &json)
}

/// The line about where the origin of a model lies; nothing if it is 0.
pub(crate) fn origin(origin: [f64; 3]) -> String {
    let [x, y, z] = origin;
    if origin == [0.0; 3] { String::new() } else { format!("  origin         ({x}, {y}, {z})\n") }
}

/// Tenth, fiftieth and ninetieth percentile of what a person asks about.
struct Spread {
    opacity: [f64; 3],
    /// Of the largest axis, world units.
    size: [f64; 3],
}

impl Spread {
    fn of(scene: &Scene) -> Self {
        let opacity = |&v: &f32| 1.0 / (1.0 + libm::exp(-f64::from(v)));
        let size = |s: &[f32; 3]| libm::exp(f64::from(s[0].max(s[1]).max(s[2])));
        Self {
            opacity: percentiles(scene.opacity_logits.iter().map(opacity).collect()),
            size: percentiles(scene.log_scales.iter().map(size).collect()),
        }
    }

    fn human(&self) -> String {
        let [a, b, c] = self.opacity;
        let [x, y, z] = self.size;
        format!(
            "  opacity        {b:.3} (80 % from {a:.3} to {c:.3})\n  \
             size           {y:.4} (80 % from {x:.4} to {z:.4}; largest axis)\n"
        )
    }

    fn json(&self) -> Value {
        json!({ "opacity": self.opacity, "size": self.size })
    }
}

fn percentiles(mut values: Vec<f64>) -> [f64; 3] {
    let last = values.len() - 1;
    [0.1, 0.5, 0.9].map(|share| {
        let at = (share * last as f64).round() as usize;
        *values.select_nth_unstable_by(at, f64::total_cmp).1
    })
}

//! Names for qualities.

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};

/// A quality with a name.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Preset {
    pub(crate) name: &'static str,
    pub(crate) quality: f32,
    help: &'static str,
}

/// What web pages get.
pub(crate) const WEB: Preset = Preset { name: "web", quality: 50.0, help: "web pages: quality 50" };

/// All presets, from the smallest streams to the best.
pub(crate) const PRESETS: [Preset; 4] = [
    Preset { name: "tiny", quality: 30.0, help: "thumbnails and previews: quality 30" },
    WEB,
    Preset { name: "high", quality: 80.0, help: "no visible difference: quality 80, the default" },
    Preset { name: "archive", quality: 90.0, help: "keeping and editing: quality 90" },
];

/// Reads the name of a preset.
pub(crate) fn parser() -> impl TypedValueParser<Value = Preset> {
    let values = PRESETS.map(|p| PossibleValue::new(p.name).help(p.help));
    PossibleValuesParser::new(values).try_map(|name| {
        PRESETS.into_iter().find(|p| p.name == name).ok_or_else(|| format!("no preset {name}"))
    })
}

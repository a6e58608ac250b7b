//! Qualities with names.

/// A quality with a name.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Preset {
    /// What users call it.
    pub name: &'static str,
    /// From 0 to 100.
    pub quality: f32,
    /// What it is for.
    pub purpose: &'static str,
}

impl Preset {
    /// What web pages get.
    pub const WEB: Self = Self { name: "web", quality: 50.0, purpose: "web pages" };

    /// All presets, from the smallest streams to the best.
    pub const ALL: [Self; 4] = [
        Self { name: "tiny", quality: 30.0, purpose: "thumbnails and previews" },
        Self::WEB,
        Self { name: "high", quality: crate::DEFAULT_QUALITY, purpose: "no visible difference" },
        Self { name: "archive", quality: 90.0, purpose: "keeping and editing" },
    ];
}

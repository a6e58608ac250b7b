//! [`Measure`]: how alike two renders are, as a search for a stream measures it.

/// How alike renders of a stream are to renders of its model. More is better.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Measure {
    /// PSNR, dB.
    Psnr,
    /// SSIMULACRA2: 90 where no difference is seen side by side at a normal distance, 70 for a high quality.
    Ssimulacra2,
}

impl Measure {
    /// Its key in reports.
    #[must_use]
    pub fn key(self) -> &'static str {
        match self {
            Self::Psnr => "psnr",
            Self::Ssimulacra2 => "ssimulacra2",
        }
    }

    /// A value, for a person.
    #[must_use]
    pub fn words(self, value: f64) -> String {
        match self {
            Self::Psnr => format!("{value:.2} dB"),
            Self::Ssimulacra2 => format!("SSIMULACRA2 {value:.1}"),
        }
    }

    /// A stream this close above its target ends a search.
    pub(crate) fn tolerance(self) -> f64 {
        match self {
            Self::Psnr => 0.02,
            Self::Ssimulacra2 => 0.1,
        }
    }

    /// How much a quality point adds at qualities near 60 of the scenes measured. Only how far the second encode goes
    /// depends on it.
    pub(crate) fn per_point(self) -> f64 {
        match self {
            Self::Psnr => 0.34,
            Self::Ssimulacra2 => 1.2,
        }
    }
}

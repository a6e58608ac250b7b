//! Section kinds and table-of-contents entries.

use std::fmt;
use std::ops::Range;

/// What a section holds. Sections appear in the stream in the order of this enum.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[non_exhaustive]
pub enum SectionKind {
    /// Octree leaves.
    Geometry,
    /// Importance class of each Gaussian; decides the precision of all attributes.
    Importance,
    /// Opacity.
    Opacity,
    /// SH coefficient of degree 0.
    Dc,
    /// Covariances (rotations and log-scales).
    Covariance,
    /// Gaussians outside the cube, bit for bit.
    Outliers,
    /// SH coefficients of degree 1.
    Sh1,
    /// SH coefficients of degree 2.
    Sh2,
    /// SH coefficients of degree 3.
    Sh3,
    /// Bit-exact floats of a lossless stream (replaces all others).
    Lossless,
    /// A kind this build does not know; skipped.
    Unknown(u8),
}

impl SectionKind {
    /// Code in the table of contents.
    #[must_use]
    pub fn code(self) -> u8 {
        match self {
            Self::Geometry => 1,
            Self::Importance => 9,
            Self::Opacity => 2,
            Self::Dc => 3,
            Self::Covariance => 4,
            Self::Sh1 => 5,
            Self::Sh2 => 6,
            Self::Sh3 => 7,
            Self::Lossless => 8,
            Self::Outliers => 10,
            Self::Unknown(c) => c,
        }
    }

    /// The kind with this code.
    #[must_use]
    pub fn from_code(code: u8) -> Self {
        match code {
            1 => Self::Geometry,
            2 => Self::Opacity,
            3 => Self::Dc,
            4 => Self::Covariance,
            5 => Self::Sh1,
            6 => Self::Sh2,
            7 => Self::Sh3,
            8 => Self::Lossless,
            9 => Self::Importance,
            10 => Self::Outliers,
            c => Self::Unknown(c),
        }
    }

    /// The SH section of a degree 1 to 3.
    #[must_use]
    pub fn of_sh_degree(degree: u8) -> Self {
        match degree {
            1 => Self::Sh1,
            2 => Self::Sh2,
            _ => Self::Sh3,
        }
    }

    /// The degree of an SH section; 0 of any other.
    pub(crate) fn sh_degree(self) -> u8 {
        match self {
            Self::Sh1 => 1,
            Self::Sh2 => 2,
            Self::Sh3 => 3,
            _ => 0,
        }
    }

    /// Which SH coefficients it holds, of those of one Gaussian.
    pub(crate) fn sh_coefficients(self) -> Range<usize> {
        match self {
            Self::Dc => 0..1,
            Self::Sh1 => 1..4,
            Self::Sh2 => 4..9,
            Self::Sh3 => 9..16,
            _ => 0..0,
        }
    }

    /// Channels that its transform carries: how long it takes, about.
    pub(crate) fn channels(self) -> usize {
        match self {
            Self::Dc => 3,
            Self::Covariance => 6,
            Self::Sh1 => 9,
            Self::Sh2 => 15,
            Self::Sh3 => 21,
            _ => 1,
        }
    }

    /// Short name for reports.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Geometry => "geometry",
            Self::Importance => "importance",
            Self::Opacity => "opacity",
            Self::Dc => "DC",
            Self::Covariance => "covariance",
            Self::Outliers => "outliers",
            Self::Sh1 => "SH degree 1",
            Self::Sh2 => "SH degree 2",
            Self::Sh3 => "SH degree 3",
            Self::Lossless => "lossless",
            Self::Unknown(_) => "unknown",
        }
    }
}

impl fmt::Display for SectionKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Unknown(c) => write!(f, "unknown ({c})"),
            known => f.write_str(known.name()),
        }
    }
}

/// One entry of the table of contents.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TocEntry {
    /// What the section holds.
    pub kind: SectionKind,
    /// Payload length in bytes.
    pub len: u64,
    /// CRC-32C (Castagnoli) of the payload.
    pub crc: u32,
}

//! Formats of models, their names and extensions.

use crate::exit::usage;
use crate::output::is_stdio;
use anyhow::Result;
use clap::ValueEnum;
use gs_model::{Scene, ply, splat, spz};
use std::io::Write;
use std::path::Path;

/// A format that is read.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Source {
    /// A gsvx stream.
    Gsvx,
    /// Inria's PLY layout.
    Ply,
    /// antimatter15's .splat.
    Splat,
    /// Niantic's SPZ, versions 2 to 4.
    Spz,
}

/// A format of models that is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Model {
    /// Inria's PLY layout: every float as it is.
    Ply,
    /// 32 bytes per Gaussian, no view dependence.
    Splat,
    /// Niantic's SPZ, version 4.
    Spz,
}

/// What the extension of a file name says.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Extension {
    Stream,
    Model(Model),
    Other,
}

impl Extension {
    pub(crate) fn of(path: &Path) -> Self {
        let extension = path.extension().and_then(|e| e.to_str()).unwrap_or_default();
        match extension.to_ascii_lowercase().as_str() {
            "gsvx" => Self::Stream,
            "ply" => Self::Model(Model::Ply),
            "splat" => Self::Model(Model::Splat),
            "spz" => Self::Model(Model::Spz),
            _ => Self::Other,
        }
    }
}

impl Model {
    /// The extension of its files.
    pub(crate) fn extension(self) -> &'static str {
        match self {
            Self::Ply => "ply",
            Self::Splat => "splat",
            Self::Spz => "spz",
        }
    }

    /// The format of an output: the one asked for, or that of the output's extension. `other` is for
    /// extensions that name none.
    pub(crate) fn of_output(asked: Option<Self>, path: &Path, other: Option<Self>) -> Result<Self> {
        let name = path.display();
        match (asked, Extension::of(path)) {
            (Some(format), _) => Ok(format),
            (None, Extension::Model(format)) => Ok(format),
            (None, Extension::Stream) => Err(usage(format!(
                "{name}: this command writes models; to write a stream, use gsvx encode"
            ))),
            (None, Extension::Other) => other.ok_or_else(|| {
                usage(if is_stdio(path) {
                    "standard output: name its format with --to ply, splat or spz".into()
                } else {
                    format!("{name}: its extension names no format; pass --to ply, splat or spz")
                })
            }),
        }
    }

    /// Writes a scene.
    pub(crate) fn write(
        self,
        out: &mut dyn Write,
        scene: &Scene,
        spz: &spz::WriteOptions,
    ) -> gs_model::Result<()> {
        match self {
            Self::Ply => ply::write_to(out, scene),
            Self::Splat => splat::write_to(out, scene),
            Self::Spz => spz::write_to(out, scene, spz),
        }
    }

    /// What the format cannot hold of a scene of this SH degree.
    pub(crate) fn loses(self, sh_degree: u8) -> Option<String> {
        (self == Self::Splat && sh_degree > 0).then(|| {
            format!("skipped: SH degrees 1 to {sh_degree}: .splat holds no view dependence")
        })
    }
}

//! Formats of models, their names and extensions.

use crate::exit::usage;
use crate::output::is_stdio;
use anyhow::Result;
use clap::ValueEnum;
use gs_model::model::Kind;
use gs_model::{Scene, gltf, ply, splat, spz};
use serde::{Deserialize, Serialize};
use std::io::Write;
use std::path::Path;

/// A format that is read.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ValueEnum)]
pub(crate) enum Source {
    /// A gsvx stream.
    Gsvx,
    /// Inria's PLY layout, or PlayCanvas' compressed.ply.
    Ply,
    /// antimatter15's .splat.
    Splat,
    /// Niantic's SPZ, versions 2 to 4.
    Spz,
    /// The .ksplat of GaussianSplats3D.
    Ksplat,
    /// PlayCanvas' SOG, version 2, in one file.
    Sog,
    /// Binary glTF with KHR_gaussian_splatting.
    Glb,
}

impl Source {
    /// The kind of a model; `None` of a stream.
    pub(crate) fn kind(self) -> Option<Kind> {
        Some(match self {
            Self::Gsvx => return None,
            Self::Ply => Kind::Ply,
            Self::Splat => Kind::Splat,
            Self::Spz => Kind::Spz,
            Self::Ksplat => Kind::Ksplat,
            Self::Sog => Kind::Sog,
            Self::Glb => Kind::Gltf,
        })
    }
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
    /// PlayCanvas' compressed.ply.
    CompressedPly,
    /// Binary glTF with KHR_gaussian_splatting.
    Glb,
}

/// What the extension of a file name says.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Extension {
    Stream,
    Model(Model),
    /// A format that is read and not written.
    ReadOnly,
    Other,
}

impl Extension {
    pub(crate) fn of(path: &Path) -> Self {
        let name = path.file_name().unwrap_or_default().to_string_lossy().to_ascii_lowercase();
        let (front, extension) = name.rsplit_once('.').unwrap_or((name.as_str(), ""));
        match extension {
            "gsvx" => Self::Stream,
            "ply" if front.ends_with(".compressed") => Self::Model(Model::CompressedPly),
            "ply" => Self::Model(Model::Ply),
            "glb" => Self::Model(Model::Glb),
            "splat" => Self::Model(Model::Splat),
            "spz" => Self::Model(Model::Spz),
            "sog" | "ksplat" | "gltf" => Self::ReadOnly,
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
            Self::CompressedPly => "compressed.ply",
            Self::Glb => "glb",
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
            (None, Extension::ReadOnly) => Err(usage(format!(
                "{name}: this format is not written; write a .glb, .compressed.ply, .spz, .splat or .ply"
            ))),
            (None, Extension::Other) => other.ok_or_else(|| {
                usage(if is_stdio(path) {
                    "standard output: name its format with --to ply, splat, spz, compressed-ply or glb".into()
                } else {
                    format!(
                        "{name}: its extension names no format; pass --to ply, splat, spz, \
                         compressed-ply or glb"
                    )
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
            Self::CompressedPly => ply::compressed::write_to(out, scene),
            Self::Glb => gltf::write_to(out, scene),
        }
    }

    /// What the format cannot hold of a scene of this SH degree.
    pub(crate) fn loses(self, sh_degree: u8) -> Option<String> {
        (self == Self::Splat && sh_degree > 0).then(|| {
            format!("skipped: SH degrees 1 to {sh_degree}: .splat holds no view dependence")
        })
    }
}

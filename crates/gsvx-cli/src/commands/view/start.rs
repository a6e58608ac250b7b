//! The camera at which the viewer page starts.

use crate::input::{self, OpenedInput};
use crate::output::counted;
use crate::views;
use finetune::framing::{self, Constraints};
use gs_model::dataset::HOLD_OUT_EVERY;
use gs_model::{Camera, CameraSet, Scene};
use std::path::{Path, PathBuf};

/// A level of detail of at most so many Gaussians is enough to find a camera for.
const ENOUGH: u64 = 1 << 17;

/// A camera, and what is up for whoever turns around the scene.
pub(super) struct Start {
    camera: Camera,
    up: [f64; 3],
    /// Where the camera is from.
    pub(super) from: String,
}

impl Start {
    /// The first training camera that lies beside one of the files, else the first of `gsvx render --orbit`; `None` of
    /// files that the page will say to be broken.
    pub(super) fn of(files: &[PathBuf]) -> Option<Self> {
        files.iter().find_map(|file| Self::beside(file)).or_else(|| Self::around(files.first()?))
    }

    fn beside(file: &Path) -> Option<Self> {
        let CameraSet { views, source, form, .. } = views::beside(file)?;
        // The first one is held out, unless it is the only one.
        let first = views.iter().enumerate().find(|(i, _)| i % HOLD_OUT_EVERY != 0);
        let camera = first.map_or_else(|| views.first(), |(_, view)| Some(view))?.camera.clone();
        let up = views::up(&views).unwrap_or_else(|| (-camera.rotation.row(1)).into());
        let from = format!(
            "{:?}, of the {} from {} ({form}) beside the model",
            camera.name,
            counted(views.len(), "camera"),
            source.display()
        );
        Some(Self { camera, up, from })
    }

    fn around(file: &Path) -> Option<Self> {
        let found = framing::find(&scene(file)?, &Constraints::default())?;
        let from =
            "the one that sees most of a circle around the model, as no cameras lie beside it"
                .into();
        Some(Self { camera: found.first(), up: found.ring.up.into(), from })
    }

    /// As the address of the page has it.
    pub(super) fn query(&self) -> String {
        let three = |name, at: [f64; 3]| {
            let [x, y, z] = at.map(|v| v as f32);
            format!("&{name}={x},{y},{z}")
        };
        let Self { camera, up, .. } = self;
        three("up", *up)
            + &three("eye", camera.position().into())
            + &three("ahead", camera.rotation.row(2).into())
            + &format!("&angle={:.2}", camera.narrow_angle())
    }
}

/// A model, or a level of detail of a stream.
fn scene(file: &Path) -> Option<Scene> {
    let bytes = match input::lenient(file).ok()? {
        OpenedInput::Model(loaded) => return Some(loaded.scene),
        OpenedInput::Stream(bytes) => bytes,
    };
    let index = gsvx::Index::parse(&bytes).ok()?;
    let count = |lod| index.chunks_of_lod(lod).map(|i| index.chunks[i].count).sum::<u64>();
    let coarsest = index.coarsest_lod();
    let mut options = gsvx::DecodeOptions::default();
    options.lod = (0..coarsest).find(|&lod| count(lod) <= ENOUGH).unwrap_or(coarsest);
    (options.max_sh_degree, options.salvage) = (0, true);
    Some(gsvx::decode_with(&bytes, &options).ok()?.scene)
}

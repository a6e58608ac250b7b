//! Cameras on the command line: which views to draw, and what they see of a model.

use crate::doubts;
use crate::exit::{note, usage};
use crate::orbit::Orbit;
use crate::output::is_stdio;
use crate::progress::Meter;
use crate::size::number;
use anyhow::{Result, bail};
use finetune::{MAX_EDGE, TrainView, doubt_about_share};
use gs_model::dataset::{self, CameraSet, HOLD_OUT_EVERY};
use gs_model::lens::Lens;
use gs_model::{Camera, Scene, View, pinholes, refuse_wide};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use tune::CameraDoubt;

/// Which views to look at a model from.
#[derive(clap::Args, Clone, Debug)]
#[command(group = clap::ArgGroup::new("which_views").required(true).args(["cameras", "orbit"]))]
pub(crate) struct WhichViews {
    /// Cameras: a scene folder (COLMAP project, Inria output, transforms.json), a cameras.json or
    /// transforms.json itself, or the folder of a COLMAP model.
    #[arg(long, value_name = "PATH")]
    cameras: Option<PathBuf>,
    #[command(flatten)]
    orbit: Orbit,
    /// Only the first camera and every Nth after it, by name (8: the views held out for measuring).
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..))]
    every: u32,
    /// Only the camera of this name.
    #[arg(long, value_name = "NAME")]
    view: Option<String>,
    /// Factor on the image sizes, above 0 and at most 16.
    #[arg(long, default_value_t = 1.0, value_parser = factor)]
    scale: f64,
}

impl WhichViews {
    /// The cameras, and where they are from; `scene`, read from `path`, is what generated ones look at.
    pub(crate) fn cameras(&self, scene: &Scene, path: &Path) -> Result<PlacedCameras> {
        let (all, mut origin) = match (&self.cameras, self.orbit.orbit) {
            (Some(path), _) => {
                let ReadViews { views, origin } = read(path)?;
                (views.into_iter().map(|v| v.camera).collect(), Some(origin))
            }
            (None, Some(n)) => (self.orbit.cameras(scene, n, up_beside(path))?, None),
            (None, None) => return Err(usage("give --cameras or --orbit")),
        };
        let chosen: Vec<Camera> = all
            .into_iter()
            .step_by(self.every as usize)
            .filter(|c| self.view.as_ref().is_none_or(|name| c.name == *name))
            .map(|c| if origin.is_some() { c.relative_to(scene.origin) } else { c })
            .map(|c| scaled(c, self.scale))
            .collect();
        if chosen.is_empty() {
            match &self.view {
                Some(name) => bail!("--view {name}: no camera of that name"),
                None => bail!("no cameras"),
            }
        }
        drawable(&chosen, "pass a smaller --scale")?;
        if let (Some(path), Some(origin)) = (&self.cameras, &mut origin) {
            chosen.iter().try_for_each(|camera| refuse_wide(path, camera))?;
            say_lenses(path, &chosen);
            origin.used = chosen.len();
            origin.how = match (&self.view, self.every) {
                (Some(name), _) => format!("{name:?} is drawn"),
                (None, 1) => "all are drawn".into(),
                (None, n) => {
                    format!("{} are drawn, the first and every {n}th after it", chosen.len())
                }
            };
        }
        Ok(PlacedCameras { cameras: chosen, origin })
    }

    /// The photos of some of its cameras, which are at this origin.
    pub(crate) fn photos(&self, cameras: &[Camera], origin: [f64; 3]) -> Result<Vec<TrainView>> {
        let Some(path) = &self.cameras else { return Err(usage("--photos: give --cameras")) };
        let views = dataset::open_cameras(path)?.views.into_iter();
        let views = views.filter(|view| cameras.iter().any(|c| c.name == view.camera.name));
        let views: Vec<View> =
            views.map(|v| View { camera: v.camera.relative_to(origin), ..v }).collect();
        let photos = tune::photos(path, &views)?;
        if photos.views.is_empty() {
            bail!("{}: no photos; leave out --photos", path.display());
        }
        photos.warnings.iter().for_each(|warning| note(format_args!("warning: {warning}")));
        Ok(photos.views)
    }
}

/// Cameras to draw from, and where they are from; generated ones are from nowhere.
pub(crate) struct PlacedCameras {
    pub(crate) cameras: Vec<Camera>,
    pub(crate) origin: Option<Origin>,
}

/// Views that were read.
pub(crate) struct ReadViews {
    pub(crate) views: Vec<View>,
    pub(crate) origin: Origin,
}

/// Where cameras are from, and how many of them are used.
#[derive(Clone, Debug)]
pub(crate) struct Origin {
    source: PathBuf,
    form: &'static str,
    count: usize,
    used: usize,
    /// What becomes of them.
    how: String,
}

impl Origin {
    /// One line for a person.
    pub(crate) fn human(&self) -> String {
        let Self { source, form, count, how, .. } = self;
        let s = if *count == 1 { "" } else { "s" };
        format!("{count} camera{s} from {} ({form}): {how}", source.display())
    }

    pub(crate) fn json(&self) -> Value {
        let Self { source, form, count, used, .. } = self;
        json!({ "path": source.display().to_string(), "form": form, "count": count, "used": used })
    }
}

fn factor(text: &str) -> Result<f64, String> {
    number(text, |v| *v > 0.0 && *v <= 16.0, "use a number above 0 and at most 16")
}

/// Refuses images that no memory holds.
fn drawable(cameras: &[Camera], remedy: &str) -> Result<()> {
    match cameras.iter().find(|c| c.width.max(c.height) > MAX_EDGE) {
        None => Ok(()),
        Some(camera) => bail!(
            "camera {:?}: {}x{} pixels, more than {MAX_EDGE} along an edge; {remedy}",
            camera.name,
            camera.width,
            camera.height
        ),
    }
}

fn scaled(camera: Camera, factor: f64) -> Camera {
    let size = |edge: u32| ((f64::from(edge) * factor).round() as u32).max(1);
    // Edges that are rounded keep the aspect ratio to within a pixel.
    camera.scaled_to(size(camera.width), size(camera.height)).unwrap_or(camera)
}

/// The cameras that lie beside a model, in a scene folder or an output of Inria's trainer.
pub(crate) fn beside(model: &Path) -> Option<CameraSet> {
    if is_stdio(model) {
        return None;
    }
    let mut folders = model.parent()?.ancestors();
    // Inria: FOLDER/point_cloud/iteration_N/point_cloud.ply.
    [folders.next(), folders.nth(1)].into_iter().flatten().find_map(|folder| {
        let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
        dataset::cameras_in(folder).ok()
    })
}

/// What is up for the cameras that lie beside a model; `None` if there are none, or if they do not agree.
fn up_beside(model: &Path) -> Option<[f64; 3]> {
    up(&beside(model)?.views)
}

/// What is up for some cameras; `None` if they do not agree.
pub(crate) fn up(views: &[View]) -> Option<[f64; 3]> {
    // A camera's second axis points down.
    let sum = views.iter().map(|v| -v.camera.rotation.row(1)).reduce(|a, b| a + b)?;
    (sum.length() > 0.5 * views.len() as f64).then(|| sum.normalize().to_array())
}

/// Says that renders do not show the distortion of photos.
fn say_lenses(path: &Path, cameras: &[Camera]) {
    let distorted = cameras.iter().filter_map(|c| c.lens.as_ref());
    if let Some(Lens { model, .. }) = distorted.clone().next() {
        note(format_args!(
            "{}: {} of {} cameras have lens distortion ({model}), which renders do not show",
            path.display(),
            distorted.count(),
            cameras.len()
        ));
    }
}

/// The views of a scene folder or of a camera file, by name. Notes say what is unusual about them.
pub(crate) fn read(path: &Path) -> Result<ReadViews> {
    let CameraSet { views, source, form, notes, .. } = dataset::open_cameras(path)?;
    notes.iter().for_each(note);
    let count = views.len();
    let origin = Origin { source, form, count, used: count, how: String::new() };
    Ok(ReadViews { views, origin })
}

/// Cameras that show a model, which was read from `path`, from wherever it can be seen.
pub(crate) fn around(orbit: &Orbit, n: u32, path: &Path, scene: &Scene) -> Result<Vec<Camera>> {
    let looking = Meter::spinner("looking for cameras".into());
    let cameras = orbit.covering(scene, n, up_beside(path))?;
    drop(looking);
    drawable(&cameras, "pass a smaller --size")?;
    Ok(cameras)
}

/// The views, which `path` names, that are not held out for measuring, relative to the origin of a scene.
pub(crate) fn training(path: &Path, scene_origin: [f64; 3]) -> Result<ReadViews> {
    let ReadViews { views, mut origin } = read(path)?;
    let kept = views.into_iter().enumerate().filter(|(i, _)| i % HOLD_OUT_EVERY != 0);
    let moved = |view: View| View { camera: view.camera.relative_to(scene_origin), ..view };
    let views: Vec<View> = kept.map(|(_, view)| moved(view)).collect();
    if views.is_empty() {
        let name = path.display();
        bail!("{name}: a single camera is held out for measuring; give two or more");
    }
    origin.used = views.len();
    origin.how = format!(
        "{} for training, {} held out for measuring",
        views.len(),
        origin.count - views.len()
    );
    Ok(ReadViews { views, origin })
}

/// The training views of a scene with their photos, and pinhole cameras of them; nothing without a path.
pub(crate) fn with_photos(
    path: Option<&Path>,
    scene: &Scene,
) -> Result<(Vec<View>, Option<PlacedCameras>)> {
    let Some(path) = path else { return Ok((Vec::new(), None)) };
    let read = training(path, scene.origin)?;
    let photos = read.views.clone();
    Ok((photos, Some(as_pinholes(path, read)?)))
}

/// Pinhole cameras that show what the photos of the views show.
pub(crate) fn as_pinholes(path: &Path, read: ReadViews) -> Result<PlacedCameras> {
    let ReadViews { views, mut origin } = read;
    let own: Vec<Camera> = views.into_iter().map(|view| view.camera).collect();
    let cameras = pinholes(path, &own)?;
    drawable(&cameras, &format!("correct the sizes in {}", path.display()))?;
    let wide = own.iter().find_map(|c| c.lens.as_ref()).filter(|_| cameras.len() > own.len());
    if let Some(Lens { model, .. }) = wide {
        origin.how +=
            &format!("; drawn as {} pinhole cameras, because of the lens ({model})", cameras.len());
    }
    if cameras.len() > finetune::MOST_CAMERAS {
        origin.how +=
            &format!("; importance is measured at {}, evenly chosen", finetune::MOST_CAMERAS);
    }
    Ok(PlacedCameras { cameras, origin: Some(origin) })
}

/// Warns if the cameras, which `path` names, see little: this share of the opacity.
///
/// # Errors
/// If they see nothing.
pub(crate) fn check(share: f64, path: &Path) -> Result<()> {
    match doubt_about_share(share) {
        Some(doubt) if share == 0.0 => bail!("{}: {doubt}", path.display()),
        Some(_) => doubts::warn(path, &CameraDoubt::Share(share)),
        None => {}
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn up_is_that_of_the_cameras_beside_a_model() {
        let room = testing::fixture("room");
        let up = up_beside(&room.join("point_cloud.ply")).expect("its cameras are beside it");
        assert!(up[2] > 0.95, "{up:?}");
        assert_eq!(up_beside(Path::new("-")), None);
        assert_eq!(up_beside(&room.join("images/view_000.png")), None);
    }
}

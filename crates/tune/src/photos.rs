//! Photos in files, as targets.

use std::fs::File;
use std::io::BufReader;
use std::path::Path;

use finetune::{Photo, PhotoCheck, RenderOptions, TrainView, render};
use gs_model::{Camera, Scene, View, photos_beside, pinholes, unread_photos_beside};
use image::imageops::{FilterType, resize};
use image::metadata::Orientation;
use image::{DynamicImage, ImageDecoder, ImageReader, RgbImage};

use crate::error::{Error, Result};
use crate::undistort::undistorted;

/// A run leaves out at most one photo in this many.
const LEFT_OUT: usize = 10;
/// What photos save, in the mean of the scenes of docs/results/tune.md.
const WORTH: &str = "76 % of the bytes instead of 70 %";
/// Channels of a grey pixel differ by at most this, and on average by more than this in a model with colours.
const GREY: u8 = 2;
/// Views that are drawn to see whether a model has colours.
const DRAWN: usize = 4;
/// Names that a message lists.
const LISTED: usize = 3;

/// The photos of a scene at their cameras.
#[derive(Clone, Debug, Default)]
pub struct Photos {
    /// Cameras, scaled to the sizes of their photos. None if there are no photos at all.
    pub views: Vec<TrainView>,
    /// What a user should know: which photos are left out, and how they differ from what is expected.
    pub warnings: Vec<String>,
}

impl Photos {
    /// Compares some photos with the model. Warns if they are exposed differently.
    ///
    /// # Errors
    /// Unless `force`: [`Error::GreyPhotos`] if they have no colours and the model has, [`Error::OtherPhotos`] if they show
    /// something else than the model at their cameras.
    pub fn check(&mut self, scene: &Scene, force: bool) -> Result<()> {
        if !self.views.is_empty()
            && self
                .views
                .iter()
                .all(|view| view.photo.rgb.chunks_exact(3).all(|p| spread(p) <= GREY))
            && has_colours(scene, &self.views)
        {
            let views = self.views.len();
            if !force {
                return Err(Error::GreyPhotos { views });
            }
            self.warnings.push("the photos are grey: the tuned model turns grey".into());
            return Ok(());
        }
        let Some(found) = PhotoCheck::of(scene, &self.views) else { return Ok(()) };
        let PhotoCheck { views, psnr, fitted_psnr, .. } = found;
        if found.of_other_views() && !force {
            let turned = show_turned(scene, &self.views);
            return Err(Error::OtherPhotos { views, psnr, turned });
        }
        if found.of_other_exposure() {
            self.warnings.push(format!(
                "the photos' exposure differs from the model's: {psnr:.1} dB, {fitted_psnr:.1} dB with \
                 the brightness of each photo fitted; the tuned model takes on that of the photos"
            ));
        }
        Ok(())
    }
}

/// How much the channels of a pixel differ.
fn spread(pixel: &[u8]) -> u8 {
    let [least, most] = [u8::min, u8::max].map(|of| pixel.iter().copied().reduce(of).unwrap_or(0));
    most - least
}

/// Whether renders of the scene at some of the views have colours.
fn has_colours(scene: &Scene, views: &[TrainView]) -> bool {
    let step = views.len().div_ceil(DRAWN).max(1);
    views.iter().step_by(step).any(|view| {
        let shown = render(scene, &view.camera, &RenderOptions::default()).to_rgb8();
        let pixels = shown.chunks_exact(3);
        let count = pixels.len() as u64;
        pixels.map(|p| u64::from(spread(p))).sum::<u64>() > u64::from(GREY) * count
    })
}

/// A photo at its camera.
struct ReadPhoto {
    view: TrainView,
    masked: bool,
}

/// Reads the photos of some views of a scene, which `path` names.
///
/// A tenth of the photos may be missing or broken: these are left out. Transparent pixels are composited on black.
///
/// # Errors
/// [`Error::UnreadPhotos`] if there are only photos of a format that is not read; [`Error::NoPhotos`] if too few are those
/// of the views; [`Error::Photo`] for the first photo that cannot be used, if too many cannot.
pub fn photos(path: &Path, views: &[View]) -> Result<Photos> {
    let (there, missing): (Vec<&View>, Vec<&View>) = views.iter().partition(|v| v.has_photo());
    let Some(first) = missing.first() else { return read_all(&there, &[]) };
    let looked_for = &first.image_path;
    let others = photos_beside(looked_for)
        .map_err(|e| Error::Photo { file: looked_for.clone(), reason: gs_model::chain(&e) })?;
    if there.is_empty()
        && others.is_empty()
        && let Some(unread) = unread(path, looked_for)?
    {
        return Err(unread);
    }
    if there.is_empty() && others.is_empty() {
        let warning = format!(
            "{}: no photos ({} is not there): the targets are renders of the model; photos save \
             more ({WORTH})",
            path.display(),
            looked_for.display()
        );
        return Ok(Photos { views: Vec::new(), warnings: vec![warning] });
    }
    if missing.len() * LEFT_OUT > views.len() {
        return Err(Error::NoPhotos {
            path: path.into(),
            missing: missing.len(),
            views: views.len(),
            looked_for: looked_for.clone(),
            there: match &others[..] {
                [] => "nothing".into(),
                found => listed(found.iter().map(|file| name(file))),
            },
        });
    }
    read_all(&there, &missing)
}

/// The error of photos that are there, but of a format that is not read.
fn unread(path: &Path, looked_for: &Path) -> Result<Option<Error>> {
    let unread = unread_photos_beside(looked_for)
        .map_err(|e| Error::Photo { file: looked_for.into(), reason: gs_model::chain(&e) })?;
    let Some(first) = unread.first() else { return Ok(None) };
    let (folder, extension) = (first.parent(), first.extension().unwrap_or_default());
    let alike = |file: &&std::path::PathBuf| {
        file.parent() == folder && file.extension() == first.extension()
    };
    Ok(Some(Error::UnreadPhotos {
        path: path.into(),
        folder: folder.unwrap_or(Path::new("")).into(),
        count: unread.iter().filter(alike).count(),
        extension: extension.to_string_lossy().into_owned(),
    }))
}

/// Whether a photo shows more than the picture of a pinhole camera that is made of it.
fn is_cropped(camera: &Camera) -> bool {
    pinholes(Path::new(""), std::slice::from_ref(camera)).is_ok_and(|cameras| cameras.len() > 1)
}

/// Photos that are compared with renders before an encode, and their greatest size, pixels: [`PhotoCheck`] compares
/// smaller ones.
const COMPARED: usize = 8;
const COMPARED_PIXELS: u32 = 20_000;

/// Compares some photos of the views with the model, quickly. True if they [prove](PhotoCheck::proves_cameras) the
/// cameras. Where fewer than two of them can be read, nothing is compared.
///
/// # Errors
/// [`Error::OtherPhotos`] if they show something else than the model at their cameras.
pub fn check_photos(scene: &Scene, views: &[View]) -> Result<bool> {
    let there: Vec<&View> = views.iter().filter(|v| v.has_photo()).collect();
    let step = there.len().div_ceil(COMPARED).max(1);
    let read = |view: &&View| photo(&view.camera, &view.image_path).ok();
    let chosen = there.into_iter().step_by(step).filter_map(|view| read(&view));
    let chosen: Vec<TrainView> = chosen.map(|view| smaller(&view, COMPARED_PIXELS)).collect();
    let Some(found) = PhotoCheck::of(scene, &chosen) else { return Ok(false) };
    if found.of_other_views() {
        let PhotoCheck { views, psnr, .. } = found;
        return Err(Error::OtherPhotos { views, psnr, turned: show_turned(scene, &chosen) });
    }
    Ok(found.proves_cameras())
}

/// Whether the photos show the model turned by 180 degrees about x.
fn show_turned(scene: &Scene, views: &[TrainView]) -> bool {
    let step = views.len().div_ceil(COMPARED).max(1);
    let turned = |view: &TrainView| {
        let view = smaller(view, COMPARED_PIXELS);
        TrainView { camera: view.camera.of_turned_model(), ..view }
    };
    let turned: Vec<TrainView> = views.iter().step_by(step).map(turned).collect();
    PhotoCheck::of(scene, &turned).is_some_and(|check| !check.of_other_views())
}

fn read_all(there: &[&View], missing: &[&View]) -> Result<Photos> {
    let mut out = Photos::default();
    let mut left_out: Vec<String> = missing.iter().map(|v| name(&v.image_path)).collect();
    let (mut masked, mut cropped, mut broken) = (0, 0, Vec::new());
    for view in there {
        match read(&view.camera, &view.image_path) {
            Ok(read) => {
                masked += usize::from(read.masked);
                cropped += usize::from(is_cropped(&view.camera));
                out.views.push(read.view);
            }
            Err(error) => {
                left_out.push(name(&view.image_path));
                broken.push(error);
            }
        }
    }
    let all = there.len() + missing.len();
    if left_out.len() * LEFT_OUT > all
        && let Some(source) = broken.into_iter().next()
    {
        let files = listed(left_out.into_iter());
        return Err(Error::Photos { all, files, source: Box::new(source) });
    }
    if !left_out.is_empty() {
        out.warnings.push(format!(
            "{} of {all} photos are missing or broken and are left out: {}",
            left_out.len(),
            listed(left_out.iter().cloned())
        ));
    }
    if cropped > 0 {
        out.warnings.push(format!(
            "{cropped} of {all} photos show more than a picture without distortion can: what only their borders show \
             counts as unseen"
        ));
    }
    if masked > 0 {
        out.warnings.push(format!(
            "{masked} of {all} photos have transparent pixels, which are black as the model is drawn"
        ));
    }
    Ok(out)
}

/// Reads the photo of a camera, which is scaled to the photo's size.
///
/// # Errors
/// [`Error::Photo`].
pub fn photo(camera: &Camera, file: &Path) -> Result<TrainView> {
    read(camera, file).map(|read| read.view)
}

fn read(camera: &Camera, file: &Path) -> Result<ReadPhoto> {
    let bad = |reason: String| Error::Photo { file: file.into(), reason };
    // An image error repeats its own cause.
    let (image, orientation) =
        decoded(file).map_err(|e| bad(format!("PNG, JPEG or WebP expected: {e}")))?;
    let image = turned(image, orientation, camera);
    let (width, height) = (image.width(), image.height());
    let (rgb, masked) = on_black(image);
    let view = at_camera(camera, Photo { width, height, rgb }).map_err(bad)?;
    Ok(ReadPhoto { view, masked })
}

/// A photo at its camera, which is scaled to the photo's size. If the camera has a lens, its distortion is undone.
///
/// # Errors
/// What is wrong with the photo.
pub fn at_camera(camera: &Camera, photo: Photo) -> std::result::Result<TrainView, String> {
    if photo.rgb.is_empty() {
        return Err("empty".into());
    }
    let (w, h) = (photo.width, photo.height);
    let Some(scaled) = camera.scaled_to(w, h) else {
        let (width, height) = (camera.width, camera.height);
        let turned = camera.scaled_to(h, w).is_some();
        return Err(match turned {
            true => format!(
                "{w}x{h}, but its camera has {width}x{height}: the photo is turned by 90 degrees; turn it back"
            ),
            false => format!("{w}x{h}, which is not its camera's aspect ratio ({width}x{height})"),
        });
    };
    let (camera, photo) = undistorted(scaled, photo)?;
    Ok(TrainView { camera, photo })
}

/// The view with at most so many pixels.
pub(crate) fn smaller(view: &TrainView, most: u32) -> TrainView {
    let TrainView { camera, photo } = view;
    let camera = camera.within(most);
    let (w, h) = (camera.width, camera.height);
    if [w, h] == [photo.width, photo.height] {
        return view.clone();
    }
    let Some(image) = RgbImage::from_raw(photo.width, photo.height, photo.rgb.clone()) else {
        return view.clone();
    };
    let rgb = resize(&image, w, h, FilterType::Triangle).into_raw();
    TrainView { camera, photo: Photo { width: w, height: h, rgb } }
}

fn decoded(file: &Path) -> image::ImageResult<(DynamicImage, Orientation)> {
    let reader: ImageReader<BufReader<File>> = ImageReader::open(file)?.with_guessed_format()?;
    let mut decoder = reader.into_decoder()?;
    let orientation = decoder.orientation().unwrap_or(Orientation::NoTransforms);
    Ok((DynamicImage::from_decoder(decoder)?, orientation))
}

/// The photo as its EXIF data turns it, unless only the pixels as they are stored have the camera's shape: some
/// programs that find cameras do not turn photos.
fn turned(image: DynamicImage, orientation: Orientation, camera: &Camera) -> DynamicImage {
    let (stored, mut turned) = (image.clone(), image);
    turned.apply_orientation(orientation);
    let fits = |image: &DynamicImage| camera.scaled_to(image.width(), image.height()).is_some();
    if fits(&stored) && !fits(&turned) { stored } else { turned }
}

/// RGB on a black background, and whether a pixel is transparent.
fn on_black(image: DynamicImage) -> (Vec<u8>, bool) {
    if !image.color().has_alpha() {
        return (image.into_rgb8().into_raw(), false);
    }
    let rgba = image.into_rgba8();
    let masked = rgba.pixels().any(|p| p.0[3] < 255);
    let over = |v: u8, a: u8| ((u32::from(v) * u32::from(a) + 127) / 255) as u8;
    let rgb = rgba.pixels().flat_map(|p| [0, 1, 2].map(|k| over(p.0[k], p.0[3]))).collect();
    (rgb, masked)
}

fn name(file: &Path) -> String {
    file.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

/// The first names, and how many more there are.
fn listed(names: impl ExactSizeIterator<Item = String>) -> String {
    let more = names.len().saturating_sub(LISTED);
    let first = names.take(LISTED).collect::<Vec<_>>().join(", ");
    if more == 0 { first } else { format!("{first} and {more} more") }
}

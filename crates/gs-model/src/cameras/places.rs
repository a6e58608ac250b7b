//! Where tools put cameras, and the photos that go with them.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use serde_json::Value;

use super::{colmap, inria, json, nerf, nerfstudio};
use crate::cameras::camera::{Camera, View};
use crate::cameras::photos::Finder;
use crate::error::{Error, Result, list_of};
use crate::fs;

/// Posed views, and where they are from.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CameraSet {
    /// Sorted by image name (bytewise).
    pub views: Vec<View>,
    /// The folder of the COLMAP model, or the first of the files.
    pub source: PathBuf,
    /// Whose files they are: `COLMAP`, `Inria` or `NeRF`.
    pub form: &'static str,
    /// What a user should know: other cameras that are there, scales, equal names.
    pub notes: Vec<String>,
}

/// COLMAP models in a folder that has no `sparse/`, and no camera file of its own: of nerfstudio, of COLMAP's automatic
/// reconstruction and undistorter, of Inria's `convert.py`. `*` is any folder.
const SPARSE: [&str; 6] =
    ["", "colmap/sparse", "colmap", "dense/sparse", "dense/*/sparse", "distorted/sparse"];
/// Blender scenes, in the order in which they are read.
const SPLITS: [&str; 3] = ["transforms_train.json", "transforms_val.json", "transforms_test.json"];
/// Folders of photos beside a COLMAP model, or above it.
const PHOTOS: [&str; 5] = ["images", "images_2", "images_4", "images_8", "input"];
/// How far above a COLMAP model that was named itself photos are looked for.
const ABOVE: usize = 3;
/// Names that a message lists.
const LISTED: usize = 6;

/// Cameras that are there.
enum Place {
    /// COLMAP models, of which the largest counts.
    Sparse(Vec<PathBuf>),
    /// Camera files, which count together.
    Json(Vec<PathBuf>),
}

/// The cameras of a scene folder, or of a camera file.
///
/// In a folder, cameras are those of the first of these that is there:
/// - `sparse/`, the COLMAP model with the most images of those in it and in its folders; photos in `images/`;
/// - `cameras.json`, an output folder of the Inria trainer; photos where [`crate::inria`] finds them;
/// - `transforms.json`, or else Blender's `transforms_train.json`, `_val` and `_test` together; photos at the paths that
///   they name;
/// - a COLMAP model in the folder itself, in `colmap/sparse/`, `dense/sparse/`, `dense/*/sparse/` or `distorted/sparse/`;
///   photos in the nearest `images/` (or `input/`) on the way up;
/// - the same in the only folder in it that has cameras.
///
/// A file may be a file of a COLMAP model, which stands for its folder, or JSON: what it holds decides of which kind.
/// A photo that is missing is not an error; one with another extension, or in `images_2`, `images_4` or `images_8` (after
/// the name of its folder), is found. Views of equal names are numbered, and have no photo, because nothing tells whose it is.
///
/// # Errors
/// [`Error::Io`] if the path is not there, [`Error::NotADataset`] without cameras, or with cameras in several folders;
/// [`Error::Malformed`] if there are none in the files; those of the readers in [`crate::colmap`], [`crate::inria`] and
/// [`crate::nerf`].
pub fn open_cameras(path: impl AsRef<Path>) -> Result<CameraSet> {
    let path = path.as_ref();
    let set = if path.is_file() {
        match path.parent().filter(|dir| is_of_model(dir, path)) {
            Some(dir) => of_sparse(dir, &[dir.to_owned()])?,
            None => of_json(&[path.to_owned()])?,
        }
    } else {
        match in_folder(path)? {
            Some(place) => of_place(path, place)?,
            None => in_its_folders(path)?,
        }
    };
    finished(set)
}

/// As [`open_cameras`], of the folder itself: cameras in some other folder in it do not count.
///
/// # Errors
/// As [`open_cameras`].
pub fn cameras_in(dir: impl AsRef<Path>) -> Result<CameraSet> {
    let dir = dir.as_ref();
    match in_folder(dir)? {
        Some(place) => finished(of_place(dir, place)?),
        None => Err(nothing(dir)?),
    }
}

/// The folder of the COLMAP model of a scene.
pub(crate) fn sparse_model(dir: &Path) -> Result<Option<PathBuf>> {
    match in_folder(dir)? {
        Some(Place::Sparse(models)) => Ok(Some(of_sparse(dir, &models)?.source)),
        _ => Ok(None),
    }
}

/// Sorted and numbered.
fn finished(mut set: CameraSet) -> Result<CameraSet> {
    if set.views.is_empty() {
        return Err(Error::malformed(&set.source, "the list of cameras", "it is empty"));
    }
    set.views.sort_by(|a, b| a.camera.name.cmp(&b.camera.name));
    if let Some(note) = number_equals(&mut set.views) {
        set.notes.push(note);
    }
    Ok(set)
}

/// Gives sorted views of equal names numbers, and says so.
fn number_equals(views: &mut [View]) -> Option<String> {
    let mut names: BTreeSet<String> = views.iter().map(|v| v.camera.name.clone()).collect();
    let (mut count, mut first) = (0, None);
    for group in views.chunk_by_mut(|a, b| a.camera.name == b.camera.name).filter(|g| g.len() > 1) {
        let name = group[0].camera.name.clone();
        let (stem, end) = match name.rsplit_once('.') {
            Some((stem, end)) if !end.contains('/') => (stem, format!(".{end}")),
            _ => (&name[..], String::new()),
        };
        let mut number = 0;
        for view in group {
            let new = loop {
                number += 1;
                let new = format!("{stem} ({number}){end}");
                if names.insert(new.clone()) {
                    break new;
                }
            };
            // The new name names no photo: nothing tells to which of the cameras the photo of the old name belongs.
            view.image_path.set_file_name(new.rsplit('/').next().unwrap_or_default());
            view.camera.name = new;
            count += 1;
        }
        first.get_or_insert(name);
    }
    let first = first?;
    views.sort_by(|a, b| a.camera.name.cmp(&b.camera.name));
    Some(format!(
        "{count} cameras have names that others have too ({first:?}): they are numbered, and no photo is taken as theirs"
    ))
}

/// What the first place in a folder holds.
fn in_folder(dir: &Path) -> Result<Option<Place>> {
    let models = models(dir, "sparse")?;
    if !models.is_empty() {
        return Ok(Some(Place::Sparse(models)));
    }
    let file = |name: &&str| Some(dir.join(name)).filter(|file| file.is_file());
    if let Some(one) = ["cameras.json", "transforms.json"].iter().find_map(file) {
        return Ok(Some(Place::Json(vec![one])));
    }
    let splits: Vec<PathBuf> = SPLITS.iter().filter_map(file).collect();
    if !splits.is_empty() {
        return Ok(Some(Place::Json(splits)));
    }
    for place in SPARSE {
        let models = models_at(dir, place)?;
        if !models.is_empty() {
            return Ok(Some(Place::Sparse(models)));
        }
    }
    Ok(None)
}

/// What the folders in a folder hold: cameras in one of them, or COLMAP models side by side.
fn in_its_folders(dir: &Path) -> Result<CameraSet> {
    let mut found = Vec::new();
    for folder in folders(dir)? {
        if let Some(place) = in_folder(&folder)? {
            found.push((folder, place));
        }
    }
    let side_by_side = |(folder, place): &(PathBuf, Place)| match place {
        Place::Sparse(models) => models[..] == [folder.clone()],
        Place::Json(_) => false,
    };
    if found.len() > 1 && found.iter().all(side_by_side) {
        let models: Vec<PathBuf> = found.into_iter().map(|(folder, _)| folder).collect();
        return of_sparse(dir, &models);
    }
    match found.len() {
        0 => Err(nothing(dir)?),
        1 => {
            let (folder, place) = found.remove(0);
            of_place(&folder, place)
        }
        _ => {
            let names = found.iter().map(|(folder, _)| name(folder)).collect();
            let reason = format!("cameras in several folders: {}; name one of them", listed(names));
            Err(Error::not_a_dataset(dir, reason))
        }
    }
}

/// The error of a folder without cameras: what was found, and what was expected.
fn nothing(dir: &Path) -> Result<Error> {
    // A missing folder is reported as such, not as a folder without cameras.
    std::fs::read_dir(dir).map_err(|e| Error::io(dir, "list", e))?;
    let expected = "expected sparse/0/images.bin or .txt (COLMAP), cameras.json (Inria output) or transforms.json (NeRF); most other \
                    programs export COLMAP";
    for place in ["sparse"].iter().chain(&SPARSE) {
        for base in bases(dir, place)? {
            for folder in folders(&base)?.into_iter().chain([base]) {
                let reason = match colmap::parts(&folder) {
                    [true, false] => {
                        "it has cameras, but no images.bin or images.txt: no photo was placed"
                    }
                    [false, true] => "it has images, but no cameras.bin or cameras.txt",
                    _ => continue,
                };
                return Ok(Error::not_a_dataset(&folder, reason));
            }
        }
    }
    if dir.join(nerfstudio::FILE).is_file() {
        let reason = "a run of nerfstudio; copy its dataparser_transforms.json beside the transforms.json of the photos, and name \
                      that folder";
        return Ok(Error::not_a_dataset(dir, reason));
    }
    let names: Vec<String> =
        fs::names(dir)?.iter().map(|name| name.to_string_lossy().into_owned()).collect();
    let found = if names.is_empty() {
        "the folder is empty".into()
    } else {
        format!("found {}", listed(names))
    };
    Ok(Error::not_a_dataset(dir, format!("no cameras: {found}; {expected}")))
}

fn of_place(dir: &Path, place: Place) -> Result<CameraSet> {
    match place {
        Place::Sparse(models) => of_sparse(dir, &models),
        Place::Json(files) => of_json(&files),
    }
}

/// True if `file` is one of the files of a COLMAP model in its folder.
fn is_of_model(dir: &Path, file: &Path) -> bool {
    let known = ["bin", "txt"].iter().any(|e| file.extension().is_some_and(|x| x == *e));
    known && colmap::parts(dir) == [true; 2]
}

/// The folders that a place names.
fn bases(dir: &Path, place: &str) -> Result<Vec<PathBuf>> {
    let mut out = vec![dir.to_owned()];
    for part in place.split('/').filter(|part| !part.is_empty()) {
        out = match part {
            "*" => out.iter().map(|dir| folders(dir)).collect::<Result<Vec<_>>>()?.concat(),
            name => out.into_iter().map(|dir| dir.join(name)).collect(),
        };
    }
    Ok(out)
}

/// The COLMAP models at a place: those in the folders of `sparse`, and in it itself; elsewhere those in the folder itself.
fn models_at(dir: &Path, place: &str) -> Result<Vec<PathBuf>> {
    if place.ends_with("sparse") {
        return models(dir, place);
    }
    let bases = bases(dir, place)?;
    Ok(bases.into_iter().filter(|base| colmap::parts(base) == [true; 2]).collect())
}

fn models(dir: &Path, place: &str) -> Result<Vec<PathBuf>> {
    let mut out = Vec::new();
    for base in bases(dir, place)? {
        out.extend(folders(&base)?.into_iter().chain([base]));
    }
    out.retain(|folder| colmap::parts(folder) == [true; 2]);
    Ok(out)
}

/// The folders in a folder, by number and by name.
fn folders(dir: &Path) -> Result<Vec<PathBuf>> {
    let mut names = fs::names(dir)?;
    names.sort_by_key(|name| {
        let name = name.to_string_lossy().into_owned();
        (name.parse::<u64>().unwrap_or(u64::MAX), name)
    });
    Ok(names.iter().map(|name| dir.join(name)).filter(|folder| folder.is_dir()).collect())
}

/// The views of the COLMAP model with the most images; `dir` is the folder that was named.
fn of_sparse(dir: &Path, models: &[PathBuf]) -> Result<CameraSet> {
    let mut read = Vec::new();
    let mut notes = Vec::new();
    for model in models {
        match colmap::read_cameras(model) {
            Ok(cameras) => read.push((model, cameras)),
            Err(error) if models.len() == 1 => return Err(error),
            Err(error) => notes.push(format!("{}, so it is not used", crate::chain(&error))),
        }
    }
    let counts: Vec<(String, usize)> =
        read.iter().map(|(model, cameras)| (name(model), cameras.len())).collect();
    // Of models with equal numbers of cameras, the first counts.
    let Some((model, cameras)) = read.into_iter().rev().max_by_key(|(_, cameras)| cameras.len())
    else {
        return Err(Error::not_a_dataset(
            dir,
            format!("no COLMAP model can be read: {}", notes.join("; ")),
        ));
    };
    if counts.len() > 1 {
        let own = name(model);
        let others = counts.iter().filter(|(name, _)| *name != own);
        let others: Vec<String> = others.map(|(name, n)| format!("{name} has {n}")).collect();
        let n = cameras.len();
        let model = model.display();
        notes.push(format!(
            "{model}: the largest of {} models, with {n} images; {}",
            counts.len(),
            listed(others)
        ));
    }
    let root = photo_root(dir, model);
    let mut finder = Finder::default();
    let view = |camera: Camera| {
        let found = match finder.find_in(&root, &camera.name)? {
            // Some projects name photos by paths relative to the scene's folder.
            None => finder.find(root.parent().unwrap_or(Path::new("")), Path::new(&camera.name))?,
            found => found,
        };
        Ok(View { image_path: found.unwrap_or_else(|| root.join(&camera.name)), camera })
    };
    let views = cameras.into_iter().map(view).collect::<Result<_>>()?;
    Ok(CameraSet { views, source: model.clone(), form: "COLMAP", notes })
}

/// The folder of the photos of a COLMAP model: the nearest on the way up to the folder that was named; above it if the
/// model itself was named, or the folder around it.
fn photo_root(dir: &Path, model: &Path) -> PathBuf {
    let named = model == dir || (model.parent() == Some(dir) && !is_base(model));
    let whole =
        if named { std::path::absolute(model).unwrap_or_default() } else { model.to_owned() };
    let distorted = model.components().any(|part| part.as_os_str() == "distorted");
    for (i, above) in whole.ancestors().enumerate() {
        let mut folders: Vec<PathBuf> = PHOTOS.iter().map(|name| above.join(name)).collect();
        // Inria's convert.py keeps the photos before undistortion in input/.
        if distorted {
            folders.rotate_right(1);
        }
        if let Some(found) = folders.iter().find(|folder| folder.is_dir()) {
            // Smaller photos are looked for beside images/.
            let full = !found.ends_with("input");
            return if full { above.join("images") } else { found.clone() };
        }
        if (named && i == ABOVE) || (!named && above == dir) {
            break;
        }
    }
    dir.join("images")
}

/// True of a folder in which tools put COLMAP models.
fn is_base(folder: &Path) -> bool {
    ["sparse", "colmap"].iter().any(|name| folder.ends_with(name))
}

/// The views of camera files; what they hold decides of which kind they are.
fn of_json(files: &[PathBuf]) -> Result<CameraSet> {
    let mut set =
        CameraSet { source: files.first().cloned().unwrap_or_default(), ..CameraSet::default() };
    for file in files {
        let bytes = fs::read(file)?;
        let text = fs::text(&bytes);
        if !text.trim_ascii_start().starts_with(b"[") && !text.trim_ascii_start().starts_with(b"{")
        {
            let expected = "a camera file (cameras.json of Inria, transforms.json, images.bin or images.txt of COLMAP)";
            return Err(Error::other_format(file, expected, &bytes));
        }
        let (views, form) = match json::parse(file, &bytes)? {
            Value::Array(entries) => (inria::views(file, &entries, &mut set.notes)?, "Inria"),
            Value::Object(all) if all.contains_key("frames") => {
                (nerf::views(file, &all, &mut set.notes)?, "NeRF")
            }
            Value::Object(all) => {
                let found = listed(all.keys().cloned().collect());
                let reason = format!(
                    "no frames, which list the cameras of a transforms.json; it has {found}"
                );
                return Err(Error::malformed(file, "the file", reason));
            }
            _ => return Err(Error::malformed(file, "the file", "neither a list nor an object")),
        };
        set.views.extend(views);
        set.form = form;
    }
    if let [first, others @ ..] = files
        && !others.is_empty()
    {
        let others = listed(others.iter().map(|file| name(file)).collect());
        set.notes.push(format!("{}: read together with {others}", first.display()));
    }
    Ok(set)
}

fn name(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

/// The first names, and how many more there are.
fn listed(names: Vec<String>) -> String {
    list_of(LISTED, names).unwrap_or_default()
}

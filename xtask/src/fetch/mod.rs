//! `cargo xtask fetch SCENE`: only what is needed out of the public archives.
//!
//! The trained models of the paper's scenes are in one ZIP of 14 GB, their photos in another of 650 MB. A ZIP's
//! directory is at its end and says where each entry is, so range requests bring single files.
//!
//! A file gets its name only when it is whole and its CRC-32 is the archive's. A fetch that is cut goes on with the
//! files that are missing.

mod ranged;
#[cfg(test)]
mod tests;

use std::fs::{self, File};
use std::io::{self, Read, Seek};
use std::path::{Path, PathBuf};

use anyhow::{Context, Error, Result, bail, ensure};
use eval::progress::Bar;
use eval::scenes;
use gs_model::dataset::Dataset;
use zip::ZipArchive;
use zip::result::ZipError;

use ranged::RangeReader;

/// Folder of the archives on Inria's server.
const PUBLIC: &str = "https://repo-sam.inria.fr/fungraph/3d-gaussian-splatting/datasets";

/// The scenes of the paper, each with its folder in `tandt_db.zip`.
const SCENES: [(&str, &str); 4] = [
    ("playroom", "db/playroom/"),
    ("truck", "tandt/truck/"),
    ("train", "tandt/train/"),
    ("drjohnson", "db/drjohnson/"),
];

/// Flags of `cargo xtask fetch`.
#[derive(Clone, Debug, clap::Args)]
pub(crate) struct FetchArgs {
    /// playroom, truck, train or drjohnson
    #[arg(required = true, value_parser = SCENES.map(|s| s.0))]
    scenes: Vec<String>,
    /// Folder to put the scenes into, one folder each; the registry's places if not given
    #[arg(long, value_name = "DIR")]
    cache: Option<PathBuf>,
    /// Folder with pretrained/models.zip and input/tandt_db.zip: an http(s):// address or a path
    #[arg(long, value_name = "URL", default_value = PUBLIC)]
    mirror: String,
}

/// Fetches the scenes.
pub(crate) fn run(args: &FetchArgs) -> Result<()> {
    for name in &args.scenes {
        let (dir, argument) = match &args.cache {
            Some(cache) => (cache.join(name), cache.join(name).display().to_string()),
            None => (scenes::dir_of(name)?, name.clone()),
        };
        fetch(name, &args.mirror, &dir)?;
        let dataset = Dataset::open(&dir)
            .with_context(|| format!("{} was fetched, but cannot be opened", dir.display()))?;
        if let Some(view) = dataset.views.iter().find(|view| !view.has_photo()) {
            bail!("{}: the archive has no such photo", view.image_path.display());
        }
        let (views, dir) = (dataset.views.len(), dir.display());
        eprintln!("{name}: {views} views in {dir}; next: cargo xtask rd-curve {argument}");
    }
    Ok(())
}

/// Fetches what is missing of a scene into `dir`.
fn fetch(name: &str, mirror: &str, dir: &Path) -> Result<()> {
    let scene = SCENES.iter().find(|s| s.0 == name);
    let &(_, photos) = scene.with_context(|| format!("{name} cannot be fetched"))?;
    let photos = Source { archive: "input/tandt_db.zip", folder: photos.into(), wanted: of_photos };
    let model = format!("{name}/");
    let model = Source { archive: "pretrained/models.zip", folder: model, wanted: of_model };
    for source in [photos, model] {
        let address = format!("{}/{}", mirror.trim_end_matches('/'), source.archive);
        let fetched = if address.starts_with("http://") || address.starts_with("https://") {
            RangeReader::open(&address).and_then(|bytes| extract(&source, bytes, dir))
        } else {
            File::open(&address).map_err(Into::into).and_then(|file| extract(&source, file, dir))
        };
        fetched.with_context(|| {
            format!(
                "{address}: cannot be fetched; download {PUBLIC}/{} to DIR/{} and use --mirror DIR",
                source.archive, source.archive
            )
        })?;
    }
    Ok(())
}

/// A scene's folder in an archive.
struct Source {
    archive: &'static str,
    folder: String,
    /// The path on disk of a file of the folder; `None` if it is not wanted.
    wanted: fn(&str) -> Option<&str>,
}

/// COLMAP's cameras and images, and the photos. Nothing here reads COLMAP's points.
fn of_photos(path: &str) -> Option<&str> {
    let hidden = path.rsplit('/').next().is_some_and(|file| file.starts_with("._"));
    let photo = [".jpg", ".jpeg", ".png"].iter().any(|e| path.to_lowercase().ends_with(e));
    let colmap = ["cameras.bin", "cameras.txt", "images.bin", "images.txt"];
    let is_colmap = path.strip_prefix("sparse/0/").is_some_and(|file| colmap.contains(&file));
    (is_colmap || path.starts_with("images/") && photo && !hidden).then_some(path)
}

/// The trained model of the last iteration, and its cameras.
fn of_model(path: &str) -> Option<&str> {
    match path {
        "point_cloud/iteration_30000/point_cloud.ply" => Some("point_cloud.ply"),
        "cameras.json" => Some(path),
        _ => None,
    }
}

/// Writes the wanted files that are not in `dir` yet.
fn extract(source: &Source, bytes: impl Read + Seek, dir: &Path) -> Result<()> {
    let mut zip = ZipArchive::new(bytes).map_err(cause)?;
    let (mut missing, mut total, mut found) = (Vec::new(), 0, 0);
    for i in 0..zip.len() {
        let entry = zip.by_index_raw(i).map_err(cause)?;
        let name = entry.name()?;
        let wanted = name.strip_prefix(&source.folder).and_then(source.wanted);
        let Some(path) = wanted.filter(|_| entry.enclosed_name().is_some()) else { continue };
        found += 1;
        let path = dir.join(path);
        if !path.exists() {
            total += entry.size();
            missing.push((i, path));
        }
    }
    ensure!(found > 0, "there is no entry {}*", source.folder);
    let bar = Bar::bytes(&format!("{} files from {}", missing.len(), source.archive), total);
    for (i, path) in missing {
        let mut entry = zip.by_index(i).map_err(cause)?;
        bar.step(entry.size());
        let name = entry.name()?.into_owned();
        write(&mut entry, &path).with_context(|| format!("entry {name}"))?;
    }
    bar.done();
    Ok(())
}

/// What went wrong with an archive. An error of reading quotes its cause, so the cause alone is told.
fn cause(error: ZipError) -> Error {
    match error {
        ZipError::Io(cause) => cause.into(),
        other => other.into(),
    }
}

/// Writes a file that gets its name when it is whole. At its end the reader checks the CRC-32.
fn write(from: &mut impl Read, path: &Path) -> Result<()> {
    let part = path.with_added_extension("part");
    fs::create_dir_all(path.parent().unwrap_or(path))?;
    let mut file = File::create(&part)?;
    io::copy(from, &mut file).with_context(|| format!("write {}", part.display()))?;
    file.sync_all()?;
    fs::rename(&part, path).with_context(|| format!("write {}", path.display()))
}

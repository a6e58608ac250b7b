//! `cargo xtask fetch SCENE`: only what is needed out of the public archives.
//!
//! The trained models of the paper's scenes are in one ZIP of 14 GB, their photos in another of
//! 650 MB. A ZIP's directory is at its end, and says where each entry is: with range requests,
//! one PLY is one request.
//!
//! What has arrived is kept, so a fetch that is cut goes on where it stopped. A file gets its name
//! only when it is whole and its CRC-32 is the archive's. Its SHA-256 is then recorded in
//! `fetch.toml` and checked by every later run.

mod catalogue;
mod directory;
mod fault;
mod job;
mod record;
mod server;
mod source;
#[cfg(test)]
mod tests;

use std::path::{Path, PathBuf};
use std::time::Duration;

use anyhow::{Context, Result, bail};
use eval::scenes;
use gs_model::dataset::Dataset;

/// Flags of `cargo xtask fetch`.
#[derive(Clone, Debug, clap::Args)]
pub(crate) struct Args {
    /// playroom, truck, train or drjohnson
    #[arg(required = true, value_parser = catalogue::SCENES.map(|s| s.name))]
    scenes: Vec<String>,
    /// Folder to put the scenes into, one folder each; the registry's places if not given
    #[arg(long, value_name = "DIR")]
    cache: Option<PathBuf>,
    /// Where models.zip and tandt_db.zip are: an http(s):// or file:// address or a path, of a
    /// folder or of one archive (repeat for both)
    #[arg(long, value_name = "URL")]
    mirror: Vec<String>,
    /// Longest silence of a server, in seconds
    #[arg(long, default_value_t = 60, value_parser = clap::value_parser!(u64).range(1..))]
    timeout: u64,
}

/// Fetches the scenes.
pub(crate) fn run(args: &Args) -> Result<()> {
    let options = job::Options::new(&args.mirror, Duration::from_secs(args.timeout));
    for name in &args.scenes {
        fetch(name, args.cache.as_deref(), &options)?;
    }
    Ok(())
}

fn fetch(name: &str, cache: Option<&Path>, options: &job::Options) -> Result<()> {
    let scene = catalogue::SCENES.into_iter().find(|s| s.name == name);
    let scene = scene.with_context(|| format!("{name} cannot be fetched"))?;
    let (dir, argument) = match cache {
        Some(cache) => {
            let dir = cache.join(name);
            (dir.clone(), dir.display().to_string())
        }
        None => (scenes::dir_of(name)?, name.to_owned()),
    };
    let summary = job::fetch(scene, &dir, options)?;
    let dataset = Dataset::open(&dir)
        .with_context(|| format!("{} was fetched, but cannot be opened", dir.display()))?;
    if let Some(view) = dataset.views.iter().find(|view| !view.has_photo()) {
        bail!(
            "{}: the archive has no such photo; use another by --mirror",
            view.image_path.display()
        );
    }
    eprintln!(
        "{name}: {} views, {} files fetched, {} checked, in {}; next: cargo xtask rd-curve {argument}",
        dataset.views.len(),
        summary.fetched,
        summary.kept,
        dir.display()
    );
    Ok(())
}

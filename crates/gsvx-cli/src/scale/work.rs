//! The tiles of a plan: their Gaussians on disk, their streams, and the join of these.

use super::cameras::PlanCameras;
use super::plan_file::PlanFile;
use super::rows::TileRows;
use super::scratch::Scratch;
use crate::commands::join;
use crate::output::{Output, counted};
use crate::progress::Meter;
use crate::report::Reporter;
use crate::stream_file::StreamFile;
use crate::views::Origin;
use anyhow::{Error, Result};
use gsvx::Index;
use indicatif::DecimalBytes;
use rayon::prelude::*;
use serde_json::json;
use std::path::PathBuf;
use std::time::Instant;

/// Name of the stream of a part without tiles.
const NOTHING: &str = "tile-none.gsvx";
/// Bytes of a stream per Gaussian, at most: for the room that is needed.
const STREAM_BYTES: u64 = 60;
/// Bytes of a mean.
const MEAN_BYTES: u64 = 12;

/// Tiles of a plan that are to be encoded.
pub(super) struct Work<'a> {
    pub(super) plan: &'a PlanFile,
    pub(super) tiles: Vec<usize>,
    pub(super) cameras: Option<&'a PlanCameras>,
    pub(super) scratch: &'a Scratch,
}

impl<'a> Work<'a> {
    pub(super) fn of_all(
        plan: &'a PlanFile,
        cameras: Option<&'a PlanCameras>,
        scratch: &'a Scratch,
    ) -> Self {
        let tiles = (0..plan.plan.tile_counts().len()).collect();
        Self { plan, tiles, cameras, scratch }
    }

    fn gaussians(&self) -> u64 {
        self.tiles.iter().map(|&t| self.plan.plan.tile_counts()[t]).sum()
    }

    /// The Gaussians of the tiles on disk. Refuses work for which the disk is too small.
    pub(super) fn rows(&self) -> Result<TileRows> {
        let sh_degree = self.plan.plan.sh_degree();
        let row = gs_model::ply::row_bytes(sh_degree) as u64;
        self.scratch.check_room(self.gaussians() * (row + STREAM_BYTES + MEAN_BYTES))?;
        TileRows::write(self.plan, &self.tiles, sh_degree, self.scratch)
    }

    /// Encodes the tiles, each as a stream among the scratch files.
    pub(super) fn encode(&self, at_once: usize, start: Instant) -> Result<TileStreams> {
        let Self { plan, tiles, cameras, scratch } = self;
        let name = |tile: usize| format!("tile-{tile:06}.gsvx");
        let left: Vec<usize> = tiles.iter().copied().filter(|&t| !scratch.has(&name(t))).collect();
        let mut streams: Vec<PathBuf> = tiles.iter().map(|&t| scratch.path(&name(t))).collect();
        if tiles.is_empty() {
            // The join needs a head.
            scratch.write(NOTHING, &plan.plan.encode_nothing()?.bytes)?;
            streams.push(scratch.path(NOTHING));
        }
        let rows = if left.is_empty() { None } else { Some(self.rows()?) };
        let before = start.elapsed().as_secs_f64();
        let step = Instant::now();
        if let Some(rows) = rows {
            let bar = Meter::new("encode", tiles.len());
            (left.len()..tiles.len()).for_each(|_| bar.inc());
            for some in left.chunks(at_once) {
                some.par_iter().with_max_len(1).try_for_each(|&tile| {
                    let gaussians = rows.tile(tile)?;
                    let seen = cameras.map(|s| s.of(&gaussians).squared).unwrap_or_default();
                    let encoded = plan.plan.encode(tile, &gaussians, &seen)?;
                    scratch.write(&name(tile), &encoded.bytes)?;
                    bar.inc();
                    Ok::<(), Error>(())
                })?;
            }
        }
        let input_bytes = plan.inputs.iter().map(|i| i.bytes).sum();
        let transparent = plan.inputs.iter().map(|i| i.transparent).sum();
        let (gaussians, tiles) = (self.gaussians(), step.elapsed().as_secs_f64());
        let cameras = cameras.and_then(|cameras| cameras.origin.clone());
        Ok(TileStreams { streams, gaussians, transparent, input_bytes, cameras, before, tiles })
    }
}

/// Tiles as streams among the scratch files.
pub(super) struct TileStreams {
    streams: Vec<PathBuf>,
    gaussians: u64,
    /// Of all inputs: those that no rasterizer draws.
    transparent: u64,
    input_bytes: u64,
    cameras: Option<Origin>,
    /// Seconds until the tiles were begun, and of the tiles.
    before: f64,
    tiles: f64,
}

impl TileStreams {
    /// Joins the tiles, and says what was made.
    pub(super) fn write(self, output: Output, mark: &str, report: Reporter) -> Result<()> {
        let step = Instant::now();
        let heads = self.streams.iter().map(|p| Ok(StreamFile::open(p)?.index));
        let heads = heads.collect::<Result<Vec<_>>>()?;
        let mut index = Index::default();
        let written = output.write(|out| {
            index = join::write(&self.streams, &heads, out)?;
            Ok(out.write_all(mark.as_bytes())?)
        })?;
        let join = step.elapsed().as_secs_f64();
        let (bytes, coded) = (index.stream_len(), index.header.count);
        let Self { streams, gaussians, transparent, input_bytes, cameras, before, tiles } = self;
        let human = format!(
            "{gaussians} Gaussians coded as {coded}, {} -> {} ({:.1} bits per Gaussian), {}\n\
             read and partition {before:.2} s, encode {tiles:.2} s, join {join:.2} s{}",
            DecimalBytes(input_bytes),
            DecimalBytes(bytes),
            8.0 * bytes as f64 / coded.max(1) as f64,
            counted(streams.len(), "tile"),
            line(cameras.as_ref()),
        );
        let json = json!({
            "bytes": bytes,
            "input_bytes": input_bytes,
            "input_gaussians": gaussians,
            "gaussians": coded,
            "transparent": transparent,
            "tiles": streams.len(),
            "cameras": cameras.as_ref().map(Origin::json),
            "partition_seconds": before,
            "encode_seconds": tiles,
            "join_seconds": join,
        });
        report.wrote(&written, &human, json)
    }
}

/// A further line that says where cameras are from.
pub(super) fn line(origin: Option<&Origin>) -> String {
    origin.map_or_else(String::new, |origin| format!("\n{}", origin.human()))
}

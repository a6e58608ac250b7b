//! The Gaussians of a scene on disk, tile by tile, each in the order of the input: as rows of a PLY.

use super::inputs::{SceneFile, changed, progress};
use super::plan_file::PlanFile;
use super::scratch::{KEPT as FILE, Scratch};
use crate::positional::At;
use anyhow::{Context, Error, Result};
use gs_model::{Scene, ply};
use gsvx::Plan;
use rayon::prelude::*;
use std::fs::File;
use std::io::{Read, Write};
use std::ops::Range;

/// Rows of some tiles.
#[derive(Debug)]
pub(crate) struct TileRows {
    file: File,
    /// The rows of each tile; none of those that are not here.
    places: Vec<Range<u64>>,
    /// Without Gaussians, of the SH degree of the rows.
    empty: Scene,
}

impl TileRows {
    /// Rows of the tiles `wanted`, without room for others.
    fn of(file: File, plan: &Plan, wanted: &[usize], sh_degree: u8) -> Self {
        let mut end = 0;
        let place = |(tile, &count): (usize, &u64)| {
            let first = end;
            end += if wanted.contains(&tile) { count } else { 0 };
            first..end
        };
        let places = plan.tile_counts().iter().enumerate().map(place).collect();
        Self { file, places, empty: plan.empty_scene().emptied(sh_degree) }
    }

    /// Reads the inputs and writes the Gaussians of the tiles `wanted`, up to an SH degree, unless a run before
    /// has.
    pub(crate) fn write(
        plan: &PlanFile,
        wanted: &[usize],
        sh_degree: u8,
        scratch: &Scratch,
    ) -> Result<Self> {
        let PlanFile { plan, inputs, reading, .. } = plan;
        let open = |file| Self::of(file, plan, wanted, sh_degree);
        if scratch.has(FILE) {
            return Ok(open(File::open(scratch.path(FILE)).map_err(|e| scratch.full(e))?));
        }
        let rows = open(scratch.begin(FILE)?);
        let mut next: Vec<u64> = rows.places.iter().map(|p| p.start).collect();
        let has_wanted =
            |i: &&SceneFile| i.tiles.iter().any(|&t| !rows.places[t as usize].is_empty());
        let bar = progress("partition", inputs.iter().filter(has_wanted));
        for input in inputs.iter().filter(has_wanted) {
            input.read(reading, &bar, |mut scene| {
                scene.move_origin(rows.empty.origin);
                let tiles = plan.tiles_of(&scene.means).map_err(|_| changed(&input.path))?;
                let fit = rows.put(&scene, &tiles, &mut next, scratch)?;
                if fit { Ok(()) } else { Err(changed(&input.path)) }
            })?;
        }
        if let Some(tile) = (0..next.len()).find(|&t| next[t] != rows.places[t].end) {
            let input = inputs.iter().find(|i| i.tiles.contains(&(tile as u32)));
            return Err(changed(&input.context("a plan without inputs")?.path));
        }
        scratch.finish(FILE)?;
        Ok(rows)
    }

    /// Appends Gaussians to their tiles; `next` is where the next row of each tile goes. False if a tile has no
    /// room for them.
    fn put(
        &self,
        scene: &Scene,
        tiles: &[u32],
        next: &mut [u64],
        scratch: &Scratch,
    ) -> Result<bool> {
        let mut members = vec![Vec::new(); self.places.len()];
        for (i, &tile) in tiles.iter().enumerate() {
            if !self.places[tile as usize].is_empty() {
                members[tile as usize].push(i);
            }
        }
        let places = self.places.iter().zip(&members);
        if next.iter().zip(places).any(|(next, (p, m))| next + m.len() as u64 > p.end) {
            return Ok(false);
        }
        let row = ply::row_bytes(self.empty.sh_degree) as u64;
        next.par_iter_mut().zip(&members).filter(|(_, m)| !m.is_empty()).try_for_each(
            |(next, members)| {
                let mut part = self.empty.clone();
                part.append(&scene.select(members));
                let mut bytes = Vec::new();
                ply::rows(&part, &mut bytes)?;
                At(&self.file, *next * row).write_all(&bytes).map_err(|e| scratch.full(e))?;
                *next += members.len() as u64;
                Ok::<_, Error>(())
            },
        )?;
        Ok(true)
    }

    /// The Gaussians of a tile.
    pub(crate) fn tile(&self, tile: usize) -> Result<Scene> {
        let Range { start, end } = self.places[tile];
        let (count, row) = ((end - start) as usize, ply::row_bytes(self.empty.sh_degree));
        let mut bytes = ply::header(count, &self.empty);
        let header = bytes.len();
        bytes.resize(header + count * row, 0);
        At(&self.file, start * row as u64)
            .read_exact(&mut bytes[header..])
            .context("the scratch files cannot be read")?;
        Ok(ply::read_bytes(&bytes)?.0)
    }
}

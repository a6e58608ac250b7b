//! The Gaussians of a scene on disk, tile by tile, each in the order of the input: as rows of a PLY.

use super::inputs::{Input, steps};
use super::plan_file::PlanFile;
use super::scratch::{KEPT as FILE, Scratch};
use crate::positional::{read_exact_at, write_all_at};
use anyhow::{Context, Result};
use gs_model::{Scene, ply};
use gsvx::Plan;
use rayon::prelude::*;
use std::fs::File;
use std::ops::Range;

/// Rows of some tiles.
#[derive(Debug)]
pub(crate) struct Rows {
    file: File,
    /// The rows of each tile; none of those that are not here.
    places: Vec<Range<u64>>,
    sh_degree: u8,
}

/// Where Gaussians come from.
struct From<'a> {
    input: &'a Input,
    plan: &'a Plan,
    scratch: &'a Scratch,
}

impl Rows {
    /// Rows of the tiles `wanted`, without room for others.
    fn of(file: File, plan: &Plan, wanted: &[usize], sh_degree: u8) -> Self {
        let mut end = 0;
        let place = |(tile, &count): (usize, &u64)| {
            let first = end;
            end += if wanted.contains(&tile) { count } else { 0 };
            first..end
        };
        let places = plan.tile_counts().iter().enumerate().map(place).collect();
        Self { file, places, sh_degree }
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
        let has_wanted = |i: &&Input| i.tiles.iter().any(|&t| !rows.places[t as usize].is_empty());
        let bar = steps("partition", inputs.iter().filter(has_wanted));
        for input in inputs.iter().filter(has_wanted) {
            input.check()?;
            let from = From { input, plan, scratch };
            let found =
                input.each(reading, false, &bar, |scene| rows.put(&from, &scene, &mut next))?;
            if found != input.gaussians {
                return Err(input.changed());
            }
        }
        if let Some(tile) = (0..next.len()).find(|&t| next[t] != rows.places[t].end) {
            let input = inputs.iter().find(|i| i.tiles.contains(&(tile as u32)));
            return Err(input.context("a plan without inputs")?.changed());
        }
        scratch.finish(FILE)?;
        Ok(rows)
    }

    /// Appends Gaussians to their tiles; `next` is where the next row of each tile goes.
    fn put(&self, from: &From<'_>, scene: &Scene, next: &mut [u64]) -> Result<()> {
        let From { input, plan, scratch } = from;
        let mut members = vec![Vec::new(); self.places.len()];
        let tiles = plan.tiles_of(&scene.means).map_err(|_| input.changed())?;
        for (i, tile) in tiles.into_iter().enumerate() {
            if !self.places[tile as usize].is_empty() {
                members[tile as usize].push(i);
            }
        }
        let row = ply::row_bytes(self.sh_degree) as u64;
        let jobs: Vec<_> = members.iter().enumerate().filter(|(_, m)| !m.is_empty()).collect();
        jobs.into_par_iter().try_for_each(|(tile, members)| {
            if next[tile] + members.len() as u64 > self.places[tile].end {
                return Err(input.changed());
            }
            let mut part = Scene { sh_degree: self.sh_degree, ..Scene::default() };
            part.append(&scene.select(members));
            let mut bytes = Vec::new();
            ply::rows(&part, &mut bytes)?;
            write_all_at(&self.file, &bytes, next[tile] * row).map_err(|e| scratch.full(e))
        })?;
        next.iter_mut().zip(&members).for_each(|(next, m)| *next += m.len() as u64);
        Ok(())
    }

    /// The Gaussians of a tile.
    pub(crate) fn tile(&self, tile: usize) -> Result<Scene> {
        let Range { start, end } = self.places[tile];
        let (count, row) = ((end - start) as usize, ply::row_bytes(self.sh_degree));
        let mut bytes = ply::header(count, self.sh_degree);
        let header = bytes.len();
        bytes.resize(header + count * row, 0);
        read_exact_at(&self.file, &mut bytes[header..], start * row as u64)
            .context("the scratch files cannot be read")?;
        Ok(ply::read_bytes(&bytes)?.0)
    }
}

//! `cargo xtask fixture`: makes fixtures/room.

use std::path::PathBuf;

use anyhow::Result;
use eval::room;

/// Flags of `cargo xtask fixture`.
#[derive(Clone, Debug, clap::Args)]
pub(crate) struct Args {
    /// Folder to write, replacing what is there
    #[arg(long, default_value = "fixtures/room")]
    out: PathBuf,
    /// Seed of every random number
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Number of photos
    #[arg(long, default_value_t = 32)]
    views: u32,
    /// Light paths per pixel
    #[arg(long, default_value_t = 128)]
    samples: u32,
    /// Number of Gaussians, about
    #[arg(long, default_value_t = 11_000)]
    gaussians: usize,
    /// Optimiser steps that fit the model to the training photos
    #[arg(long, default_value_t = 4000)]
    steps: u64,
    /// Write only the model: keep photos and cameras that are already there
    #[arg(long)]
    model_only: bool,
}

pub(crate) fn run(args: Args) -> Result<()> {
    let Args { out, seed, views, samples, gaussians, steps, model_only } = args;
    room::run(&room::Options { out, seed, views, samples, gaussians, steps, model_only })
}

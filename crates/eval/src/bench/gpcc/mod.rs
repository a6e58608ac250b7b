//! gpcc-lite beside TMC13's recorded figures.

mod cloud;
mod lossy;

use std::path::PathBuf;

use anyhow::{Context, Result, ensure};
use gpcc_lite::predict::{self, Neighbours};
use gpcc_lite::{Limits, geometry};

use crate::cells;
use crate::page::{Page, Table};
use cloud::{Peer, read};

/// Flags of `cargo xtask bench-gpcc`.
#[derive(Clone, Debug, clap::Args)]
pub struct GpccOptions {
    /// Directory of the clouds and `tmc13.jsonl`
    #[arg(long, default_value = "../shared/clouds")]
    clouds: PathBuf,
    /// Only these clouds
    #[arg(long, value_delimiter = ',', default_values = ["vic12", "vic15", "jus15", "gsv12", "kac15", "syn15"])]
    only: Vec<String>,
    /// Quantisation parameters of the lossy channels
    #[arg(long, value_delimiter = ',', default_values = ["4", "16", "28", "34", "40"])]
    qp: Vec<u8>,
    /// Where the page goes
    #[arg(long, default_value = "docs/results/gpcc.md")]
    out: PathBuf,
}

/// Measures and writes the page.
///
/// # Errors
/// If a cloud or the record cannot be read, or a stream does not decode to what was coded.
pub fn run(options: &GpccOptions) -> Result<()> {
    let peers = cloud::peers(&options.clouds.join("tmc13.jsonl"))?;
    let mut page = Page::new(&options.out, "How does the point-cloud coder compare with TMC13?");
    page.text(
        "`cargo xtask bench-gpcc`. TMC13 v23 is MPEG's test model of G-PCC, the coder that the paper uses; its figures \
         are recorded (`tmc13.jsonl` beside the clouds). Ours are whole streams that decode correctly. Rates are bits \
         per point. \"Authors\" are the settings of the paper's scripts, \"best\" is the smallest of all recorded \
         option sets.",
    );
    page.text(
        "Lossy rates are compared at TMC13's squared error, summed over the 8-bit channels after rounding and clipping \
         (opacity: the 16-bit attribute divided by 257, as TMC13 codes it). Our step is searched until the error \
         agrees within 0.2 %; the rest is interpolated. A byte for the step of each channel is counted. \"RAHT and \
         RLGR\" is the paper's coder: a uniform quantiser of RAHT coefficients, each channel coded by RLGR.",
    );
    page.text("## Geometry");
    page.table(&of_geometry(options, &peers)?);
    page.text("## RAHT");
    page.table(&lossy::table(&options.clouds, &options.only, &options.qp, &peers)?);
    page.text("## Lossless channels");
    page.table(&lossless(options, &peers)?);
    page.write()
}

/// The peer with the authors' settings and at its best, ours, and ours against both.
fn cells_of(authors: f64, best: f64, ours: f64) -> Vec<String> {
    let bits = |x: f64| if x.is_nan() { "-".into() } else { format!("{x:.3}") };
    let against = |theirs: f64| match theirs.is_nan() {
        true => "-".into(),
        false => format!("{:+.2} %", (ours / theirs - 1.0) * 100.0),
    };
    cells![bits(authors), bits(best), bits(ours), against(authors), against(best)]
}

const COLUMNS: &str = "TMC13 authors | TMC13 best | gpcc-lite | against authors | against best";

/// Geometry of each cloud.
fn of_geometry(options: &GpccOptions, peers: &[Peer]) -> Result<Table> {
    let mut table = Table::new(&format!("cloud | points | {COLUMNS}"));
    for name in &options.only {
        let cloud =
            read(&options.clouds, name, "dc")?.with_context(|| format!("no cloud {name}"))?;
        let bytes = geometry::encode(&cloud.octree)?;
        let back = geometry::decode(&bytes, &Limits::for_stream(bytes.len()))?;
        ensure!(back == cloud.octree, "{name}: geometry differs");
        let of = peers
            .iter()
            .filter(|p| p.cloud == *name && p.name.starts_with("g_") && p.geometry_bits > 0.0);
        let authors =
            of.clone().find(|p| p.name == "g_default").map_or(f64::NAN, |p| p.geometry_bits);
        let best = of.map(|p| p.geometry_bits).fold(f64::NAN, f64::min);
        let ours = bytes.len() as f64 * 8.0 / cloud.octree.len() as f64;
        let mut row = cells![name, cloud.octree.len()];
        row.extend(cells_of(authors, best, ours));
        table.told(row);
    }
    Ok(table)
}

/// Channels without loss.
fn lossless(options: &GpccOptions, peers: &[Peer]) -> Result<Table> {
    let mut table = Table::new(&format!("cloud | attribute | {COLUMNS}"));
    for name in &options.only {
        for attribute in ["dc", "rest", "scale", "rot"] {
            let Some(cloud) = read(&options.clouds, name, attribute)? else { continue };
            let near = Neighbours::new(&cloud.octree);
            let refs: Vec<&[i32]> = cloud.channels.iter().map(Vec::as_slice).collect();
            let bytes = predict::encode_lossless(&near, &refs)?;
            let back = predict::decode_lossless(&near, &bytes, refs.len())?;
            ensure!(back == cloud.channels, "{name} {attribute}: channels differ");
            let of = peers.iter().filter(|p| {
                let same = p.cloud == *name && p.attribute == attribute;
                same && p.mse == 0.0 && p.attribute_bits > 0.0
            });
            let authors = of.clone().find(|p| p.name == "p_auth" || p.name == "p_auth_col");
            let authors = authors.map_or(f64::NAN, |p| p.attribute_bits);
            let best = of.map(|p| p.attribute_bits).fold(f64::NAN, f64::min);
            if authors.is_nan() && best.is_nan() {
                continue;
            }
            let ours = bytes.len() as f64 * 8.0 / cloud.octree.len() as f64;
            let mut row = cells![name, attribute];
            row.extend(cells_of(authors, best, ours));
            table.told(row);
        }
    }
    Ok(table)
}

//! gpcc-lite beside the recorded figures of TMC13, MPEG's test model of G-PCC.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use gpcc_lite::attribute::{self, Quantisation};
use gpcc_lite::coder::{RansDecoder, RansEncoder};
use gpcc_lite::paper::predict::{self, Neighbours};
use gpcc_lite::raht::{RahtPlan, Rows};
use gpcc_lite::{Leaf, Limits, Octree, geometry, morton};
use serde::Deserialize;

use crate::bd;
use crate::page::{Page, Table, signed};

/// Flags of `cargo xtask bench-gpcc`.
#[derive(Clone, Debug, clap::Args)]
pub struct GpccOptions {
    /// Directory of the clouds and `tmc13.jsonl`
    #[arg(long, default_value = "../shared/clouds")]
    clouds: PathBuf,
    /// Where the page goes
    #[arg(long, default_value = "docs/results/gpcc.md")]
    out: PathBuf,
}

/// The clouds; the depth of the octree ends the name.
const CLOUDS: [&str; 6] = ["vic12", "vic15", "jus15", "gsv12", "kac15", "syn15"];
/// Least step of the attribute coder, number of steps, and how many double the step: from finer than TMC13's least
/// quantisation parameter on record to coarser than its greatest, so dense that rates between them are nearly linear.
const LEAST_STEP: f32 = 0.5;
const STEPS: u8 = 36;
const PER_OCTAVE: f32 = 4.0;

/// Measures and writes the page.
///
/// # Errors
/// If a cloud or the record cannot be read, or a stream does not decode to what was coded.
pub fn run(options: &GpccOptions) -> Result<()> {
    let dir = &options.clouds;
    let record = dir.join("tmc13.jsonl");
    let text =
        std::fs::read_to_string(&record).with_context(|| format!("read {}", record.display()))?;
    let peers: Vec<Peer> = text.lines().map(serde_json::from_str).collect::<Result<_, _>>()?;
    let mut page = Page::new(&options.out, "How does the point-cloud coder compare with TMC13?");
    page.text(
        "`cargo xtask bench-gpcc`: gpcc-lite beside TMC13 v23, MPEG's test model of G-PCC. \"Authors\" are the settings of the paper's scripts, \"best\" is the smallest of all recorded.",
    );
    page.text("## Geometry");
    page.table(&of_geometry(dir, &peers)?);
    page.text("## RAHT");
    page.text(
        "Rates against TMC13 with the authors' settings, at its squared error over the 8-bit channels (opacity: 16 bits over 257, as TMC13 codes it), interpolated between our steps. A byte for the step of each channel is counted.",
    );
    page.table(&lossy(dir, &peers)?);
    page.text("## Lossless channels");
    page.table(&lossless(dir, &peers)?);
    page.write()
}

/// A voxelized cloud with one attribute, in Morton order.
struct Cloud {
    octree: Octree,
    /// Three 8-bit channels, or one 16-bit channel.
    channels: Vec<Vec<i32>>,
}

/// Reads the cloud `name` with an attribute; nothing if it is not there.
fn read(dir: &Path, name: &str, attribute: &str) -> Result<Option<Cloud>> {
    let path = dir.join(format!("{name}_{attribute}.ply"));
    if !path.exists() {
        return Ok(None);
    }
    let depth = name.trim_start_matches(char::is_alphabetic).parse()?;
    let data = std::fs::read(&path).with_context(|| format!("read {}", path.display()))?;
    let mark = b"end_header\n";
    let end = data.windows(mark.len()).position(|w| w == mark);
    let end = end.with_context(|| format!("{}: no end_header", path.display()))? + mark.len();
    let is_colour = String::from_utf8_lossy(&data[..end]).contains("uchar red");
    // Three floats, then three bytes or one integer of 16 bits.
    let mut points: Vec<(u64, [i32; 3])> = data[end..]
        .chunks_exact(if is_colour { 15 } else { 14 })
        .map(|row| {
            let axis = |k: usize| f32::from_le_bytes([row[k], row[k + 1], row[k + 2], row[k + 3]]);
            let values = match is_colour {
                true => [row[12], row[13], row[14]].map(i32::from),
                false => [i32::from(u16::from_le_bytes([row[12], row[13]])), 0, 0],
            };
            (morton::encode([0, 4, 8].map(|k| axis(k) as u32)), values)
        })
        .collect();
    points.sort_unstable();
    let channel = |c: usize| points.iter().map(|p| p.1[c]).collect();
    let leaves = points.iter().map(|p| Leaf { morton: p.0, depth }).collect();
    let channels = (0..if is_colour { 3 } else { 1 }).map(channel).collect();
    Ok(Some(Cloud { octree: Octree::of_points(depth, leaves)?, channels }))
}

impl Cloud {
    fn bits_per_point(&self, bytes: usize) -> f64 {
        bytes as f64 * 8.0 / self.octree.len() as f64
    }
}

/// One recorded run of TMC13.
#[derive(Deserialize)]
struct Peer {
    name: String,
    cloud: String,
    #[serde(rename = "attr")]
    attribute: String,
    #[serde(default)]
    geo_bpp: f64,
    #[serde(default)]
    col_bpp: f64,
    #[serde(default)]
    ref_bpp: f64,
    mse_yuv: Option<Vec<f64>>,
    mse: Option<f64>,
}

impl Peer {
    fn is_of(&self, cloud: &str, attribute: &str) -> bool {
        self.cloud == cloud && self.attribute == attribute
    }

    fn attribute_bits(&self) -> f64 {
        self.col_bpp + self.ref_bpp
    }

    /// Sum over channels, in stored 8-bit units (16-bit ones divided by 257).
    fn error(&self) -> f64 {
        match &self.mse_yuv {
            Some(all) => all.iter().sum(),
            None => self.mse.unwrap_or(0.0) / (257.0 * 257.0),
        }
    }
}

/// Our bits per point, and those against TMC13 with the authors' settings and at its best.
fn against(authors: Option<f64>, best: Option<f64>, ours: f64) -> String {
    let percent = |theirs: Option<f64>| signed(theirs.map(|x| (ours / x - 1.0) * 100.0), 2, "");
    format!("{ours:.3} | {} | {}", percent(authors), percent(best))
}

const COLUMNS: &str = "bits per point | against authors, % | against best";

/// Geometry of each cloud.
fn of_geometry(dir: &Path, peers: &[Peer]) -> Result<Table> {
    let mut table = Table::new(format!("cloud | points | {COLUMNS}"));
    for name in CLOUDS {
        let cloud = read(dir, name, "dc")?.with_context(|| format!("no cloud {name}"))?;
        let bytes = geometry::encode(&cloud.octree)?;
        let back = geometry::decode(&bytes, &Limits::for_stream(bytes.len()))?;
        ensure!(back == cloud.octree, "{name}: geometry differs");
        let of = |p: &&Peer| p.cloud == name && p.name.starts_with("g_") && p.geo_bpp > 0.0;
        let mut of = peers.iter().filter(of);
        let best = of.clone().map(|p| p.geo_bpp).reduce(f64::min);
        let authors = of.find(|p| p.name == "g_default").map(|p| p.geo_bpp);
        let row = against(authors, best, cloud.bits_per_point(bytes.len()));
        table.told(format!("{name} | {} | {row}", cloud.octree.len()));
    }
    Ok(table)
}

/// Channels without loss.
fn lossless(dir: &Path, peers: &[Peer]) -> Result<Table> {
    let mut table = Table::new(format!("cloud | attribute | {COLUMNS}"));
    for name in CLOUDS {
        for attribute in ["dc", "rest", "scale", "rot"] {
            let Some(cloud) = read(dir, name, attribute)? else { continue };
            let of = |p: &&Peer| {
                p.is_of(name, attribute) && p.error() == 0.0 && p.attribute_bits() > 0.0
            };
            let mut of = peers.iter().filter(of);
            let Some(best) = of.clone().map(Peer::attribute_bits).reduce(f64::min) else {
                continue;
            };
            let authors = of.find(|p| p.name == "p_auth" || p.name == "p_auth_col");
            let near = Neighbours::new(&cloud.octree);
            let channels: Vec<&[i32]> = cloud.channels.iter().map(Vec::as_slice).collect();
            let bytes = predict::encode_lossless(&near, &channels)?;
            let back = predict::decode_lossless(&near, &bytes, channels.len())?;
            ensure!(back == cloud.channels, "{name} {attribute}: channels differ");
            let ours = cloud.bits_per_point(bytes.len());
            let row = against(authors.map(Peer::attribute_bits), Some(best), ours);
            table.told(format!("{name} | {attribute} | {row}"));
        }
    }
    Ok(table)
}

/// The attribute coder against TMC13's RAHT with the authors' settings.
fn lossy(dir: &Path, peers: &[Peer]) -> Result<Table> {
    let mut table = Table::new("cloud | attribute | mean, % | least | greatest");
    for name in CLOUDS {
        for attribute in ["dc", "opacity", "rest"] {
            let Some(mut cloud) = read(dir, name, attribute)? else { continue };
            let of = |p: &&Peer| p.is_of(name, attribute) && p.name.starts_with("r_auth_q");
            let of: Vec<&Peer> = peers.iter().filter(of).collect();
            if of.is_empty() {
                continue;
            }
            if attribute == "opacity" {
                cloud.channels[0].iter_mut().for_each(|v| *v /= 257);
            }
            let plan = RahtPlan::new(cloud.octree.clone());
            // By rising logarithm of the error.
            let at = |k: u8| {
                let step = LEAST_STEP * (f32::from(k) / PER_OCTAVE).exp2();
                coded(&plan, &cloud, step).map(|(bits, error)| (error.max(1e-9).ln(), bits))
            };
            let ours = (0..STEPS).map(at).collect::<Result<Vec<_>>>()?;
            let percent = |p: &&Peer| {
                let bits = bd::at(ours.clone(), p.error().ln())?;
                Some((bits / p.attribute_bits() - 1.0) * 100.0)
            };
            let all: Vec<f64> = of.iter().filter_map(percent).collect();
            let mean = all.iter().sum::<f64>() / all.len().max(1) as f64;
            let end = |pick: fn(f64, f64) -> f64| all.iter().copied().reduce(pick);
            let figures = [Some(mean), end(f64::min), end(f64::max)];
            let figures = figures.map(|figure| signed(figure, 2, "")).join(" | ");
            table.told(format!("{name} | {attribute} | {figures}"));
        }
    }
    Ok(table)
}

/// Codes and decodes a cloud with the attribute coder: bits per point, and the squared error summed over channels, of
/// values clipped to 8 bits as a consumer would.
fn coded(plan: &RahtPlan, cloud: &Cloud, step: f32) -> Result<(f64, f64)> {
    let channels = cloud.channels.len();
    let steps = vec![step; channels];
    let mut rows = Rows::new(plan.len(), channels);
    for (c, values) in cloud.channels.iter().enumerate() {
        values.iter().enumerate().for_each(|(i, &v)| rows.row_mut(i)[c] = v as f32);
    }
    let mut coder = RansEncoder::default();
    attribute::encode(&mut coder, plan, &Quantisation::new(&steps), &mut rows)?;
    let bytes = coder.finish();
    let mut back = Rows::new(plan.len(), channels);
    let mut decoder = RansDecoder::new(&bytes)?;
    attribute::decode(&mut decoder, plan, &steps, &mut back)?;
    decoder.finish()?;
    ensure!(back == rows, "the decoder's values are not those of the encoder");
    let off = |i: usize, c: usize| {
        let decoded = back.row(i)[c].round().clamp(0.0, 255.0);
        f64::from(cloud.channels[c][i] as f32 - decoded).powi(2)
    };
    let all = (0..plan.len()).flat_map(|i| (0..channels).map(move |c| (i, c)));
    let error: f64 = all.map(|(i, c)| off(i, c)).sum();
    Ok((cloud.bits_per_point(bytes.len() + channels), error / plan.len() as f64))
}

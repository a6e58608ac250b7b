//! gpcc-lite beside TMC13's recorded figures.

mod accuracy;
mod adaptive;
mod cloud;
mod lossy;
mod model;
mod rates;
mod speed;

use std::path::PathBuf;

use anyhow::Result;

/// What [`run`] measures.
#[derive(Clone, Debug)]
pub struct Options {
    /// Directory of the clouds and `tmc13.jsonl`.
    pub clouds: PathBuf,
    /// Only these parts: model, geometry, adaptive, lossless, raht, speed, accuracy (all if none);
    /// a partial run is printed, not written.
    pub only: Vec<String>,
    /// Only these clouds (all if none).
    pub cloud: Vec<String>,
    /// Only these attributes (all if none).
    pub attr: Vec<String>,
    /// Only these quantisation parameters.
    pub qp: Vec<u8>,
    /// Where the page goes, relative to the root of the workspace.
    pub out: PathBuf,
}

const CLOUDS: [&str; 6] = ["vic12", "vic15", "jus15", "gsv12", "kac15", "syn15"];

/// Measures the parts asked for; a whole run writes the page.
///
/// # Errors
/// If a cloud or the record cannot be read, or a stream does not decode to what was coded.
pub fn run(args: &Options) -> Result<()> {
    let pick = |chosen: &[String], all: &[&'static str]| -> Vec<&'static str> {
        let keep = |x: &&&str| chosen.is_empty() || chosen.iter().any(|c| c == **x);
        all.iter().filter(keep).copied().collect()
    };
    let clouds = pick(&args.cloud, &CLOUDS);
    let attrs = pick(&args.attr, &["dc", "opacity", "rest", "scale", "rot"]);
    let lossy: Vec<&str> =
        attrs.iter().copied().filter(|a| ["dc", "opacity", "rest"].contains(a)).collect();
    let lossless: Vec<&str> = attrs.iter().copied().filter(|a| *a != "opacity").collect();
    let qps = if args.qp.is_empty() { vec![4, 16, 28, 34, 40] } else { args.qp.clone() };
    let wants = |part: &str| args.only.is_empty() || args.only.iter().any(|o| o == part);
    let dir = &args.clouds;
    let peers = cloud::peers(&dir.join("tmc13.jsonl"))?;
    let mut report = String::from(INTRODUCTION);
    // Prints all figures; the page has the summary.
    let mut part = |title: &str, [details, summary]: [String; 2]| {
        println!("## {title}\n\n{details}");
        report += &format!("\n## {title}\n\n{summary}");
    };
    let whole = |table: String| [table.clone(), table];
    // First, because peak memory is counted from the start of the process.
    let model = if wants("model") { Some(model::report(dir)?) } else { None };
    if wants("geometry") {
        part("Geometry", whole(rates::geometry_table(dir, &clouds, &peers)?));
    }
    if wants("adaptive") {
        part("Leaves of different depth", whole(adaptive::table(dir)?));
    }
    if wants("raht") {
        part("RAHT", lossy::tables(dir, &clouds, &lossy, &qps, &peers)?);
    }
    if wants("lossless") {
        part("Lossless channels", whole(rates::lossless_table(dir, &clouds, &lossless, &peers)?));
    }
    if wants("speed") {
        part("Time on one thread, syn15 (500 k points, J = 15)", whole(speed::speed_table(dir)?));
    }
    if let Some(text) = model {
        part("A model of 56 coded channels on all cores", whole(text));
    }
    if wants("accuracy") {
        part("Error of RAHT in single precision", accuracy::tables()?);
    }
    let partial = [&args.only, &args.cloud, &args.attr].iter().any(|a| !a.is_empty());
    if !partial && args.qp.is_empty() {
        crate::page::write(&args.out, &report, None)?;
    }
    Ok(())
}

const INTRODUCTION: &str = "# How does the point-cloud coder compare with TMC13?

Written by `cargo xtask bench-gpcc`, which also prints every row. TMC13 v23 is MPEG's test model of
G-PCC, the coder that the paper uses. Its figures are recorded runs (`tmc13.jsonl` beside the clouds).
Ours are whole streams, decoded and compared. Rates are bits per point. \"Authors\" are the settings of
the paper's scripts, \"best\" is the smallest of all recorded option sets.

Lossy rates are compared at the peer's squared error, summed over the stored 8-bit channels after
rounding and clipping to 0..255 (opacity: the 16-bit attribute divided by 257, as the peer codes it).
Our step is searched until the error agrees within 0.2 %; the rest is interpolated. A byte for the step of
each channel is counted. \"RAHT and RLGR\" is the paper's coder: a uniform quantiser of RAHT
coefficients, each channel coded by RLGR.

Times are processor seconds of one thread; of all threads for the model of 56 channels.
";

//! What the stages of a run produce: the contents of `rd.json`.

use serde::{Deserialize, Serialize};

use crate::bd::Point;
use crate::measure::{Metric, Score};
use crate::published::Other;
use crate::round_trip::RoundTrip;

/// The uncompressed model.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct Original {
    /// Gaussians in the file that are valid and used.
    pub(crate) gaussians: usize,
    /// Gaussians left out because they are not finite.
    pub(crate) invalid: usize,
    /// SH degree.
    pub(crate) sh_degree: u8,
    /// Size of the PLY in bytes.
    pub(crate) file_bytes: u64,
    /// Quality at the held-out views.
    pub(crate) score: Score,
    /// Seconds to render and score all views.
    pub(crate) render_seconds: f64,
}

/// One voxelization of the model, before coding.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct VoxelizedRecord {
    /// File-name part; [`Coded::voxels`] refers to it.
    pub(crate) name: String,
    /// Parameters in words.
    pub(crate) what: String,
    /// Greatest depth.
    pub(crate) j_high: u8,
    /// Leaves at each depth from 0.
    pub(crate) depth_histogram: Vec<usize>,
    /// Gaussians kept: one per leaf.
    pub(crate) gaussians: usize,
    /// Quality of the merged model before coding.
    pub(crate) score: Score,
    /// Seconds to voxelize and merge.
    pub(crate) voxelize_seconds: f64,
    /// Seconds to find the importances from the training cameras, once for all voxelizations.
    pub(crate) importance_seconds: f64,
    /// Seconds to render and score all views.
    pub(crate) render_seconds: f64,
    /// The fine-tune, if there was one; the scores are of the tuned model.
    pub(crate) tuned: Option<Tuned>,
}

/// A fine-tune of a voxelized model.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct Tuned {
    /// Steps, one training view each.
    pub(crate) steps: u64,
    /// Whether it began with the merged attributes.
    pub(crate) initialised: bool,
    /// Mean PSNR at the held-out views after so many steps, dB.
    pub(crate) held_out_db: Vec<(u64, f64)>,
    /// Wall-clock seconds of the steps.
    pub(crate) seconds: f64,
    /// User seconds of the steps, all threads; 0 where the system does not tell.
    pub(crate) user_seconds: f64,
    /// Greatest memory of the process meanwhile, bytes; 0 where the system does not tell.
    pub(crate) peak_bytes: u64,
    /// The tuned model, relative to the cache.
    pub(crate) file: String,
}

/// One stream, decoded and scored.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct Coded {
    /// Name of the voxelization.
    pub(crate) voxels: String,
    /// Encoder quality, 0 to 100; for the paper's way of coding, what stands for its QPs.
    pub(crate) quality: f32,
    /// The QPs of the paper's way of coding.
    pub(crate) paper: Option<String>,
    /// Size of the stream.
    pub(crate) bytes: u64,
    /// Bytes by what they are for.
    pub(crate) parts: Vec<(String, u64)>,
    /// Gaussians decoded.
    pub(crate) gaussians: usize,
    /// Quality of the decoded model.
    pub(crate) score: Score,
    /// Seconds to encode.
    pub(crate) encode_seconds: f64,
    /// Seconds to decode.
    pub(crate) decode_seconds: f64,
    /// Seconds to render and score all views.
    pub(crate) render_seconds: f64,
    /// Stream file, relative to the report.
    pub(crate) stream: String,
}

impl Coded {
    /// A round trip of which `stream` is the file. The rest is the caller's to fill in.
    pub(crate) fn of(trip: RoundTrip, stream: String, parts: Vec<(&str, u64)>) -> Self {
        Self {
            voxels: String::new(),
            quality: 0.0,
            paper: None,
            bytes: trip.stream.len() as u64,
            parts: parts.into_iter().map(|(part, bytes)| (part.to_owned(), bytes)).collect(),
            gaussians: trip.decoded.len(),
            score: trip.score,
            encode_seconds: trip.encode_seconds,
            decode_seconds: trip.decode_seconds,
            render_seconds: trip.render_seconds,
            stream,
        }
    }

    /// Its bytes and its score.
    pub(crate) fn rate(&self, metric: Metric) -> Point {
        Point { rate: self.bytes as f64, score: metric.of(&self.score) }
    }

    /// Quality or QPs.
    pub(crate) fn setting(&self) -> String {
        self.paper.clone().unwrap_or_else(|| format!("{:.0}", self.quality))
    }

    /// Bits per decoded Gaussian.
    pub(crate) fn bits_per_gaussian(&self) -> f64 {
        self.bytes as f64 * 8.0 / self.gaussians.max(1) as f64
    }
}

/// All points of one voxelization.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Curve {
    /// Short name.
    pub(crate) name: String,
    /// What it is, in words.
    pub(crate) what: String,
    /// The voxelized models, in the order of their first quality.
    pub(crate) voxelized: Vec<VoxelizedRecord>,
    /// Coded at each quality, ascending.
    pub(crate) points: Vec<Coded>,
}

impl Curve {
    /// The voxelization that a point was coded with.
    pub(crate) fn voxels_of(&self, point: &Coded) -> Option<&VoxelizedRecord> {
        self.voxelized.iter().find(|v| v.name == point.voxels)
    }

    /// Points with rates in bytes.
    pub(crate) fn rates(&self, metric: Metric) -> Vec<Point> {
        self.points.iter().map(|p| p.rate(metric)).collect()
    }
}

/// A comparison of two curves.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Bd {
    /// The curve under test.
    pub(crate) test: String,
    /// What it is compared with.
    pub(crate) anchor: String,
    /// BD-rates by PSNR, SSIM and SSIMULACRA2, by pchip on the hulls, per cent.
    pub(crate) rates: [Option<f64>; 3],
    /// BD-PSNR by pchip on the hulls, dB.
    pub(crate) psnr: Option<f64>,
}

/// A whole run.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Run {
    /// Scene name.
    pub(crate) scene: String,
    /// One line about it.
    pub(crate) what: String,
    /// Cameras in the data set, and how many are held out.
    pub(crate) views: usize,
    /// Held-out views in all.
    pub(crate) held_out: usize,
    /// Held-out views measured here.
    pub(crate) measured: usize,
    /// The uncompressed model.
    pub(crate) original: Original,
    /// Ours.
    pub(crate) curves: Vec<Curve>,
    /// Others: recorded, published, or written here.
    pub(crate) others: Vec<Other>,
    /// Bjontegaard differences.
    pub(crate) bd: Vec<Bd>,
    /// Stages found done, and stages in all.
    pub(crate) skipped: usize,
    /// See [`Run::skipped`].
    pub(crate) stages: usize,
    /// Where all this came from.
    pub(crate) manifest: Vec<(&'static str, String)>,
}

//! What is measured: files, and curves of files. `rd.json` holds these.

use serde::{Deserialize, Serialize};

use crate::bd::Point;
use crate::measure::{Metric, Score};
use crate::process::Usage;

/// One file of a scene: a stream, a model, a point that others published.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub(crate) struct Record {
    /// What distinguishes it on its curve: a quality, QPs, settings of another codec.
    pub(crate) setting: String,
    /// Encoder quality, 0 to 100; for the paper's way of coding, what stands for its QPs.
    pub(crate) quality: f32,
    /// Size of the file.
    pub(crate) bytes: u64,
    /// Bytes by what they are for.
    pub(crate) parts: Vec<(String, u64)>,
    /// Gaussians decoded.
    pub(crate) gaussians: usize,
    /// Quality of the decoded model.
    pub(crate) score: Score,
    /// What encoding needed; the seconds alone where it is not a process of its own.
    pub(crate) encode: Usage,
    /// Seconds to decode.
    pub(crate) decode_seconds: f64,
    /// Name of the voxelization.
    pub(crate) voxels: String,
    /// The file, relative to the report.
    pub(crate) stream: String,
    /// PSNR against renders of the model, at views off the path of the cameras, dB; of streams of the command.
    pub(crate) elsewhere_db: Option<f64>,
}

impl Record {
    /// Its bytes and its score.
    pub(crate) fn rate(&self, metric: Metric) -> Point {
        Point { rate: self.bytes as f64, score: metric.of(&self.score) }
    }

    /// Decimal megabytes with three digits after the point.
    pub(crate) fn megabytes(&self) -> String {
        format!("{:.3}", self.bytes as f64 / 1e6)
    }

    /// Decimal megabits.
    pub(crate) fn megabits(&self) -> String {
        format!("{:.3}", self.bytes as f64 * 8.0 / 1e6)
    }

    /// Bits per decoded Gaussian.
    pub(crate) fn bits_per_gaussian(&self) -> f64 {
        self.bytes as f64 * 8.0 / self.gaussians.max(1) as f64
    }
}

/// One voxelization of the model, before coding.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct VoxelizedRecord {
    /// File-name part; [`Record::voxels`] refers to it.
    pub(crate) name: String,
    /// Parameters in words.
    pub(crate) what: String,
    /// Leaves at each depth from 0.
    pub(crate) depth_histogram: Vec<usize>,
    /// Gaussians kept: one per leaf.
    pub(crate) gaussians: usize,
    /// Quality of the merged model, fine-tuned if it is to be, before coding.
    pub(crate) score: Score,
    /// Seconds to voxelize and merge.
    pub(crate) voxelize_seconds: f64,
    /// Seconds to find the importances from the training cameras, once for all voxelizations.
    pub(crate) importance_seconds: f64,
}

/// Points of one codec on one scene.
#[derive(Clone, Debug, Default, Serialize)]
pub(crate) struct Curve {
    /// Short name.
    pub(crate) name: String,
    /// What it is, in words; of another codec, where the points come from.
    pub(crate) what: String,
    /// The voxelized models, in the order of their first quality.
    pub(crate) voxelized: Vec<VoxelizedRecord>,
    /// Coded at each quality, ascending.
    pub(crate) points: Vec<Record>,
}

impl Curve {
    /// Whether the points are of another model of the same photos.
    pub(crate) fn is_published(&self) -> bool {
        self.what.starts_with("published")
    }

    /// Whether a BD-rate against it means something: it was measured on this very model, at three rates or more.
    pub(crate) fn is_comparable(&self) -> bool {
        self.points.len() >= 3 && !self.is_published()
    }

    /// The points of which the score is known, with rates in bytes.
    pub(crate) fn rates(&self, metric: Metric) -> Vec<Point> {
        rates(&self.points, metric)
    }
}

/// The points of which the score is known, with rates in bytes.
pub(crate) fn rates(points: &[Record], metric: Metric) -> Vec<Point> {
    points.iter().map(|p| p.rate(metric)).filter(|p| !p.score.is_nan()).collect()
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

/// All that a report tells of a scene.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Run {
    /// Scene name.
    pub(crate) scene: String,
    /// One line about it.
    pub(crate) what: String,
    /// Cameras in the data set.
    pub(crate) views: usize,
    /// Held-out views in all.
    pub(crate) held_out: usize,
    /// Held-out views measured here.
    pub(crate) measured: usize,
    /// The uncompressed model.
    pub(crate) original: Record,
    /// Its SH degree.
    pub(crate) sh_degree: u8,
    /// Gaussians of its file that are not finite and were left out.
    pub(crate) invalid: usize,
    /// Ours.
    pub(crate) curves: Vec<Curve>,
    /// Others: recorded, published, or written here.
    pub(crate) others: Vec<Curve>,
    /// Bjontegaard differences.
    pub(crate) bd: Vec<Bd>,
    /// Stages found done, and stages in all.
    pub(crate) stages: [usize; 2],
    /// Where all this came from.
    pub(crate) manifest: Vec<(&'static str, String)>,
}

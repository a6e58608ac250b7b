//! Codebooks against the rendered image: `cargo run --release -p vq --example rendered -- SCENE`,
//! where SCENE is a dataset folder with a model. Prints, for several metrics, sensitivities, sizes
//! and prices, the bits per Gaussian (table, coded indices, and the order-0 entropy of log(gamma)
//! in steps of 0.08, or of its differences along the Morton order if less) and the PSNR of three
//! held-out views against the render of the uncoded model. Everything but the covariances is left
//! as it is.

use finetune::{Image, RenderOptions, metrics::psnr, render};
use gs_model::{Camera, Scene, dataset::Dataset};
use vq::{Codebook, Covariance, Metric, Options, default_sensitivity};

const GAMMA_STEP: f32 = 0.08;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let folder = std::env::args().nth(1).ok_or("usage: rendered SCENE_FOLDER")?;
    let data = Dataset::open(&folder)?;
    let path = std::path::Path::new(&folder).join("point_cloud.ply");
    let scene = in_morton_order(&gs_model::ply::read(path)?.0);
    let cameras: Vec<Camera> = data.held_out().take(3).map(|v| v.camera.clone()).collect();
    let training: Vec<Camera> = data.training().step_by(4).map(|v| v.camera.clone()).collect();
    let lab = Lab::new(scene, cameras)?;

    let by_area: Vec<f32> = (0..lab.scene.len())
        .map(|i| {
            let opacity = 1.0 / (1.0 + libm::expf(-lab.scene.opacity_logits[i]));
            default_sensitivity(opacity, lab.scene.log_scales[i])
        })
        .collect();
    let squared: Vec<f32> = by_area.iter().map(|s| s * s).collect();
    let views: Vec<f32> =
        finetune::saliency(&lab.scene, &training).iter().map(|s| s + 0.01).collect();
    let ones = vec![1.0; lab.scene.len()];
    for (name, sensitivities) in [
        ("default", &by_area),
        ("opacity x area", &squared),
        ("blending weight", &views),
        ("equal", &ones),
    ] {
        for metric in [Metric::Covariance, Metric::SquareRoot] {
            for (codewords, price) in [(1024, 0.0), (4096, 0.0), (4096, 4e-3)] {
                lab.run(name, sensitivities, metric, codewords, price)?;
            }
        }
    }
    Ok(())
}

struct Lab {
    scene: Scene,
    cameras: Vec<Camera>,
    renders: Vec<Image>,
    covariances: Vec<Covariance>,
    log_gammas: Vec<i32>,
}

impl Lab {
    fn new(scene: Scene, cameras: Vec<Camera>) -> Result<Self, vq::Error> {
        let split: Vec<(Covariance, f32)> = (0..scene.len())
            .map(|i| Covariance::split(scene.rotations[i], scene.log_scales[i]))
            .collect::<Result<_, _>>()?;
        let renders =
            cameras.iter().map(|c| render(&scene, c, &RenderOptions::default())).collect();
        let log_gammas = split.iter().map(|s| (s.1 / GAMMA_STEP).round() as i32).collect();
        let covariances = split.into_iter().map(|s| s.0).collect();
        Ok(Self { scene, cameras, renders, covariances, log_gammas })
    }

    fn run(
        &self,
        name: &str,
        sensitivities: &[f32],
        metric: Metric,
        codewords: usize,
        price: f64,
    ) -> Result<(), vq::Error> {
        let n = self.scene.len();
        let mean = sensitivities.iter().map(|&s| f64::from(s)).sum::<f64>() / n as f64;
        let mut options = Options::with_codewords(codewords);
        options.metric = metric;
        options.lambda = price * mean;
        let codebook = Codebook::train(&self.covariances, sensitivities, &options)?;
        let indices =
            codebook.assign_priced(&self.covariances, sensitivities, options.lambda, 3)?;
        let coded = vq::index::encode(&indices, codebook.len())?.len() + codebook.to_bytes().len();
        let bits = coded as f64 * 8.0 / n as f64 + self.gamma_bits();

        let mut decoded = self.scene.clone();
        for i in 0..n {
            let (quaternion, log_scales) = codebook.decode(indices[i])?;
            decoded.rotations[i] = quaternion;
            decoded.log_scales[i] = log_scales.map(|l| l + self.log_gammas[i] as f32 * GAMMA_STEP);
        }
        let total: f64 = self
            .cameras
            .iter()
            .zip(&self.renders)
            .map(|(c, reference)| psnr(&render(&decoded, c, &RenderOptions::default()), reference))
            .sum();
        println!(
            "{name:16} {metric:?} K {codewords} price {price}: {} codewords, {bits:.2} b/Gaussian, {:.2} dB",
            codebook.len(),
            total / self.cameras.len() as f64
        );
        Ok(())
    }

    fn gamma_bits(&self) -> f64 {
        let differences: Vec<i32> = self.log_gammas.windows(2).map(|w| w[1] - w[0]).collect();
        entropy(self.log_gammas.clone()).min(entropy(differences))
    }
}

/// Order-0 entropy in bits per value.
fn entropy(mut values: Vec<i32>) -> f64 {
    values.sort_unstable();
    let n = values.len() as f64;
    values.chunk_by(|a, b| a == b).map(|c| c.len() as f64 / n).map(|p| -p * libm::log2(p)).sum()
}

fn in_morton_order(scene: &Scene) -> Scene {
    let mut low = [f32::INFINITY; 3];
    let mut high = [f32::NEG_INFINITY; 3];
    for m in &scene.means {
        low = [0, 1, 2].map(|k| low[k].min(m[k]));
        high = [0, 1, 2].map(|k| high[k].max(m[k]));
    }
    let side = (0..3).map(|k| high[k] - low[k]).fold(f32::MIN_POSITIVE, f32::max);
    let key = |m: [f32; 3]| {
        let cell = [0, 1, 2].map(|k| ((m[k] - low[k]) / side * 65535.0) as u64);
        let bit = |b: u64| cell.iter().fold(0, |key, c| key << 1 | (c >> b) & 1);
        (0..16).rev().fold(0u64, |key, b| key << 3 | bit(b))
    };
    let mut order: Vec<usize> = (0..scene.len()).collect();
    order.sort_by_key(|&i| key(scene.means[i]));
    scene.select(&order)
}

//! Tile tests, early-stop thresholds and colours in half precision, each with its time and its
//! image error.

use anyhow::{Context as _, Result};
use finetune::probe::{TileTest, Variant, VariantPass};
use finetune::{Image, TrainView, metrics};
use gs_model::Scene;

use crate::usage::cpu_seconds;

#[path = "../../../../finetune/tests/common/oracle.rs"]
#[allow(
    dead_code,
    unreachable_pub,
    missing_docs,
    clippy::disallowed_methods,
    reason = "shared with the tests of finetune: a part is used, in f64, far from any bitstream"
)]
mod oracle;

/// Views that are timed and compared, evenly spread.
const VIEWS: usize = 4;
/// The f64 oracle visits every Gaussian at every pixel: its view is reduced to this width.
const ORACLE_WIDTH: u32 = 40;

struct Row {
    name: String,
    /// Processor milliseconds a view on one thread, least of the repetitions.
    forward: f64,
    step: f64,
    slots: usize,
    /// Against the default variant: largest difference and PSNR, dB.
    worst: f64,
    psnr: f64,
    /// Against the f64 oracle, reduced view: largest difference and PSNR.
    oracle_worst: f64,
    oracle_psnr: f64,
}

fn variants() -> Vec<(String, Variant)> {
    let d = Variant::default();
    let mut list = vec![
        ("default: ellipse, stop 1e-4, f32".into(), d),
        ("bounding rectangle".into(), Variant { tile_test: TileTest::Rectangle, ..d }),
        ("bounding square".into(), Variant { tile_test: TileTest::Square, ..d }),
    ];
    for t_stop in [0.0, 1e-5, 1e-3, 1.0 / 255.0, 1e-2, 3e-2] {
        list.push((format!("stop {t_stop:.0e}"), Variant { t_stop, ..d }));
    }
    list.push(("f16 colour".into(), Variant { half_colour: true, ..d }));
    list
}

/// Least processor milliseconds of `work`, in batches long enough for the clock's ticks of 10 ms.
fn least(mut work: impl FnMut()) -> f64 {
    work();
    (0..4)
        .map(|_| {
            let (start, mut n) = (cpu_seconds(), 0);
            while cpu_seconds() - start < 0.25 {
                work();
                n += 1;
                // The clock may not advance on this system.
                if n > 1000 {
                    break;
                }
            }
            1e3 * (cpu_seconds() - start) / f64::from(n)
        })
        .fold(f64::MAX, f64::min)
}

fn difference(a: &Image, b: impl Iterator<Item = f64>) -> (f64, f64) {
    let (mut worst, mut sum) = (0.0f64, 0.0);
    for (a, b) in a.rgb.iter().zip(b) {
        let d = (f64::from(*a) - b).abs();
        worst = worst.max(d);
        sum += d * d;
    }
    (worst, -10.0 * libm::log10((sum / a.rgb.len() as f64).max(1e-30)))
}

fn measure(scene: &Scene, train: &[TrainView]) -> Result<()> {
    let step = train.len().div_ceil(VIEWS).max(1);
    let views: Vec<&TrainView> = train.iter().step_by(step).collect();
    let small = small_view(views.first().context("no training views")?)?;
    let exact = oracle::render(&oracle::Parameters::of(scene), &small.camera, [0.0; 3], None).rgb;
    let mut originals: Vec<Image> = Vec::new();
    for (name, variant) in variants() {
        let mut row = Row {
            name,
            forward: 0.0,
            step: 0.0,
            slots: 0,
            worst: 0.0,
            psnr: f64::MAX,
            oracle_worst: 0.0,
            oracle_psnr: 0.0,
        };
        for (k, view) in views.iter().enumerate() {
            let mut pass = VariantPass::new(&view.camera, &view.photo, variant);
            row.forward += least(|| pass.forward(scene)) / views.len() as f64;
            row.step += least(|| pass.step(scene)) / views.len() as f64;
            row.slots += pass.slots() / views.len();
            let image = pass.image();
            if originals.len() == k {
                originals.push(image.clone());
            }
            let (worst, _) = difference(&image, originals[k].rgb.iter().map(|&v| f64::from(v)));
            row.worst = row.worst.max(worst);
            row.psnr = row.psnr.min(metrics::psnr(&image, &originals[k]));
        }
        let mut pass = VariantPass::new(&small.camera, &small.photo, variant);
        pass.forward(scene);
        (row.oracle_worst, row.oracle_psnr) = difference(&pass.image(), exact.iter().copied());
        println!("{}", line(&row));
    }
    Ok(())
}

fn small_view(view: &TrainView) -> Result<TrainView> {
    let c = &view.camera;
    let height = (c.height * ORACLE_WIDTH).div_ceil(c.width.max(1));
    let camera = c.scaled_to(ORACLE_WIDTH, height).context("cannot reduce the view")?;
    Ok(TrainView { photo: Image::new(camera.width, camera.height), camera })
}

fn line(r: &Row) -> String {
    let db = |v: f64| if v > 200.0 { "equal".to_owned() } else { format!("{v:.1} dB") };
    format!(
        "| {} | {:.1} | {:.1} | {} | {:.1e} | {} | {:.1e} | {:.1} dB |",
        r.name,
        r.forward,
        r.step,
        r.slots,
        r.worst,
        db(r.psnr),
        r.oracle_worst,
        r.oracle_psnr
    )
}

/// Measures and prints the variants.
pub(super) fn run(scene: &Scene, train: &[TrainView]) -> Result<()> {
    println!(
        "| variant | forward ms | project .. gather ms | slots | largest difference from the default | \
         PSNR to it | largest difference from the oracle | PSNR to it |\n|---|---|---|---|---|---|---|---|"
    );
    let one = rayon::ThreadPoolBuilder::new().num_threads(1).build()?;
    one.install(|| measure(scene, train))
}

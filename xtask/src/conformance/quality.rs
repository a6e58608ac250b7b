//! A greater quality does not look worse.

use anyhow::{Result, ensure};
use eval::scenes::{self, TestScene};
use finetune::TrainView;
use gs_model::Scene;
use gsvx::EncodeOptions;

use super::{Tally, Verdict};

/// Held-out views that are rendered.
const VIEWS: usize = 4;
/// The largest drop of the mean PSNR that is allowed, dB.
const ALLOWED_DB: f64 = 0.3;

pub(super) fn checks(tally: &mut Tally) {
    tally.check("a greater quality looks no worse", sweep);
}

/// The room with cameras, at qualities from 5 to 100 in steps of 1, against renders of the input.
///
/// Where Gaussians lie at equal depth, as on a wall that faces the camera, the least change of a mean decides which is
/// in front. The input in reverse order shows how much that alone changes. An error below that says nothing about
/// quality, so no PSNR above it counts.
fn sweep() -> Result<Verdict> {
    let TestScene { model, training, held_out, .. } = TestScene::open(scenes::DEFAULT, VIEWS)?;
    let views: Vec<TrainView> =
        held_out.into_iter().map(|v| TrainView::rendered(&model, v.camera)).collect();
    let reversed = model.select(&(0..model.len()).rev().collect::<Vec<_>>());
    let order: Vec<f64> = views.iter().map(|v| v.psnr(&reversed)).collect();
    let mean = |scene: &Scene| {
        let all = views.iter().zip(&order).map(|(v, most)| v.psnr(scene).min(*most));
        all.sum::<f64>() / views.len() as f64
    };
    let seen = finetune::Visibility::of_all(&model, &training).squared;
    let (mut best, mut worst) = ((0, f64::NEG_INFINITY), (0, 0, 0.0));
    for quality in 5..=100u8 {
        let stream = gsvx::encode(&model, Some(&seen), quality.into(), &EncodeOptions::default())?;
        let db = mean(&stream.decode()?);
        if db > best.1 {
            best = (quality, db);
        } else if best.1 - db > worst.2 {
            worst = (best.0, quality, best.1 - db);
        }
    }
    let (from, to, db) = worst;
    ensure!(db <= ALLOWED_DB, "quality {to} lies {db:.2} dB below {from}; {ALLOWED_DB} is allowed");
    Ok(Verdict::Holds(format!("at most {db:.2} dB of PSNR are lost to a greater quality")))
}

//! Figure 3 of the paper for any scene: how dense its Gaussians are, and how large.

use std::fs;
use std::path::Path;

use anyhow::{Context, Result};
use gs_model::{ReadOptions, Scene, model};
use image::{GrayImage, Luma};

use crate::scenes;

/// Side of a panel, pixels.
const SIDE: usize = 400;
/// A panel shows what lies between these shares of the means along each axis.
const MIDDLE: [f64; 2] = [0.02, 0.98];

/// Writes `SCENE.png` for each scene into a folder.
pub(super) fn draw(names: &[String], folder: &Path) -> Result<()> {
    fs::create_dir_all(folder).with_context(|| format!("create {}", folder.display()))?;
    for name in names {
        let files = scenes::find(name)?;
        let (scene, _) = model::read(&files.dataset.model_path, &ReadOptions::default())?;
        let path = folder.join(format!("{}.png", files.name));
        picture(&scene).save(&path).with_context(|| format!("write {}", path.display()))?;
        println!(
            "{}: left Gaussians per pixel, right the greatest volume, both logarithmic",
            path.display()
        );
    }
    Ok(())
}

/// Two panels, seen along the shortest axis: the logarithms of the number of Gaussians and of their greatest volume.
fn picture(scene: &Scene) -> GrayImage {
    let ends: [[f64; 2]; 3] = [0, 1, 2].map(|k| {
        let mut along: Vec<f64> = scene.means.iter().map(|mean| f64::from(mean[k])).collect();
        along.sort_by(f64::total_cmp);
        MIDDLE.map(|share| *along.get((share * along.len() as f64) as usize).unwrap_or(&0.0))
    });
    let width = |k: usize| ends[k][1] - ends[k][0];
    let mut axes = [0, 1, 2];
    axes.sort_by(|&a, &b| width(b).total_cmp(&width(a)));
    // One scale for both axes: the longer one fills the panel.
    let scale = SIDE as f64 / width(axes[0]).max(f64::MIN_POSITIVE);
    let pixel = |mean: [f32; 3], k: usize| {
        let centre = 0.5 * (ends[k][0] + ends[k][1]);
        let at = scale * (f64::from(mean[k]) - centre) + 0.5 * SIDE as f64;
        (0.0..SIDE as f64).contains(&at).then_some(at as usize)
    };
    let mut counts = vec![0.0f64; SIDE * SIDE];
    let mut volumes = vec![f64::NEG_INFINITY; SIDE * SIDE];
    for (&mean, log_scales) in scene.means.iter().zip(&scene.log_scales) {
        if let (Some(x), Some(y)) = (pixel(mean, axes[0]), pixel(mean, axes[1])) {
            let log_volume: f64 = log_scales.iter().map(|&l| f64::from(l)).sum();
            counts[y * SIDE + x] += 1.0;
            volumes[y * SIDE + x] = volumes[y * SIDE + x].max(log_volume);
        }
    }
    let panels = [counts.into_iter().map(f64::ln).collect(), volumes].map(grey);
    let side = SIDE as u32;
    GrayImage::from_fn(2 * side, side, |x, y| {
        Luma([panels[(x / side) as usize][(y * side + x % side) as usize]])
    })
}

/// Finite values from dark grey to white; what is not finite is black.
fn grey(values: Vec<f64>) -> Vec<u8> {
    let finite = || values.iter().copied().filter(|v| v.is_finite());
    let (low, high) = (finite().fold(f64::MAX, f64::min), finite().fold(f64::MIN, f64::max));
    let share = |v: f64| if high > low { (v - low) / (high - low) } else { 1.0 };
    let level = |&v: &f64| if v.is_finite() { 55 + (200.0 * share(v)) as u8 } else { 0 };
    values.iter().map(level).collect()
}

#[cfg(test)]
mod tests {
    use testing::{Rng, clustered};

    use super::*;

    #[test]
    fn the_left_panel_is_brightest_where_most_are_and_the_right_where_the_largest_is() {
        let mut scene = clustered(2000, &mut Rng::seeded(1));
        let brightest = |picture: &GrayImage, panel: u32| -> Vec<(u32, u32)> {
            let here =
                |&(x, _, p): &(u32, u32, &Luma<u8>)| x / SIDE as u32 == panel && p.0 == [255];
            picture.enumerate_pixels().filter(here).map(|(x, y, _)| (x % SIDE as u32, y)).collect()
        };
        scene.means[..300].fill([0.25; 3]);
        scene.means[1500] = [-0.25; 3];
        scene.log_scales[1500] = [5.0; 3];
        let picture = picture(&scene);
        let ([most], [largest]) = (&*brightest(&picture, 0), &*brightest(&picture, 1)) else {
            panic!("one place each");
        };
        assert!(most.0 > 200 && most.1 > 200, "{most:?}");
        assert!(largest.0 < 200 && largest.1 < 200, "{largest:?}");
        assert!(picture.pixels().any(|p| p.0 == [0]));
    }
}

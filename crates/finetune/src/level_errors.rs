//! [`level_errors`]: how much coarser versions of a part of a scene differ from it in pictures.
//!
//! Viewers that choose levels of detail by error need it. Pictures show the part alone on a transparent ground, small,
//! from six directions, as splat-transform's do.

use crate::forward::Forward;
use crate::options::RenderOptions;
use crate::stages::TILE;
use crate::stages::blend::TilePixels;
use crate::stages::project::RenderView;
use glam::DVec3;
use gs_model::{Camera, Scene, math};
use rayon::prelude::*;

/// Edges of a picture, in pixels: the least and the greatest.
const EDGES: [f64; 2] = [64.0, 256.0];
/// Pixels of a picture for each standard deviation of a small Gaussian of the finest version.
const PIXELS: f64 = 2.0;
/// Distance of the cameras, in radii of the part: they hardly see perspective.
const DISTANCE: f64 = 200.0;
/// The least distance, in units of the scene: nothing nearer than 0.2 is drawn.
const NEAREST: f64 = 10.0;
/// Room around the part.
const MARGIN: f64 = 1.05;
/// The rotation of the axes that are the directions: in none of them is an SH basis function of degrees 1 to 3 zero.
const TURNED: [f32; 4] = [0.82, 0.41, 0.13, 0.38];

/// The squared difference of each version's pictures from those of the first, relative to the squares of the first.
/// Versions go from fine to coarse; no error is smaller than that of a finer version. Of an empty first version the
/// error of any other is 1. `bounds` are the corners of a box around all of them.
///
/// ```
/// use gs_model::Scene;
///
/// let fine = Scene {
///     means: vec![[0.0; 3], [1.0, 0.0, 0.0]],
///     rotations: vec![[1.0, 0.0, 0.0, 0.0]; 2],
///     log_scales: vec![[-2.0; 3]; 2],
///     opacity_logits: vec![3.0; 2],
///     sh: vec![[1.0; 3]; 2],
///     ..Scene::default()
/// };
/// let errors = finetune::level_errors(&[fine.clone(), fine.clone(), fine.select(&[0])], fine.extent());
/// assert_eq!(errors[..2], [0.0, 0.0]);
/// assert!((0.4..0.6).contains(&errors[2]));
/// ```
#[must_use]
pub fn level_errors(versions: &[Scene], bounds: [[f32; 3]; 2]) -> Vec<f64> {
    let Some(finest) = versions.first() else { return Vec::new() };
    let views = views(bounds.map(|corner| DVec3::from(corner.map(f64::from))), finest);
    let of_view = |view: &RenderView| {
        let mut first = Forward::default();
        first.run(finest, view);
        let energy = squares(&first.tiles, &[]);
        let mut other = Forward::default();
        let difference = |version: &Scene| {
            other.run(version, view);
            squares(&first.tiles, &other.tiles)
        };
        (energy, versions[1..].iter().map(difference).collect::<Vec<f64>>())
    };
    let seen: Vec<(f64, Vec<f64>)> = views.par_iter().map(of_view).collect();
    let energy: f64 = seen.iter().map(|(energy, _)| energy).sum();
    let mut errors = vec![0.0];
    for i in 0..versions.len() - 1 {
        let difference: f64 = seen.iter().map(|(_, differences)| differences[i]).sum();
        let error = if energy > 0.0 { difference / energy } else { f64::from(difference > 0.0) };
        errors.push(error.max(errors[i]));
    }
    errors
}

/// The six views of a part of a scene.
fn views([low, high]: [DVec3; 2], finest: &Scene) -> Vec<RenderView> {
    let (middle, radius) = (low.midpoint(high), 0.5 * low.distance(high));
    let edge = edge(2.0 * radius, finest);
    let distance = (DISTANCE * radius).max(NEAREST);
    let focal = 0.5 * f64::from(edge) * distance / (MARGIN * radius);
    let axes = math::rotation(TURNED);
    let axis = |k: usize| DVec3::from_array([0, 1, 2].map(|row: usize| axes[row][k]));
    let view = |i: usize| {
        let side = if i.is_multiple_of(2) { distance } else { -distance };
        let (eye, up) = (middle + side * axis(i / 2), axis((i / 2 + 1) % 3));
        let camera = Camera::looking_at(
            String::new(),
            eye.to_array(),
            middle.to_array(),
            up.to_array(),
            [edge; 2],
            focal,
        );
        RenderView::new(&camera, &RenderOptions::default())
    };
    (0..6).map(view).collect()
}

/// The edge of pictures of a part of this size, a whole number of tiles.
fn edge(size: f64, finest: &Scene) -> u32 {
    let small = finest.small_log_scale().map_or(0.0, f64::from);
    let wanted = PIXELS * size / libm::exp(small);
    (wanted.clamp(EDGES[0], EDGES[1]) as u32).next_multiple_of(TILE)
}

/// The sum of squared differences of two pictures, colours and opacities; the second may be empty.
fn squares(one: &[TilePixels], other: &[TilePixels]) -> f64 {
    let none = &TilePixels::CLEAR;
    let others = other.iter().chain(std::iter::repeat(none));
    one.iter().zip(others).map(|(a, b)| f64::from(of_tile(a, b))).sum()
}

fn of_tile(a: &TilePixels, b: &TilePixels) -> f32 {
    let (colour, square) = (|v: f32| v.clamp(0.0, 1.0), |v: f32| v * v);
    let channels = [(&a.red, &b.red), (&a.green, &b.green), (&a.blue, &b.blue)];
    let colours =
        channels.into_iter().flat_map(|(a, b)| a.as_flattened().iter().zip(b.as_flattened()));
    let colours: f32 = colours.map(|(&a, &b)| square(colour(a) - colour(b))).sum();
    // Negative where blending stopped early.
    let through = a.t.as_flattened().iter().zip(b.t.as_flattened());
    colours + through.map(|(a, b)| square(a.abs() - b.abs())).sum::<f32>()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn gaussians(n: u16) -> Scene {
        let at = |i: u16| [f32::from(i % 4), f32::from(i / 4 % 4), f32::from(i / 16)];
        Scene {
            means: (0..n).map(at).collect(),
            rotations: vec![[1.0, 0.2, 0.0, 0.4]; n.into()],
            log_scales: vec![[-1.0, -2.0, -1.5]; n.into()],
            opacity_logits: vec![1.0; n.into()],
            sh_degree: 1,
            sh: vec![[0.4, 0.1, 0.0]; 4 * usize::from(n)],
            ..Scene::default()
        }
    }

    fn errors(versions: &[Scene]) -> Vec<f64> {
        level_errors(versions, versions[0].extent())
    }

    #[test]
    fn errors_grow_with_what_is_missing_and_do_not_depend_on_units() {
        let whole = gaussians(64);
        let without = |step: usize| whole.select(&(0..64).step_by(step).collect::<Vec<_>>());
        let versions = [whole.clone(), without(2), without(4), whole.clone(), Scene::default()];
        let found = errors(&versions);
        assert!(found[0] == 0.0 && found[1] > 0.1 && found[2] > 1.2 * found[1], "{found:?}");
        // As good as the first, but not told to be better than a finer one; and nothing at all.
        assert!(found[3] == found[2] && (found[4] - 1.0).abs() < 1e-6, "{found:?}");
        let small = versions.map(|mut scene| {
            scene.means.iter_mut().for_each(|mean| *mean = mean.map(|v| 0.001 * v));
            scene.log_scales.iter_mut().for_each(|s| *s = s.map(|v| v + libm::logf(0.001)));
            scene
        });
        for (a, b) in found.iter().zip(errors(&small)) {
            assert!((a - b).abs() < 0.01, "{a} {b}");
        }
    }

    #[test]
    fn colours_that_only_some_directions_show_count() {
        let whole = gaussians(8);
        for k in 1..4 {
            let mut other = whole.clone();
            (0..8).for_each(|i| other.sh[4 * i + k] = [-0.4; 3]);
            assert!(errors(&[whole.clone(), other])[1] > 0.01, "{k}");
        }
    }

    #[test]
    fn what_shows_nothing_has_a_defined_error() {
        let (one, none) = (gaussians(1), Scene::default());
        assert_eq!(level_errors(&[], [[0.0; 3]; 2]), [0.0; 0]);
        assert_eq!(errors(std::slice::from_ref(&one)), [0.0]);
        assert_eq!(level_errors(&[none.clone(), none.clone()], one.extent()), [0.0, 0.0]);
        assert_eq!(level_errors(&[none, one.clone()], one.extent()), [0.0, 1.0]);
    }
}

//! What Gaussians are like in frames that do not have them.
//!
//! They move on as they do where they are there, by curves that all Gaussians share: then few curves tell how all move
//! (expectation maximisation of probabilistic principal components with missing values). One that moves evenly while it
//! is there does so throughout.

use super::curves::curves_of;
use crate::chunk::{Attribute, Group, MOVING};
use crate::sequence::motion::put;
use gpcc_lite::raht::Rows;
use gs_model::{Scene, SceneMut};
use std::collections::BTreeMap;

const ROUNDS: usize = 6;
/// Most curves, and the least share of the energy that one has.
const MOST: usize = 16;
const SHARE: f64 = 1e-4;
/// Least share of the energy that no curve tells.
const LEAST_REST: f64 = 1e-7;

/// Moves on what is not there. `alive` says of each Gaussian whether it is there, frame by frame. Opacities stay: they have
/// an end, and curves do not.
pub(super) fn move_on(frames: &mut [Scene], alive: &[bool]) {
    let sh_degree = frames[0].sh_degree;
    let groups = MOVING.iter().filter(|group| match group.attribute {
        Attribute::Opacity => false,
        Attribute::Colour { degree } => degree <= sh_degree,
        _ => true,
    });
    for group in groups {
        let (mut values, mut there, mut rows) = (Vec::new(), Vec::new(), Vec::new());
        let mut own = vec![0.0; group.channels];
        for (i, alive) in alive.chunks_exact(frames.len()).enumerate() {
            let start = values.len();
            for frame in &*frames {
                group.values(frame, i, &mut own);
                values.extend_from_slice(&own);
            }
            let mut each = values[start..].chunks_exact(group.channels);
            let first = each.next();
            if each.any(|other| Some(other) != first) {
                rows.push(i);
                there.push(alive);
            } else {
                values.truncate(start);
            }
        }
        if there.iter().any(|there| there.contains(&false)) {
            for _ in 0..ROUNDS {
                round(&mut values, &there, group.channels);
            }
            write(group, &values, &rows, &there, frames);
        }
    }
}

/// Replaces the values of what is not there by those that curves of all values tell.
fn round(values: &mut [f32], there: &[&[bool]], channels: usize) {
    let (leaves, frames) = (there.len(), there[0].len());
    let mut deltas = values.to_vec();
    for leaf in deltas.chunks_exact_mut(frames * channels) {
        let mut mean = vec![0.0; channels];
        leaf.chunks_exact(channels).for_each(|row| add(&mut mean, row, 1.0 / frames as f32));
        leaf.chunks_exact_mut(channels).for_each(|row| add(row, &mean, -1.0));
    }
    let energy = |values: &[f32]| values.iter().map(|&v| f64::from(v * v)).sum::<f64>();
    let all = energy(&deltas);
    let least = SHARE * all / frames as f64;
    let mut curves = curves_of(&deltas, &vec![1.0; leaves], frames, channels, least);
    curves.truncate(MOST);
    let mut energies = vec![0.0; curves.len()];
    let mut coefficients = vec![0.0; channels];
    for (curve, sum) in curves.iter().zip(&mut energies) {
        for leaf in deltas.chunks_exact(frames * channels) {
            curve.project(leaf, &mut coefficients);
            *sum += energy(&coefficients);
        }
    }
    let told = frames as f64 * energies.iter().sum::<f64>();
    let rest = (all - told).max(LEAST_REST * all) / frames as f64;
    // A mean, of which nothing is known, and the curves.
    let basis: Vec<Vec<f64>> = std::iter::once(vec![1.0; frames])
        .chain(curves.iter().map(|curve| (0..frames).map(|t| curve.at(t).into()).collect()))
        .collect();
    let mut alike: BTreeMap<&[bool], Vec<usize>> = BTreeMap::new();
    (0..leaves).for_each(|i| alike.entry(there[i]).or_default().push(i));
    for (there, leaves) in alike {
        if !there.contains(&false) {
            continue;
        }
        let known: Vec<usize> = (0..frames).filter(|&t| there[t]).collect();
        let equation = |(j, a): (usize, &Vec<f64>)| {
            let product = |b: &Vec<f64>| known.iter().map(|&t| a[t] * b[t]).sum();
            let mut row: Vec<f64> = basis.iter().map(product).collect();
            row[j] += if j == 0 { 0.0 } else { rest / energies[j - 1] };
            row.extend(known.iter().map(|&t| a[t]));
            row
        };
        let mut equations: Vec<Vec<f64>> = basis.iter().enumerate().map(equation).collect();
        solve(&mut equations);
        for leaf in leaves {
            let leaf = &mut values[leaf * frames * channels..][..frames * channels];
            for k in 0..channels {
                let own = |row: &Vec<f64>| -> f64 {
                    let factors = row[basis.len()..].iter().zip(&known);
                    factors.map(|(f, t)| f * f64::from(leaf[t * channels + k])).sum()
                };
                let fitted: Vec<f64> = equations.iter().map(own).collect();
                for t in (0..frames).filter(|&t| !there[t]) {
                    let each = fitted.iter().zip(&basis).map(|(f, basis)| f * basis[t]);
                    leaf[t * channels + k] = each.sum::<f64>() as f32;
                }
            }
        }
    }
}

fn add(to: &mut [f32], row: &[f32], factor: f32) {
    to.iter_mut().zip(row).for_each(|(to, v)| *to += factor * v);
}

/// Solves symmetric positive definite equations; right-hand sides follow the square matrix in each row, and become the
/// solutions.
fn solve(rows: &mut [Vec<f64>]) {
    for k in 0..rows.len() {
        let factor = 1.0 / rows[k][k];
        rows[k].iter_mut().for_each(|v| *v *= factor);
        let pivot = rows[k].clone();
        for row in rows.iter_mut().enumerate().filter(|(i, _)| *i != k).map(|(_, row)| row) {
            let factor = row[k];
            row.iter_mut().zip(&pivot).for_each(|(v, p)| *v -= factor * p);
        }
    }
}

/// Puts values into the frames that do not have their Gaussians, which are `rows`.
fn write(group: &Group, values: &[f32], rows: &[usize], there: &[&[bool]], frames: &mut [Scene]) {
    let count = frames.len();
    for (t, frame) in frames.iter_mut().enumerate() {
        let absent: Vec<usize> = (0..rows.len()).filter(|&i| !there[i][t]).collect();
        let mut own = Rows::new(absent.len(), group.channels);
        for (to, &i) in absent.iter().enumerate() {
            own.row_mut(to)
                .copy_from_slice(&values[(i * count + t) * group.channels..][..group.channels]);
        }
        let mut moved = Scene::zeros(absent.len(), frame.sh_degree);
        group.restore(&own, 0, &mut SceneMut::of(&mut moved));
        for (from, &i) in absent.iter().enumerate() {
            put(group.attribute, &moved, from, frame, rows[i]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_moves_evenly_where_it_is_there_goes_on_about_evenly() {
        let (count, frames) = (100, 12);
        let mut rng = testing::Rng::seeded(1);
        let place: Vec<[f32; 2]> = (0..count).map(|_| [rng.signed(), rng.signed()]).collect();
        let there = |i: usize, t: usize| t >= i % 4 && t < 7 + i % 6;
        let alive: Vec<bool> =
            (0..count).flat_map(|i| (0..frames).map(move |t| there(i, t))).collect();
        let at = |i: usize, t: usize| place[i][0] + place[i][1] * t as f32;
        let held = |i: usize, t: usize| at(i, t.clamp(i % 4, 6 + i % 6));
        let frame = |t: usize| {
            let mut scene = Scene::zeros(count, 0);
            (0..count).for_each(|i| scene.means[i][1] = held(i, t));
            scene
        };
        let mut all: Vec<Scene> = (0..frames).map(frame).collect();
        let error = |all: &[Scene]| {
            let each = (0..count).flat_map(|i| (0..frames).map(move |t| (i, t)));
            each.map(|(i, t)| (all[t].means[i][1] - at(i, t)).abs()).fold(0.0, f32::max)
        };
        let before = error(&all);
        move_on(&mut all, &alive);
        for (t, scene) in all.iter().enumerate() {
            for i in (0..count).filter(|&i| there(i, t)) {
                assert_eq!(scene.means[i][1], at(i, t));
            }
        }
        assert!(before > 3.0 && error(&all) < before / 3.0, "{before} {}", error(&all));
    }
}

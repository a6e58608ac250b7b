//! The parts of the paper's codec against the shortest code that says the same, on the room.

use std::collections::BTreeMap;

use anyhow::{Result, ensure};
use gpcc_lite::paper::predict::{Neighbours, decode_lossless, encode_lossless};
use gpcc_lite::paper::rlgr;
use gs_model::Scene;
use gs_model::math::{axes_product, rotation};
use voxel::w2::{self, Gaussian};
use voxel::{Strategy, Voxelization};
use vq::{Codebook, Covariance};

use super::references::room;
use super::{Tally, Verdict};

/// The depths of the criteria, the paper's tau1, and tau2 in sides of a voxel.
const DEPTHS: [u8; 2] = [5, 10];
const TAU: (u32, f64) = (30, 0.5);
/// The paper's v.
const LARGE_PERCENT: f64 = 20.0;

pub(super) fn checks(tally: &mut Tally) {
    tally.check("paper's criteria against figure 5", criteria);
    tally.check("W2 barycenters against their equation", barycenters);
    tally.check("codewords against a scan of the codebook", codewords);
    tally.check("RLGR and the predicting transform, there and back", lossless);
}

fn voxelized() -> Result<(Scene, voxel::Cube, Voxelization)> {
    let (scene, (tau1, tau2)) = (room()?, TAU);
    let [j_low, j_high] = DEPTHS;
    let strategy = Strategy::Paper { large_percent: LARGE_PERCENT, j_low, j_high, tau1, tau2 };
    let cube = voxel::cube_of(&scene.means)?;
    let voxels = voxel::voxelize(&scene, &cube, &strategy)?;
    Ok((scene, cube, voxels))
}

/// Figure 5: a voxel is divided if it holds a large Gaussian, more than tau1 or one farther than tau2 from its centre.
fn criteria() -> Result<Verdict> {
    let (scene, cube, voxels) = voxelized()?;
    let volume = |i: u32| scene.log_scales[i as usize].iter().map(|&l| f64::from(l)).sum::<f64>();
    let mut by_volume: Vec<u32> = (0..scene.len() as u32).collect();
    by_volume.sort_by(|&a, &b| volume(b).total_cmp(&volume(a)));
    let large = (scene.len() as f64 * LARGE_PERCENT / 100.0).round() as usize;
    let least = volume(by_volume[large - 1]);
    let mut wanted = vec![DEPTHS[1]; scene.len()];
    for depth in (DEPTHS[0]..DEPTHS[1]).rev() {
        let side = cube.side / f64::from(1u32 << depth);
        let place = |i: u32, k: usize| f64::from(scene.means[i as usize][k]) - cube.origin[k];
        let mut members: BTreeMap<[u64; 3], Vec<u32>> = BTreeMap::new();
        for i in 0..scene.len() as u32 {
            let voxel = [0, 1, 2].map(|k| (place(i, k) / side) as u64);
            members.entry(voxel).or_default().push(i);
        }
        for (voxel, members) in members {
            let off = |i: u32| [0, 1, 2].map(|k| place(i, k) - (voxel[k] as f64 + 0.5) * side);
            let far = |&i: &u32| off(i).map(|x| x * x).iter().sum::<f64>().sqrt() > TAU.1 * side;
            let divided = members.len() > TAU.0 as usize
                || members.iter().any(|&i| volume(i) >= least)
                || members.iter().any(far);
            if !divided {
                members.iter().for_each(|&i| wanted[i as usize] = depth);
            }
        }
    }
    let leaves = voxels.octree().leaves();
    let leaf_of_each = voxels.leaf_of_each(scene.len());
    let found = leaf_of_each.iter().map(|&leaf| leaves[leaf as usize].depth);
    let wrong = found.zip(&wanted).filter(|(found, wanted)| found != *wanted).count();
    ensure!(wrong == 0, "{wrong} of {} Gaussians have another depth", scene.len());
    Ok(Verdict::Holds(format!("{} Gaussians in {} leaves", scene.len(), leaves.len())))
}

/// The barycenter S of covariances C has S = mean of (S^1/2 C S^1/2)^1/2.
fn barycenters() -> Result<Verdict> {
    let (scene, _, voxels) = voxelized()?;
    let (mut worst, mut shared) = (0.0f64, 0);
    for leaf in (0..voxels.len()).filter(|&leaf| voxels.members_of(leaf).len() > 1) {
        let members = voxels.members_of(leaf);
        let all: Vec<Gaussian> =
            members.iter().map(|&i| Gaussian::of_scene(&scene, i as usize)).collect();
        let s = w2::barycenter(&all, &vec![1.0; all.len()]).gaussian.covariance;
        let root = w2::square_root(&s);
        let mut rest = s;
        for g in &all {
            rest -= w2::square_root(&(root * g.covariance * root)) / all.len() as f64;
        }
        worst = worst.max(rest.amax() / s.amax());
        shared += 1;
    }
    ensure!(worst < MAX_REST, "{worst:.1e} of a covariance is left, {MAX_REST:.0e} is allowed");
    Ok(Verdict::Holds(format!("{shared} voxels, at most {worst:.1e} of a covariance is left")))
}

/// What the equation of a barycenter may leave, of the greatest entry.
const MAX_REST: f64 = 1e-6;

/// Each covariance against all codewords, by the distance of square roots.
fn codewords() -> Result<Verdict> {
    let scene = room()?;
    let pairs = scene.rotations.iter().zip(&scene.log_scales).step_by(4);
    let split = pairs.map(|(&q, &l)| Ok(Covariance::split(q, l)?.0));
    let covariances = split.collect::<Result<Vec<Covariance>>>()?;
    let codebook = Codebook::train(&covariances, &vec![1.0; covariances.len()], 256)?;
    let root = |q, l: [f32; 3]| axes_product(&rotation(q), l.map(|l| libm::exp(f64::from(l))));
    let words = (0..codebook.len() as u32).map(|i| codebook.decode(i).map(|(q, l)| root(q, l)));
    let words: Vec<[f64; 6]> = words.collect::<Result<_, _>>()?;
    let mut worst = 0.0f64;
    for (covariance, index) in covariances.iter().zip(codebook.assign(&covariances)) {
        let here = root(covariance.quaternion(), covariance.log_scales());
        let distance = |word: &[f64; 6]| {
            let square = |k: usize| {
                let off = word[k] - here[k];
                if k < 3 { off * off } else { 2.0 * off * off }
            };
            (0..6).map(square).sum::<f64>().sqrt()
        };
        let nearest = words.iter().map(distance).fold(f64::MAX, f64::min);
        worst = worst.max(distance(&words[index as usize]) - nearest);
    }
    ensure!(worst < MAX_FARTHER, "a codeword is {worst:.1e} farther than the nearest");
    Ok(Verdict::Holds(format!("{} covariances, {} codewords", covariances.len(), words.len())))
}

/// By how much a codeword may be farther than the nearest, where the search rounds, in sizes of a Gaussian.
const MAX_FARTHER: f64 = 1e-6;

fn lossless() -> Result<Verdict> {
    let (scene, _, voxels) = voxelized()?;
    let values = |k: usize| {
        let of_leaf = |leaf| scene.log_scales[voxels.members_of(leaf)[0] as usize][k];
        (0..voxels.len()).map(|leaf| (of_leaf(leaf) * 1000.0) as i32).collect::<Vec<i32>>()
    };
    let channels = [values(0), values(1), values(2)];
    let near = Neighbours::new(voxels.octree());
    let bytes = encode_lossless(&near, &channels.each_ref().map(|c| c.as_slice()))?;
    ensure!(decode_lossless(&near, &bytes, 3)? == channels, "predicted values differ");
    let run_lengths: Vec<i32> = channels[0].iter().map(|v| v / 1000).collect();
    let coded = rlgr::encode(&run_lengths);
    ensure!(rlgr::decode(&coded, run_lengths.len())? == run_lengths, "values by RLGR differ");
    Ok(Verdict::Holds(format!("{} and {} bytes", coded.len(), bytes.len())))
}

//! What every strategy promises, on many scenes.

mod common;

use common::{clustered, cube, strategies};
use gpcc_lite::morton;
use gs_model::Scene;
use proptest::prelude::*;
use voxel::{Cube, Importance, Merge, Merging, Strategy, Voxelization, merge, voxelize};

/// Every Gaussian is in exactly one leaf (or dropped, where that is asked for); leaves ascend
/// and do not overlap; depths are in range.
fn check_partition(scene: &Scene, v: &Voxelization, may_drop: bool) {
    let mut all: Vec<u32> = v.members().iter().chain(v.dropped()).copied().collect();
    all.sort_unstable();
    assert!(all.iter().copied().eq(0..scene.len() as u32));
    assert!(may_drop || v.dropped().is_empty());
    assert!((0..v.len()).all(|i| !v.members_of(i).is_empty()), "no empty leaf");
    assert_eq!((0..v.len()).map(|i| v.members_of(i).len()).sum::<usize>(), v.members().len());
    for leaf in v.octree().leaves() {
        assert!(leaf.depth <= v.octree().depth());
        assert_eq!(leaf.morton & ((1 << (3 * (v.octree().depth() - leaf.depth))) - 1), 0);
    }
    for pair in v.octree().leaves().windows(2) {
        let end = pair[0].morton + (1u64 << (3 * (v.octree().depth() - pair[0].depth)));
        assert!(end <= pair[1].morton, "leaves overlap or are out of order");
    }
}

/// Every leaf contains the means of its members, in exact arithmetic on corners.
fn check_containment(scene: &Scene, v: &Voxelization) {
    for (l, leaf) in v.octree().leaves().iter().enumerate() {
        let cell = v.octree().cube().cell(v.octree().depth());
        let width = (1u64 << (v.octree().depth() - leaf.depth)) as f64;
        let index = morton::decode(leaf.morton).map(f64::from);
        for &m in v.members_of(l) {
            for k in 0..3 {
                let d = f64::from(scene.means[m as usize][k]) - v.octree().cube().origin[k];
                assert!(index[k] * cell <= d && d < (index[k] + width) * cell);
            }
        }
    }
}

/// Of a leaf that is split, each new one holds one cell of the greatest depth; all others stay as they are.
fn check_split(scene: &Scene, v: &Voxelization, may_drop: bool) {
    let is_apart = |members: &[u32]| members[0].is_multiple_of(3);
    let split = v.split(&scene.means, is_apart).unwrap();
    check_partition(scene, &split, may_drop);
    check_containment(scene, &split);
    assert_eq!(split.members(), v.members());
    let depth = v.octree().depth();
    let codes = voxel::morton_codes(&scene.means, &v.octree().cube(), depth).unwrap();
    let cells = |members: &[u32]| -> std::collections::BTreeSet<u64> {
        members.iter().map(|&m| codes[m as usize]).collect()
    };
    let mut at = 0;
    for (i, leaf) in v.octree().leaves().iter().enumerate() {
        let members = v.members_of(i);
        let parts = if is_apart(members) { cells(members).len() } else { 1 };
        for part in at..at + parts {
            let stays = split.octree().leaves()[part] == *leaf;
            assert!(parts > 1 && cells(split.members_of(part)).len() == 1 || stays);
        }
        at += parts;
    }
    assert_eq!(at, split.len());
}

fn check(scene: &Scene, cube: &Cube, j_low: u8, j_high: u8) {
    let uniform = voxelize(scene, cube, &Strategy::Uniform { depth: j_high }).unwrap();
    for strategy in strategies(scene.len(), j_low, j_high) {
        let v = voxelize(scene, cube, &strategy).unwrap();
        let may_drop = matches!(&strategy, Strategy::RateDistortion(o) if o.drop.is_some());
        check_partition(scene, &v, may_drop);
        if matches!(strategy, Strategy::Released(_)) {
            continue; // Its means move before they are voxelized, and J_high is a result.
        }
        check_containment(scene, &v);
        check_split(scene, &v, may_drop);
        assert!(v.octree().leaves().iter().all(|l| l.depth >= j_low && l.depth <= j_high));
        // A pruning of the full octree: every full-depth cell with a kept member lies in a leaf.
        if !may_drop && v.octree().depth() == j_high {
            let mut at = 0;
            for full in uniform.octree().leaves() {
                let end = |i: usize| {
                    v.octree().leaves()[i].morton
                        + (1u64 << (3 * (j_high - v.octree().leaves()[i].depth)))
                };
                while end(at) <= full.morton {
                    at += 1;
                }
                assert!(v.octree().leaves()[at].morton <= full.morton);
            }
            assert_eq!(at + 1, v.octree().leaves().len());
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 24, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn leaves_partition_the_scene(len in 1usize..400, seed: u64, low in 0u8..8, more in 0u8..14) {
        let scene = clustered(len, seed);
        check(&scene, &cube(&scene), low, low + more);
    }

    #[test]
    fn translation_and_scaling_by_powers_of_two_change_nothing(
        len in 1usize..300, seed: u64, shift in -3i32..4, power in -8i32..9,
    ) {
        let scene = clustered(len, seed);
        let factor = libm::exp2f(power as f32);
        let ln = power as f32 * std::f32::consts::LN_2;
        let mut moved = scene.clone();
        let mut scaled = scene.clone();
        for (i, mean) in scene.means.iter().enumerate() {
            moved.means[i] = mean.map(|x| x + shift as f32);
            scaled.means[i] = mean.map(|x| x * factor);
            scaled.log_scales[i] = scene.log_scales[i].map(|l| l + ln);
        }
        for strategy in strategies(len, 2, 12) {
            let want = voxelize(&scene, &cube(&scene), &strategy).unwrap();
            let by_shift = voxelize(&moved, &cube(&moved), &strategy).unwrap();
            // The authors' f32 centres are not translation-invariant; ours are.
            if !matches!(strategy, Strategy::Released(_)) {
                prop_assert_eq!(want.octree().leaves(), by_shift.octree().leaves());
                prop_assert_eq!(want.members(), by_shift.members());
            }
            // The log-scales of a scaled scene are rounded, which may tip a rate-distortion
            // decision whose two sides are equal to 7 digits; positions alone may not.
            let exact = !matches!(strategy, Strategy::RateDistortion(_));
            let by_factor = voxelize(&scaled, &cube(&scaled), &strategy).unwrap();
            if exact {
                prop_assert_eq!(want.octree().leaves(), by_factor.octree().leaves());
                prop_assert_eq!(want.members(), by_factor.members());
            } else {
                let differing = want.octree().leaves().iter().filter(|l| !by_factor.octree().leaves().contains(l)).count();
                prop_assert!(differing * 100 <= want.octree().leaves().len(), "{} leaves", differing);
            }
        }
    }

    #[test]
    fn merging_one_member_is_the_identity(len in 1usize..300, seed: u64) {
        let scene = clustered(len, seed);
        let cube = cube(&scene);
        let v = voxelize(&scene, &cube, &Strategy::Uniform { depth: 14 }).unwrap();
        for rule in [Merge::Paper, Merge::Moments] {
            let merged = merge(&scene, &v, rule).unwrap();
            prop_assert_eq!(merged.len(), v.len());
            for l in 0..v.len() {
                prop_assert_eq!(merged.means[l], cube.leaf_centre(v.octree().leaves()[l], v.octree().depth()));
                if let &[m] = v.members_of(l) {
                    let m = m as usize;
                    prop_assert_eq!(merged.rotations[l], scene.rotations[m]);
                    prop_assert_eq!(merged.log_scales[l], scene.log_scales[m]);
                    prop_assert_eq!(merged.opacity_logits[l], scene.opacity_logits[m]);
                    prop_assert_eq!(merged.sh_of(l), scene.sh_of(m));
                }
            }
        }
    }
}

/// The same bits for one thread and for several.
#[test]
fn thread_count_does_not_matter() {
    let scene = clustered(30_000, 5);
    let cube = cube(&scene);
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            strategies(scene.len(), 3, 12)
                .iter()
                .map(|s| {
                    let v = voxelize(&scene, &cube, s).unwrap();
                    let merged = merge(&scene, &v, Merge::Moments).unwrap();
                    (v, merged)
                })
                .collect::<Vec<_>>()
        })
    };
    let one = run(1);
    for threads in [2, 8] {
        assert!(run(threads) == one, "{threads} threads");
    }
}

/// Degree by degree, of a scene that loses each degree once it is merged, as at once.
#[test]
fn merging_degree_by_degree_is_merging() {
    for (len, rule, depth) in
        [(3000, Merge::Moments, 6), (900, Merge::Paper, 3), (3000, Merge::Moments, 2)]
    {
        let mut scene = clustered(len, 9);
        let mut r = testing::Rng::seeded(len as u64);
        scene.sh_degree = 3;
        scene.sh = (0..16 * len).map(|_| std::array::from_fn(|_| r.signed_exact())).collect();
        let v = voxelize(&scene, &cube(&scene), &Strategy::Uniform { depth }).unwrap();
        assert!((0..v.len()).any(|i| v.members_of(i).len() > 1));
        let given = (0..len).map(|i| 0.1 + (i % 17) as f32).collect();
        for importance in [Importance::OpacityArea, Importance::Given(given)] {
            let merging = Merging::new(&scene, &v, rule, &importance).unwrap();
            let whole = merging.scene();
            let mut left = scene.clone();
            for degree in (1..=3u8).rev() {
                let part = Merging::new(&left, &v, rule, &importance).unwrap();
                let upper = part.sh(degree);
                assert_eq!(upper, merging.sh(degree));
                let d = usize::from(degree);
                let wanted = (0..v.len()).flat_map(|i| &whole.sh_of(i)[d * d..(d + 1) * (d + 1)]);
                assert!(upper.iter().eq(wanted), "degree {degree}");
                let mut lower = whole.clone();
                lower.cut_sh(degree - 1);
                assert!(part.up_to(degree - 1) == lower);
                left.cut_sh(degree - 1);
                let part = Merging::new(&left, &v, rule, &importance).unwrap();
                assert!(part.sh(degree).is_empty());
            }
            let mut lower = whole;
            lower.cut_sh(0);
            assert!(Merging::new(&left, &v, rule, &importance).unwrap().scene() == lower);
        }
    }
}

/// The encoder merges a chunk at a time; to look at all importances each time takes a fifth of the encoding of a million
/// Gaussians.
#[test]
fn merging_a_part_looks_at_its_own_importances_alone() {
    let scene = clustered(40, 4);
    let whole = voxelize(&scene, &cube(&scene), &Strategy::Uniform { depth: 9 }).unwrap();
    let part = whole.regrouped(whole.octree().part(0..1), &[0, 1]);
    let with_nan_at = |i: u32| {
        let mut given = vec![1.0; 40];
        given[i as usize] = f32::NAN;
        let importance = Importance::Given(given);
        Merging::new(&scene, &part, Merge::Moments, &importance).map(|merging| merging.up_to(0))
    };
    assert_eq!(with_nan_at(whole.members()[1]).unwrap().len(), 1);
    assert!(with_nan_at(whole.members()[0]).is_err());
}

/// Half-open: the extreme mean gets the last index, not one past it.
#[test]
fn extreme_means_stay_inside() {
    for depth in [0, 1, 7, 21] {
        let scene = common::at(&[[0.0; 3], [1.0; 3], [0.5, 0.25, 1.0]], -3.0);
        let v = voxelize(&scene, &cube(&scene), &Strategy::Uniform { depth }).unwrap();
        let last = v.octree().leaves().last().unwrap();
        assert!(morton::decode(last.morton).iter().all(|&i| i < 1 << depth));
    }
}

/// The weights are importances: what is hidden gives the merged Gaussian no size, and must not make it opaque.
#[test]
fn a_merged_gaussian_is_no_more_opaque_than_its_members_on_top_of_each_other() {
    let scene = Scene {
        means: vec![[0.1; 3], [0.2; 3]],
        rotations: vec![[1.0, 0.0, 0.0, 0.0]; 2],
        // Faint, small and seen; half as opaque again, a hundred times as large and hidden.
        log_scales: vec![[-4.0; 3], [0.6; 3]],
        opacity_logits: vec![-3.0, -2.0],
        sh_degree: 0,
        sh: vec![[0.3; 3]; 2],
        ..Scene::default()
    };
    let v = voxelize(&scene, &cube(&scene), &Strategy::Uniform { depth: 0 }).unwrap();
    let seen = Importance::Given(vec![1.0, 1e-8]);
    let merged = Merging::new(&scene, &v, Merge::Moments, &seen).unwrap().scene();
    let clear = |logit: f32| 1.0 / (1.0 + libm::expf(logit));
    let stacked = 1.0 - clear(-3.0) * clear(-2.0);
    let opacity = 1.0 - clear(merged.opacity_logits[0]);
    assert!(opacity < 1.001 * stacked, "{opacity}, stacked {stacked}");
}

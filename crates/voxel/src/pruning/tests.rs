//! Each fast path against its reference.

use gs_model::Scene;

use super::state::Solution;
use super::{Pruning, blocks};
use crate::cube::cube_of;
use crate::descend::OccupiedCell;
use crate::importance::Importance;
use crate::order::{MortonOrder, morton_codes};
use crate::rate_distortion::RateDistortion;
use crate::record::{Record, Records, WeightSums};
use crate::strategy::Strategy;
use crate::tiles::Tiles;
use crate::voxelization::Voxelization;
use crate::voxelize::{voxelize, voxelize_tile};

/// Clusters of small Gaussians, every tenth one at the mean of the one before.
fn scene(len: usize) -> Scene {
    let mut state = 7u64;
    let mut unit = || {
        state =
            state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 40) as f32 / (1 << 23) as f32 - 1.0
    };
    let mut scene = Scene { sh_degree: 0, ..Scene::default() };
    for i in 0..len {
        let mean = [(i % 5) as f32 + 0.1 * unit(), unit() * unit(), 0.01 * unit()];
        scene.means.push(if i % 10 == 9 { scene.means[i - 1] } else { mean });
        scene.rotations.push([1.0, unit(), unit(), unit()]);
        scene.log_scales.push([-4.0 + unit(), -4.0 + unit(), -5.0 + unit()]);
        scene.opacity_logits.push(3.0 * unit());
        scene.sh.push([unit(), unit(), unit()]);
    }
    scene
}

/// Options that exercise every branch: with and without `j_low`, drops and prices.
fn all_options() -> Vec<RateDistortion> {
    let mut all = Vec::new();
    for lambda in [0.0, 1e-4, 1e-2, 1.0] {
        for (j_low, drop) in [(0, None), (4, None), (0, Some(2.0)), (4, Some(2.0))] {
            all.push(RateDistortion { j_low, j_high: 12, drop, ..RateDistortion::new(lambda) });
        }
    }
    all
}

/// Up to rounding. `scale` is the squared displacement across the cube, times the weight.
fn assert_close(a: &Solution, b: &Solution, scale: f64) {
    let close = |a: f64, b: f64| (a - b).abs() <= 1e-12 * b.abs() + 1e-14 * scale;
    assert!(close(a.cost, b.cost), "{} is not {}", a.cost, b.cost);
    assert!(close(a.moments.displacement(), b.moments.displacement()));
    assert_eq!(a.moments.importance, b.moments.importance);
    assert_eq!((a.empty, a.centre), (b.empty, b.centre));
}

/// At every depth the closed form gives what one step of the recurrence gives whose child is
/// solved by the closed form. By induction from `j_high` upwards it equals the recurrence.
#[test]
fn single_equals_the_recurrence() {
    let scene = scene(300);
    let cube = cube_of(&scene.means).unwrap();
    for options in all_options() {
        let order = MortonOrder::of(&scene, &cube, options.j_high).unwrap();
        let records = Records::of(&scene, &options.importance, options.size_exponent).unwrap();
        let pruning = Pruning::new(&cube, &options, &records);
        for (code, &i) in order.codes.iter().zip(&order.members) {
            let record = pruning.records.get(i);
            let cell = || OccupiedCell {
                codes: std::slice::from_ref(code),
                members: std::slice::from_ref(&record),
            };
            for depth in 0..=options.j_high {
                let (mut leaf, mut wanted) = (0, [0]);
                let single = pruning.solve_single(&cell(), depth, &mut leaf);
                let reference = if depth == options.j_high {
                    pruning.solve_finest(&cell(), &mut wanted)
                } else {
                    pruning.solve_divided(cell(), depth, &mut wanted)
                };
                assert_eq!([leaf], wanted, "{options:?} at depth {depth}");
                assert_close(&single, &reference, record.geometry * cube.side * cube.side);
            }
        }
    }
}

/// Bit for bit, in a scene of several blocks, for any number of threads.
#[test]
fn blocks_equal_one_pass() {
    let scene = scene(5 * blocks::BLOCK);
    let cube = cube_of(&scene.means).unwrap();
    for options in all_options() {
        let order = MortonOrder::of(&scene, &cube, options.j_high).unwrap();
        let records = Records::of(&scene, &options.importance, options.size_exponent).unwrap();
        let pruning = Pruning::new(&cube, &options, &records);
        let all: Vec<Record> = order.members.iter().map(|&i| pruning.records.get(i)).collect();
        let mut wanted = vec![0; all.len()];
        let root = OccupiedCell { codes: &order.codes, members: &all };
        let solved = pruning.solve(root, 0, &mut wanted);
        for threads in [1, 3] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let mut depths = vec![0; wanted.len()];
            let root = OccupiedCell { codes: &order.codes, members: &order.members };
            let in_blocks = pool.install(|| pruning.solve_in_blocks(root, 0, &mut depths));
            assert!(depths == wanted, "{options:?}");
            assert_eq!(in_blocks.cost.to_bits(), solved.cost.to_bits());
        }
    }
}

/// Where the cells of the tiles are divided anyway, tiles one after the other are the scene.
#[test]
fn tiles_joined_are_the_whole_scene() {
    let scene = scene(3000);
    let cube = cube_of(&scene.means).unwrap();
    for drop in [None, Some(2.0)] {
        let base = RateDistortion { j_high: 12, drop, ..RateDistortion::new(1e-4) };
        // Importances that go with the Gaussians: the default is relative to the scene.
        let of = |range: std::ops::Range<usize>| -> Vec<f32> {
            range.map(|i| ((i * 37) % 11) as f32 + 0.5).collect()
        };
        let options = RateDistortion { importance: Importance::Given(of(0..3000)), ..base.clone() };
        let sums = WeightSums::of(&scene, &options).unwrap();
        let whole = Strategy::RateDistortion(options.clone());
        let whole = voxelize(&scene, &cube, &whole).unwrap();
        let codes = morton_codes(&scene.means, &cube, options.j_high).unwrap();
        let tiles = Tiles::cut(options.j_high, 700, |take| {
            take(&codes);
            Ok::<_, ()>(())
        })
        .unwrap();
        assert!(tiles.len() > 4);
        let mut joined = Voxelization::empty(cube, options.j_high).unwrap();
        for tile in 0..tiles.len() {
            let members: Vec<u32> =
                (0..3000u32).filter(|&i| tiles.of(codes[i as usize]) == tile).collect();
            let places: Vec<usize> = members.iter().map(|&i| i as usize).collect();
            let all = of(0..3000);
            let importance = Importance::Given(places.iter().map(|&i| all[i]).collect());
            let strategy = Strategy::RateDistortion(RateDistortion { importance, ..base.clone() });
            let part = scene.select(&places);
            let leaves =
                voxelize_tile(&part, &cube, &strategy, &tiles.codes(tile), Some(sums)).unwrap();
            joined.append(&leaves, &members).unwrap();
        }
        assert!(joined == whole, "{drop:?}");
    }
}

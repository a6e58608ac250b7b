//! RAHT in single precision.

use gpcc_lite::raht::{RahtPlan, Rows, forward, inverse};
use gpcc_lite::{Leaf, Octree};
use testing::Rng;

use super::{Figure, Greatest, U};

/// Leaves of the inputs that are not about their number.
const FEW: usize = 100_000;

/// About `n` leaves, a part of the cells of the least octree that has room for twice as many.
fn leaves(n: usize, rng: &mut Rng) -> Octree {
    let depth = (1..21).find(|depth| 1 << (3 * depth) >= 2 * n).unwrap_or(21);
    let cells = 1u64 << (3 * depth);
    let share = n as f64 / cells as f64;
    let leaves = (0..cells).filter(|_| rng.unit() < share).map(|morton| Leaf { morton, depth });
    octree(depth, leaves.collect())
}

/// Two leaves in each cell of a path down to depth 21, so that merges follow each other 63 times.
fn path() -> Octree {
    let codes = std::iter::once(0).chain((0..63).map(|bit| 1u64 << bit));
    octree(21, codes.map(|morton| Leaf { morton, depth: 21 }).collect())
}

fn octree(depth: u8, leaves: Vec<Leaf>) -> Octree {
    Octree::of_points(depth, leaves).unwrap_or_default()
}

pub(super) fn figures(many: usize) -> Vec<Figure> {
    let mut rng = Rng::seeded(11);
    let tree = leaves(many, &mut rng);
    let plan = RahtPlan::new(tree);
    let few = RahtPlan::new(leaves(FEW, &mut rng));
    let mut weights = |n| (0..n).map(|_| 1 << (2 * rng.below(12))).collect::<Vec<u32>>();
    let important = few.clone().weighted(&weights(few.len()));
    let deep = RahtPlan::new(path()).weighted(&weights(64));
    let mut values = Rng::seeded(12);
    let mut unit = || f64::from(values.signed());
    let mut out = both("1e7 leaves in one tree, values to 1", &plan, &mut unit);
    drop(plan);
    let mut values = Rng::seeded(13);
    out.extend(both("values near 1e4", &few, &mut || 1e4 + f64::from(values.signed())));
    let mut values = Rng::seeded(14);
    let mut wide = || f64::from(values.signed()) * libm::exp(9.0 * f64::from(values.signed()));
    out.extend(both("values of 1e-4 to 1e4", &few, &mut wide));
    for (name, plan) in [
        ("importance weights 1 to 4^11", important),
        ("63 merges one above the other, such weights", deep),
    ] {
        match plan {
            Ok(plan) => out.extend(both(name, &plan, &mut wide)),
            Err(_) => out.push(Greatest::UNKNOWN.figure("RAHT", name)),
        }
    }
    out
}

/// Forward against the twin, and there and back.
fn both(name: &'static str, plan: &RahtPlan, value: &mut dyn FnMut() -> f64) -> Vec<Figure> {
    let n = plan.len();
    let values: Vec<f32> = (0..n).map(|_| value() as f32).collect();
    let greatest = values.iter().fold(0.0, |m: f64, v| m.max(f64::from(v.abs())));
    // Merges one above the other, each with a few roundings.
    let bound = 0.5 * U * (3.0 * f64::from(plan.octree().depth()) + 1.0);
    let mut rows = Rows::new(n, 1);
    values.iter().enumerate().for_each(|(i, v)| rows.row_mut(i)[0] = *v);
    let mut twin: Vec<f64> = values.iter().map(|v| f64::from(*v)).collect();
    let ran = forward(plan, &mut rows).is_ok() && plan.forward_f64(&mut twin).is_ok();
    let [mut there, mut back] = [Greatest::default(); 2];
    for (k, coefficient) in twin.iter().enumerate() {
        // Rows hold the mean of all, and differences of means.
        let (leaf, wanted) = match k {
            0 => (0, coefficient / plan.root_of_weight()),
            _ => {
                let [a, b] = plan.child_weights(k);
                (plan.split_leaf(k), coefficient * ((a + b) / (a * b)).sqrt())
            }
        };
        there.add((f64::from(rows.row(leaf)[0]) - wanted).abs() / greatest, bound);
    }
    let ran = ran && inverse(plan, &mut rows).is_ok();
    for (i, value) in values.iter().enumerate() {
        back.add((f64::from(rows.row(i)[0]) - f64::from(*value)).abs() / greatest, bound);
    }
    if !ran {
        there.add(f64::NAN, bound);
    }
    vec![
        there.figure("RAHT, of the greatest value", name),
        back.figure("RAHT and back, of the greatest value", name),
    ]
}

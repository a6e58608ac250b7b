//! The codec as kernels for a graphics adapter: their buffers, what these hold, and the order of the calls.
//!
//! Weighted RAHT in single precision on the groups of channels of [`GROUPS`], with a dead zone that depends on the magnitudes of
//! the levels above. The twins of `kernels/*.wgsl` are gpcc-lite and gsvx; a test in `device.rs` compares them.

use std::fmt::Write as _;

use finetune::kernels::{
    Call, GAUSSIAN, PAGE, PROJECT_ADJOINT, Program, ProgramPage, STEP, Shader,
};
use gpcc_lite::attribute::CLASSES;
use gsvx::latents::{
    Attribute, EQUAL_AXES, GROUPS, Group, LOGIT_RANGE, Latents, PredictFrom, Transform,
    TransformPrediction,
};

/// The kernels, in the order of their calls.
const SHADERS: &[Shader] = &[
    Shader::new("side", &["load", "add_predicted"], &[STEP, include_str!("kernels/side.wgsl")]),
    Shader::new("transform", &["transform"], &[STEP, include_str!("kernels/transform.wgsl")]),
    Shader::new(
        "quantise",
        &["quantise_means", "quantise"],
        &[STEP, include_str!("kernels/quantise.wgsl")],
    ),
    Shader::new("rebuild", &["rebuild"], &[STEP, include_str!("kernels/rebuild.wgsl")]),
    Shader::new(
        "move_latents",
        &["move_latents"],
        &[STEP, PAGE, GAUSSIAN, PROJECT_ADJOINT, include_str!("kernels/latents.wgsl")],
    ),
];

/// Words of a chunk before its predictions: first leaf, root of the sum of weights.
const PREDICTIONS: usize = 2;
/// Words of a chunk. Each group has two of its prediction: the factors of depth and class, or the logarithm of the
/// run length and the first factor.
const CHUNK_WORDS: usize = PREDICTIONS + 2 * GROUPS.len();
/// Activities of a merge and group.
const ACTIVITIES: usize = 3;

/// The text that all kernels share: functions and constants of the codec.
fn shared() -> String {
    let mut out = String::from(include_str!("kernels/codec.wgsl"));
    let number = |attribute| GROUPS.iter().position(|g| g.attribute == attribute).unwrap_or(0);
    for (name, value) in [
        ("GROUPS", GROUPS.len()),
        ("OPACITY", number(Attribute::Opacity)),
        ("COLOUR", number(Attribute::Colour { degree: 0 })),
        ("COVARIANCE", number(Attribute::Covariance)),
        ("FROM_LEAF", PredictFrom::FromLeaf as usize),
        ("FROM_BELOW", PredictFrom::FromBelow as usize),
        ("PREDICTIONS", PREDICTIONS),
        ("CHUNK_WORDS", CHUNK_WORDS),
        ("LAST_CLASS", CLASSES - 1),
    ] {
        // Formatting into a String cannot fail.
        let _ = writeln!(out, "const {name}: u32 = {value}u;");
    }
    let [low, high] = LOGIT_RANGE;
    for (name, value) in
        [("MIN_LOGIT", low), ("MAX_LOGIT", high), ("EQUAL_AXES", EQUAL_AXES as f32)]
    {
        let _ = writeln!(out, "const {name}: f32 = {:e};", f64::from(value));
    }
    out
}

/// The chunks of each page: as many as have at most `most` leaves together, but at least one.
pub(crate) fn pages(latents: &Latents, most: usize) -> Vec<Vec<Transform<'_>>> {
    let mut pages: Vec<Vec<Transform<'_>>> = Vec::new();
    for t in latents.transforms() {
        match pages.last_mut() {
            Some(page) if leaves_of(page) + t.plan.len() <= most => page.push(t),
            _ => pages.push(vec![t]),
        }
    }
    pages
}

/// The leaves of a page.
pub(crate) fn leaves_of(page: &[Transform<'_>]) -> usize {
    page.iter().map(|t| t.plan.len()).sum()
}

/// The program for latents; the values, and what [`fitted`] tells, are still to be written.
pub(crate) fn program(latents: &Latents, pages: &[Vec<Transform<'_>>]) -> Program {
    let pages = pages.iter().map(|page| program_page(latents, page)).collect();
    Program { shared: shared(), shaders: SHADERS, uniform: "codec", pages }
}

fn program_page(latents: &Latents, page: &[Transform<'_>]) -> ProgramPage {
    let chunks = page.len();
    let leaves = leaves_of(page);
    let (values, merges) = (leaves * latents.channels(), merges(page));
    let count = merges.words.len() / 6;
    let buffers = vec![
        ("latents", values),
        ("first_moments", values),
        ("second_moments", values),
        ("latent_rows", values),
        ("bit_prices", values),
        ("activity", ACTIVITIES * GROUPS.len() * count),
        ("merges", 6 * count),
        ("leaf_words", leaves),
        ("leaf_weights", leaves),
        ("chunks", CHUNK_WORDS * chunks),
        // A chunk has runs of 2^10 leaves or more, and a shorter one at its end.
        ("sh_factors", (leaves.div_ceil(1 << 10) + chunks) * factors_of_run()),
    ];
    let leaf_groups = (leaves as u32).div_ceil(64);
    let call = |shader, entry, words, workgroups| Call { shader, entry, words, workgroups };
    let mut before = Vec::new();
    for [first_group, groups] in passes(latents.groups()) {
        let lanes = |tasks: u32| (tasks * groups).div_ceil(64);
        let all = [0, 0, first_group, groups];
        let level = |shader, [first, count]: [u32; 2]| {
            call(shader, shader, [first, count, first_group, groups], lanes(count))
        };
        before.push(call("side", "load", all, leaf_groups));
        before.extend(merges.levels.iter().rev().map(|&l| level("transform", l)));
        before.push(call("quantise", "quantise_means", all, lanes(chunks as u32)));
        before.extend(merges.levels.iter().map(|&l| level("quantise", l)));
        before.push(call("side", "add_predicted", all, leaf_groups));
    }
    before.push(call("rebuild", "rebuild", [0; 4], leaf_groups));
    let after = vec![call("move_latents", "move_latents", [0; 4], leaf_groups)];
    ProgramPage { gaussians: leaves, buffers, uniform: uniform(latents, page), before, after }
}

/// First group and number of groups of each pass. The groups of a pass do not depend on each other; a group that is
/// predicted from the one before waits for it.
fn passes(groups: &[Group]) -> Vec<[u32; 2]> {
    let mut passes: Vec<[u32; 2]> = Vec::new();
    for (number, group) in (0..).zip(groups) {
        match passes.last_mut() {
            Some([_, count]) if group.predicted != PredictFrom::FromBelow => *count += 1,
            _ => passes.push([number, 1]),
        }
    }
    passes
}

/// Factors of the predictions of a run of leaves: one for each coefficient and coefficient of the degree below.
fn factors_of_run() -> usize {
    let pairs = GROUPS.windows(2).filter(|pair| pair[1].predicted == PredictFrom::FromBelow);
    pairs.map(|pair| pair[0].channels / 3 * (pair[1].channels / 3)).sum()
}

/// The words of `Codec` in `codec.wgsl`.
pub(crate) fn uniform(latents: &Latents, page: &[Transform<'_>]) -> Vec<u32> {
    let (leaves, chunks) = (leaves_of(page) as u32, page.len() as u32);
    let half_lambda = (0.5 * latents.lambda()).to_bits();
    let mut words = vec![leaves, latents.channels() as u32, chunks, half_lambda];
    for group in GROUPS {
        let first = group.among(latents.channels()).start as u32;
        let step = latents.step_of_unit_weight(&group).to_bits();
        words.extend([first, group.channels as u32, step, group.predicted as u32]);
    }
    words
}

/// The constant buffers of a page: merges, leaves, and the weights of the leaves.
pub(crate) fn fixed(page: &[Transform<'_>]) -> (Vec<u32>, Vec<u32>, Vec<f32>) {
    let (mut words, mut weights) = (Vec::new(), Vec::new());
    for (number, t) in (0u32..).zip(page) {
        let leaves = t.plan.leaves().iter().zip(t.classes);
        words
            .extend(leaves.map(|(leaf, &class)| {
                u32::from(leaf.depth) | u32::from(class) << 8 | number << 16
            }));
        weights.extend((0..t.plan.len()).map(|i| t.plan.weight_of_leaf(i) as f32));
    }
    (merges(page).words, words, weights)
}

/// The results of the last fit for a page: the words of its chunks, and the factors of their SH predictions.
pub(crate) fn fitted(page: &[Transform<'_>]) -> (Vec<u32>, Vec<f32>) {
    let (mut words, mut factors, mut first) = (Vec::new(), Vec::new(), 0);
    for t in page {
        words.extend([first, (t.plan.root_of_weight() as f32).to_bits()]);
        for prediction in &t.predictions {
            words.extend(match prediction {
                TransformPrediction::None => [0; 2],
                TransformPrediction::Leaf(factors) => factors.map(f32::to_bits),
                TransformPrediction::Below { log_run, .. } => {
                    [u32::from(*log_run), factors.len() as u32]
                }
            });
            if let TransformPrediction::Below { factors: own, .. } = prediction {
                factors.extend(own);
            }
        }
        first += t.plan.len() as u32;
    }
    (words, factors)
}

/// The merges of the chunks of a page from coarse to fine.
struct Merges {
    /// Of each merge: `Merge` of `codec.wgsl`.
    words: Vec<u32>,
    /// First merge and number of merges of each level. Merges of a level do not depend on each other.
    levels: Vec<[u32; 2]>,
}

fn merges(transforms: &[Transform<'_>]) -> Merges {
    let plans: Vec<_> = transforms.iter().map(|t| t.plan).collect();
    let depth = plans.iter().map(|p| p.levels().len()).max().unwrap_or(1);
    // By chunk and coefficient: the number of the merge, plus one.
    let mut numbers: Vec<Vec<u32>> = plans.iter().map(|p| vec![0; p.len().max(1)]).collect();
    let (mut words, mut levels, mut count) = (Vec::new(), Vec::new(), 0);
    for level in 1..depth {
        let (mut first_leaf, first) = (0, count);
        for (plan, numbers) in plans.iter().zip(&mut numbers) {
            let range = plan.levels().get(level - 1).zip(plan.levels().get(level));
            for k in range.map_or(0..0, |(&a, &b)| a as usize..b as usize) {
                let m = plan.merge(k);
                let [share, scale, gain] = [m.share, m.scale, m.noise_gain].map(f32::to_bits);
                let (left, right) = (m.left + first_leaf, m.right + first_leaf);
                words.extend([left, right, numbers[m.parent as usize], share, scale, gain]);
                count += 1;
                numbers[k] = count;
            }
            first_leaf += plan.len() as u32;
        }
        if count > first {
            levels.push([first, count - first]);
        }
    }
    Merges { words, levels }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_kernel_is_valid_and_translates_everywhere() {
        for shader in SHADERS {
            let source = shader.source(&shared());
            testing::wgsl::check(shader.name(), &source, shader.entries());
            let storage = source.matches("var<storage").count();
            assert!(storage <= 8, "{}: {storage} storage buffers", shader.name());
        }
    }
}

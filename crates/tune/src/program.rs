//! The codec as kernels for a graphics adapter: their buffers, what these hold, and the order of the calls.
//!
//! Weighted RAHT in single precision on six groups of channels, with a dead zone that depends on the magnitudes of
//! the levels above. The twins of `kernels/*.wgsl` are gpcc-lite and gsvx; a test in `device.rs` compares them.

use std::fmt::Write as _;

use finetune::kernels::{
    Call, GAUSSIAN, PAGE, PROJECT_ADJOINT, Program, ProgramPage, STEP, Shader,
};
use gpcc_lite::attribute::CLASSES;
use gsvx::latents::{EQUAL_AXES, LOGIT_RANGE, Latents, Transform};

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

/// Words of a chunk: first leaf, root of the sum of weights, factors of depth and class for opacity and for size,
/// then for SH degrees 2 and 3 the logarithm of the run length and the first factor.
const CHUNK_WORDS: usize = 10;
/// Groups of channels: opacity, DC, SH degrees 1 to 3, covariance.
const GROUPS: usize = 6;
/// Activities of a merge and group.
const ACTIVITIES: usize = 3;

/// The text that all kernels share: functions and constants of the codec.
fn shared() -> String {
    let mut out = String::from(include_str!("kernels/codec.wgsl"));
    let [low, high] = LOGIT_RANGE;
    // Formatting into a String cannot fail.
    let _ = writeln!(out, "const CHUNK_WORDS: u32 = {CHUNK_WORDS}u;");
    let _ = writeln!(out, "const LAST_CLASS: u32 = {}u;", CLASSES - 1);
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
    let (chunks, degree) = (page.len(), u32::from(latents.sh_degree()));
    let leaves = leaves_of(page);
    let (values, merges) = (leaves * latents.channels(), merges(page));
    let count = merges.words.len() / 6;
    let buffers = vec![
        ("latents", values),
        ("first_moments", values),
        ("second_moments", values),
        ("latent_rows", values),
        ("bit_prices", values),
        ("activity", ACTIVITIES * GROUPS * count),
        ("merges", 6 * count),
        ("leaf_words", leaves),
        ("leaf_weights", leaves),
        ("chunks", CHUNK_WORDS * chunks),
        // A chunk has runs of 2^10 leaves or more, and a shorter one at its end.
        ("sh_factors", (leaves.div_ceil(1 << 10) + chunks) * (3 * 5 + 5 * 7)),
    ];
    let leaf_groups = (leaves as u32).div_ceil(64);
    let call = |shader, entry, words, workgroups| Call { shader, entry, words, workgroups };
    let mut before = Vec::new();
    // Groups of channels of a pass do not depend on each other; those of the next depend on them.
    for pass in 0..degree.max(1) {
        let groups = if pass == 0 { 3 + u32::from(degree >= 1) } else { 1 };
        let lanes = |tasks: u32| (tasks * groups).div_ceil(64);
        let all = [0, 0, pass, 0];
        let level = |shader, [first, count]: [u32; 2]| {
            call(shader, shader, [first, count, pass, 0], lanes(count))
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

/// The words of `Codec` in `codec.wgsl`.
pub(crate) fn uniform(latents: &Latents, page: &[Transform<'_>]) -> Vec<u32> {
    let steps = latents.steps_of_unit_weight().map(f32::to_bits);
    let (leaves, chunks) = (leaves_of(page) as u32, page.len() as u32);
    let counts = [leaves, latents.channels() as u32, latents.sh_degree().into(), chunks];
    let half_lambda = (0.5 * latents.lambda()).to_bits();
    [&steps[..], &[0; 2], &counts, &[half_lambda, 0, 0, 0]].concat()
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
        words.extend([t.opacity, t.size].as_flattened().iter().map(|f| f.to_bits()));
        for prediction in &t.sh {
            let log_run = prediction.as_ref().map_or(0, |p| p.0.into());
            words.extend([log_run, factors.len() as u32]);
            factors.extend(prediction.iter().flat_map(|p| &p.1));
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

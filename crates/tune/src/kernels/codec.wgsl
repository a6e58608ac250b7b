// What the kernels of the codec share. The Rust twin is `gpcc_lite::attribute` with `gsvx::latents`; constants come from there.
//
// A leaf has `channels` values: ln(alpha), Y Co Cg of each SH coefficient, six coordinates of the covariance.
// They form groups that are transformed and quantised apart: opacity, DC, SH degrees 1 to 3, covariance.
// Degrees 2 and 3 are predicted from the reconstruction of the degree below. So there are up to three
// passes: opacity, DC, covariance and degree 1; degree 2; degree 3.

// Leaves, merges and chunks are those of a page: some whole chunks, which do not depend on others.
struct Codec {
    // Steps of opacity, DC, degrees 1 and 2; of degree 3 and covariance.
    steps: vec4<f32>,
    more_steps: vec4<f32>,
    leaves: u32,
    channels: u32,
    sh_degree: u32,
    chunks: u32,
    // Half of the quantiser's Lagrangian multiplier, in steps^2 per bit.
    half_lambda: f32,
    pad0: u32,
    pad1: u32,
    pad2: u32,
}

// What a call of a kernel works on: a level of merges, and the pass.
struct Call {
    first: u32,
    count: u32,
    pass_index: u32,
    pad: u32,
}

struct Merge {
    left: u32,
    right: u32,
    // Number of the merge above, plus one; 0 for the root of a chunk.
    parent: u32,
    share: f32,
    scale: f32,
    gain: f32,
}

const OPACITY: u32 = 0u;
const DC: u32 = 1u;
const COVARIANCE: u32 = 5u;
const GROUPS: u32 = 6u;

fn first_channel(group: u32, channels: u32) -> u32 {
    switch group {
        case 0u: { return 0u; }
        case 1u: { return 1u; }
        case 2u: { return 4u; }
        case 3u: { return 13u; }
        case 4u: { return 28u; }
        default: { return channels - 6u; }
    }
}

fn channels_of(group: u32) -> u32 {
    switch group {
        case 0u: { return 1u; }
        case 1u: { return 3u; }
        case 2u: { return 9u; }
        case 3u: { return 15u; }
        case 4u: { return 21u; }
        default: { return 6u; }
    }
}

fn groups_of_pass(pass_index: u32, sh_degree: u32) -> u32 {
    return select(1u, select(3u, 4u, sh_degree >= 1u), pass_index == 0u);
}

// Group `j` of a pass.
fn group_of_pass(pass_index: u32, j: u32) -> u32 {
    if (pass_index != 0u) {
        return pass_index + 2u;
    }
    switch j {
        case 0u: { return OPACITY; }
        case 1u: { return DC; }
        case 2u: { return COVARIANCE; }
        default: { return 2u; }
    }
}

fn step_of(codec: Codec, group: u32) -> f32 {
    if (group < 4u) {
        return codec.steps[group];
    }
    return codec.more_steps[group - 4u];
}

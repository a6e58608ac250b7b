// What the kernels of the codec share. The Rust twin is `gpcc_lite::attribute` with `gsvx::latents`; constants come from there.
//
// A leaf has `channels` values, in groups that are transformed and quantised apart. Some groups are predicted from the
// reconstruction of the group before and wait for it. So there are several passes.

struct Group {
    // Where its values are among those of a leaf.
    first: u32,
    channels: u32,
    step: f32,
    // FROM_LEAF, FROM_BELOW or neither.
    predicted: u32,
}

// Leaves, merges and chunks are those of a page: some whole chunks, which do not depend on others.
struct Codec {
    leaves: u32,
    channels: u32,
    chunks: u32,
    // Half of the quantiser's Lagrangian multiplier, in steps^2 per bit.
    half_lambda: f32,
    groups: array<Group, GROUPS>,
}

// What a call of a kernel works on: a level of merges, and the groups of a pass.
struct Call {
    first: u32,
    count: u32,
    first_group: u32,
    groups: u32,
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

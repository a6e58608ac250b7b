// Stage `side`: `load` puts what remains of the values beside their predictions into the rows, before the
// transform; `add_predicted` adds the predictions to the reconstruction, after it.

@group(0) @binding(1) var<uniform> codec: Codec;
@group(0) @binding(2) var<uniform> call: Call;
@group(0) @binding(3) var<storage, read> latents: array<f32>;
@group(0) @binding(4) var<storage, read_write> latent_rows: array<f32>;
// Depth, importance class << 8, chunk << 16.
@group(0) @binding(5) var<storage, read> leaf_words: array<u32>;
@group(0) @binding(6) var<storage, read> chunks: array<u32>;
@group(0) @binding(7) var<storage, read> sh_factors: array<f32>;

// What depth and class predict; `at` is the word of the factors.
fn by_depth_and_class(leaf: u32, at: u32) -> f32 {
    let word = leaf_words[leaf];
    let chunk = CHUNK_WORDS * (word >> 16u);
    let by_depth = bitcast<f32>(chunks[chunk + at]) * f32(word & 255u);
    return by_depth + bitcast<f32>(chunks[chunk + at + 1u]) * f32((word >> 8u) & 255u);
}

// The prediction of a channel of SH degree 2 or 3 from the reconstructed degree below.
fn by_degree_below(leaf: u32, degree: u32, channel: u32) -> f32 {
    let chunk = CHUNK_WORDS * (leaf_words[leaf] >> 16u);
    let at = chunk + 6u + 2u * (degree - 2u);
    let log_run = chunks[at];
    if (log_run == 0u) {
        return 0.0;
    }
    let inputs = 2u * degree - 1u;
    let outputs = 2u * degree + 1u;
    let run = (leaf - chunks[chunk]) >> log_run;
    let factors = chunks[at + 1u] + (run * outputs + channel / 3u) * inputs;
    let below = leaf * codec.channels + first_channel(degree, codec.channels) + channel % 3u;
    var sum = 0.0;
    for (var j = 0u; j < inputs; j++) {
        sum += sh_factors[factors + j] * latent_rows[below + 3u * j];
    }
    return sum;
}

// What is predicted of a channel of a group.
fn predicted(leaf: u32, group: u32, channel: u32) -> f32 {
    if (group == OPACITY) {
        return by_depth_and_class(leaf, 2u);
    }
    if (group == COVARIANCE) {
        return select(0.0, by_depth_and_class(leaf, 4u), channel == 0u);
    }
    if (group >= 3u) {
        return by_degree_below(leaf, group - 1u, channel);
    }
    return 0.0;
}

// Of all channels of a leaf in this pass: the values without their predictions, or the rows with them.
fn with_predictions(leaf: u32, add: bool) {
    if (leaf >= codec.leaves) {
        return;
    }
    for (var j = 0u; j < groups_of_pass(call.pass_index, codec.sh_degree); j++) {
        let g = group_of_pass(call.pass_index, j);
        let first = leaf * codec.channels + first_channel(g, codec.channels);
        for (var c = 0u; c < channels_of(g); c++) {
            let prediction = predicted(leaf, g, c);
            if (add) {
                latent_rows[first + c] += prediction;
            } else {
                latent_rows[first + c] = latents[first + c] - prediction;
            }
        }
    }
}

@compute @workgroup_size(64)
fn load(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    with_predictions(group_index(group) * 64u + lane, false);
}

@compute @workgroup_size(64)
fn add_predicted(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    with_predictions(group_index(group) * 64u + lane, true);
}

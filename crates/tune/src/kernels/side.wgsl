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

// The first of the words that a leaf's chunk has of the prediction of a group.
fn prediction_words(leaf: u32, number: u32) -> u32 {
    return CHUNK_WORDS * (leaf_words[leaf] >> 16u) + PREDICTIONS + 2u * number;
}

// What depth and class predict.
fn by_depth_and_class(leaf: u32, number: u32) -> f32 {
    let word = leaf_words[leaf];
    let at = prediction_words(leaf, number);
    let by_depth = bitcast<f32>(chunks[at]) * f32(word & 255u);
    return by_depth + bitcast<f32>(chunks[at + 1u]) * f32((word >> 8u) & 255u);
}

// The prediction of a channel of an SH degree from the reconstructed degree below.
fn by_degree_below(leaf: u32, number: u32, channel: u32) -> f32 {
    let at = prediction_words(leaf, number);
    let log_run = chunks[at];
    if (log_run == 0u) {
        return 0.0;
    }
    let below = codec.groups[number - 1u];
    let inputs = below.channels / 3u;
    let outputs = codec.groups[number].channels / 3u;
    let run = (leaf - chunks[CHUNK_WORDS * (leaf_words[leaf] >> 16u)]) >> log_run;
    let factors = chunks[at + 1u] + (run * outputs + channel / 3u) * inputs;
    let values = leaf * codec.channels + below.first + channel % 3u;
    var sum = 0.0;
    for (var j = 0u; j < inputs; j++) {
        sum += sh_factors[factors + j] * latent_rows[values + 3u * j];
    }
    return sum;
}

// What is predicted of a channel of a group.
fn predicted(leaf: u32, number: u32, channel: u32) -> f32 {
    let by = codec.groups[number].predicted;
    if (by == FROM_LEAF && channel == 0u) {
        return by_depth_and_class(leaf, number);
    }
    if (by == FROM_BELOW) {
        return by_degree_below(leaf, number, channel);
    }
    return 0.0;
}

// Of all channels of a leaf in this pass: the values without their predictions, or the rows with them.
fn with_predictions(leaf: u32, add: bool) {
    if (leaf >= codec.leaves) {
        return;
    }
    for (var j = 0u; j < call.groups; j++) {
        let number = call.first_group + j;
        let own = codec.groups[number];
        let first = leaf * codec.channels + own.first;
        for (var c = 0u; c < own.channels; c++) {
            let prediction = predicted(leaf, number, c);
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

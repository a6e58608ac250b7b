// Stage `quantise`: `quantise_means` codes the mean of each chunk, `quantise` one level of merges. It
// quantises the differences of a level, replaces node and difference by the reconstructed means of both
// children, and takes the derivatives of the bits the same way.

@group(0) @binding(1) var<uniform> codec: Codec;
@group(0) @binding(2) var<uniform> call: Call;
@group(0) @binding(3) var<storage, read> merges: array<Merge>;
@group(0) @binding(4) var<storage, read_write> latent_rows: array<f32>;
@group(0) @binding(5) var<storage, read_write> bit_prices: array<f32>;
// Three activities of each merge and group.
@group(0) @binding(6) var<storage, read_write> activity: array<f32>;
@group(0) @binding(7) var<storage, read> chunks: array<u32>;

fn log2_linear(x: f32) -> f32 {
    let bits = bitcast<u32>(x);
    let exponent = f32(bits >> 23u) - 127.0;
    return exponent + (bitcast<f32>((bits & 0x007fffffu) | 0x3f800000u) - 1.0);
}

fn class_of(expected: f32) -> u32 {
    let at = (bitcast<u32>(expected + 0.0625) >> 22u) - (bitcast<u32>(0.0625f) >> 22u);
    return min(at, LAST_CLASS);
}

fn mean_of_class(class_index: u32) -> f32 {
    let low = class_index + (bitcast<u32>(0.0625f) >> 22u);
    return bitcast<f32>((low << 22u) | (1u << 21u)) - 0.0625;
}

fn expected_in_group(above: f32, sum: f32, i: u32) -> f32 {
    return select((3.0 * above + sum) / (3.0 + f32(i)), above, i == 0u);
}

@compute @workgroup_size(64)
fn quantise_means(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let task = group_index(group) * 64u + lane;
    if (task >= codec.chunks * call.groups) {
        return;
    }
    let chunk = CHUNK_WORDS * (task / call.groups);
    let own = codec.groups[call.first_group + task % call.groups];
    let root = bitcast<f32>(chunks[chunk + 1u]);
    let width = own.step / root;
    let first = chunks[chunk] * codec.channels + own.first;
    for (var c = 0u; c < own.channels; c++) {
        let x = latent_rows[first + c] / width;
        latent_rows[first + c] = trunc(x + select(-0.5, 0.5, x >= 0.0)) * width;
        bit_prices[first + c] = 0.0;
    }
}

@compute @workgroup_size(64)
fn quantise(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let task = group_index(group) * 64u + lane;
    if (task >= call.count * call.groups) {
        return;
    }
    let index = call.first + task / call.groups;
    let merge = merges[index];
    let number = call.first_group + task % call.groups;
    let own = codec.groups[number];
    let count = own.channels;
    let left = merge.left * codec.channels + own.first;
    let right = merge.right * codec.channels + own.first;
    let width = own.step;
    let per_step = 1.0 / width;
    let to_high_pass = 1.0 / merge.scale;

    var above = vec3<f32>();
    if (merge.parent != 0u) {
        let at = 3u * ((merge.parent - 1u) * GROUPS + number);
        above = vec3<f32>(activity[at], activity[at + 1u], activity[at + 2u]);
    }
    let expected = above * merge.gain;
    var any = false;
    for (var c = 0u; c < count; c++) {
        any = any || abs(latent_rows[right + c] * per_step * to_high_pass) >= 0.5;
    }
    let size = select(count, 3u, count > 6u);
    var sums = vec3<f32>();
    var sum = 0.0;
    var i = 0u;
    for (var c = 0u; c < count; c++) {
        let x = latent_rows[right + c] * per_step * to_high_pass;
        let class_index = class_of(expected_in_group(expected[c % 3u], sum, i));
        let mean = max(mean_of_class(class_index), 1.0 / 512.0);
        let bits = log2_linear(1.0 + 1.0 / mean);
        let magnitude = abs(x);
        var q = 0.0;
        if (any && magnitude >= min(0.5 + codec.half_lambda * (bits + 1.0), 1.45)) {
            q = floor(magnitude);
            q += select(0.0, 1.0, magnitude - q >= min(0.5 + codec.half_lambda * bits, 0.95));
            q = max(q, 1.0);
        }
        // The derivative of the bits by the difference of means.
        let per_unit = log2_linear(1.0 + 1.0 / (mean + 0.5 * magnitude));
        let with_sign = per_unit + select(0.0, 1.0, magnitude < 1.0);
        let price = with_sign * clamp(4.0 * x, -1.0, 1.0) * per_step / to_high_pass;
        // Both children, from the node and the difference.
        let difference = select(q, -q, x < 0.0) * width * merge.scale;
        let low = latent_rows[left + c] - difference * merge.share;
        latent_rows[left + c] = low;
        latent_rows[right + c] = low + difference;
        let low_price = bit_prices[left + c] - price * merge.share;
        bit_prices[left + c] = low_price;
        bit_prices[right + c] = low_price + price;
        sums[c % 3u] += q;
        sum += q;
        i += 1u;
        if (i == size) {
            i = 0u;
            sum = 0.0;
        }
    }
    let at = 3u * (index * GROUPS + number);
    for (var a = 0u; a < 3u; a++) {
        let members = max((count + 2u - a) / 3u, 1u);
        activity[at + a] = 0.5 * above[a] + sums[a] * (0.5 / f32(members)) / merge.gain;
    }
}

// A stable radix sort of (key, value) pairs, four bits per pass: the stages `sort_depth` and
// `sort_tile`. A workgroup sorts RADIX_BLOCK consecutive pairs. A lane sorts RADIX_PER_LANE of them
// one after the other, so equal digits keep their order without atomics.

struct Pass {
    shift: u32,
    // Slot of `state` with the number of pairs.
    count_slot: u32,
    // Workgroups of the histogram.
    blocks: u32,
    // 1 if the values are their own indices (the first pass).
    identity: u32,
}

@group(0) @binding(1) var<uniform> p: Pass;
@group(0) @binding(2) var<storage, read> state: array<u32>;
@group(0) @binding(3) var<storage, read> keys_in: array<u32>;
@group(0) @binding(4) var<storage, read> values_in: array<u32>;
@group(0) @binding(5) var<storage, read_write> keys_out: array<u32>;
@group(0) @binding(6) var<storage, read_write> values_out: array<u32>;
@group(0) @binding(7) var<storage, read_write> histogram: array<u32>;

const LANES: u32 = 64u;

// Per lane and digit: counts, then running positions.
var<workgroup> table: array<u32, 1024>;

fn digit_of(key: u32) -> u32 {
    return (key >> p.shift) & 15u;
}

@compute @workgroup_size(64)
fn sort_count(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let block = group_index(group);
    let n = state[p.count_slot];
    for (var d = 0u; d < 16u; d++) {
        table[d * LANES + lane] = 0u;
    }
    let first = block * RADIX_BLOCK + lane * RADIX_PER_LANE;
    for (var k = 0u; k < RADIX_PER_LANE; k++) {
        if (first + k < n) {
            table[digit_of(keys_in[first + k]) * LANES + lane] += 1u;
        }
    }
    workgroupBarrier();
    if (lane < 16u && block < p.blocks) {
        var sum = 0u;
        for (var l = 0u; l < LANES; l++) {
            sum += table[lane * LANES + l];
        }
        histogram[lane * p.blocks + block] = sum;
    }
}

@compute @workgroup_size(64)
fn sort_scatter(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let block = group_index(group);
    let n = state[p.count_slot];
    for (var d = 0u; d < 16u; d++) {
        table[d * LANES + lane] = 0u;
    }
    let first = block * RADIX_BLOCK + lane * RADIX_PER_LANE;
    for (var k = 0u; k < RADIX_PER_LANE; k++) {
        if (first + k < n) {
            table[digit_of(keys_in[first + k]) * LANES + lane] += 1u;
        }
    }
    workgroupBarrier();
    if (lane < 16u && block < p.blocks) {
        var sum = histogram[lane * p.blocks + block];
        for (var l = 0u; l < LANES; l++) {
            let at = lane * LANES + l;
            let c = table[at];
            table[at] = sum;
            sum += c;
        }
    }
    workgroupBarrier();
    for (var k = 0u; k < RADIX_PER_LANE; k++) {
        let i = first + k;
        if (i < n) {
            let key = keys_in[i];
            let at = digit_of(key) * LANES + lane;
            let to = table[at];
            table[at] = to + 1u;
            keys_out[to] = key;
            var value = i;
            if (p.identity == 0u) {
                value = values_in[i];
            }
            values_out[to] = value;
        }
    }
}

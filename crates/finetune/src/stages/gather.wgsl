// Stage `gather`: sums the records of a Gaussian's slots in the order of emission.

@group(0) @binding(1) var<storage, read> state: array<u32>;
@group(0) @binding(2) var<storage, read> order: array<u32>;
@group(0) @binding(3) var<storage, read> starts: array<u32>;
@group(0) @binding(4) var<storage, read> places: array<u32>;
@group(0) @binding(5) var<storage, read> records: array<f32>;
// Seven sums per Gaussian; after them, 1.0 if the step is void.
@group(0) @binding(6) var<storage, read_write> sums: array<f32>;

@compute @workgroup_size(64)
fn gather(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let rank = group_index(group) * 64u + lane;
    if (rank == 0u) {
        sums[7u * u.count] = select(0.0, 1.0, state[2] != 0u);
    }
    if (rank >= u.count || state[2] != 0u) {
        return;
    }
    var s: array<f32, 7>;
    let end = starts[rank + 1u];
    for (var k = starts[rank]; k < end; k++) {
        let at = 7u * places[k];
        for (var c = 0u; c < 7u; c++) {
            s[c] += records[at + c];
        }
    }
    let i = order[rank];
    for (var c = 0u; c < 7u; c++) {
        sums[7u * i + c] = s[c];
    }
}

// Stage `gather`: sums the records of a Gaussian's slots in the order of emission.

@group(0) @binding(1) var<storage, read> state: array<u32>;
@group(0) @binding(2) var<storage, read> order: array<u32>;
@group(0) @binding(3) var<storage, read> starts: array<u32>;
@group(0) @binding(4) var<storage, read> list_positions: array<u32>;
@group(0) @binding(5) var<storage, read> records: array<f32>;
// Seven sums per Gaussian; after them, 1.0 if the step is void.
@group(0) @binding(6) var<storage, read_write> sums: array<f32>;
@group(0) @binding(7) var<storage, read> splats: array<Splat>;

@compute @workgroup_size(64)
fn gather(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let rank = group_index(group) * 64u + lane;
    if (rank == 0u) {
        sums[7u * u.count] = select(0.0, 1.0, state[2] != 0u);
    }
    if (rank >= u.count || state[2] != 0u) {
        return;
    }
    //@each c 0 1 2 3 4 5 6
    var s$c = 0.0;
    //@end
    let end = starts[rank + 1u];
    for (var k = starts[rank]; k < end; k++) {
        let at = 7u * list_positions[k];
        //@each c 0 1 2 3 4 5 6
        s$c += records[at + $cu];
        //@end
    }
    let i = order[rank];
    // The gradient of a colour that was clamped at zero is zero.
    let shown = splats[i].c;
    s0 = select(0.0, s0, shown.x > 0.0);
    s1 = select(0.0, s1, shown.y > 0.0);
    s2 = select(0.0, s2, shown.z > 0.0);
    //@each c 0 1 2 3 4 5 6
    sums[7u * i + $cu] = s$c;
    //@end
}

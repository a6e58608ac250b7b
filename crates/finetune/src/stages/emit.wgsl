// Stage `emit`: one (tile, slot) pair per Gaussian and tile that it touches, in depth order.

@group(0) @binding(1) var<storage, read> splats: array<Splat>;
@group(0) @binding(2) var<storage, read> boxes: array<vec4<u32>>;
@group(0) @binding(3) var<storage, read> counts: array<u32>;
@group(0) @binding(4) var<storage, read> order: array<u32>;
@group(0) @binding(5) var<storage, read_write> starts: array<u32>;
@group(0) @binding(6) var<storage, read_write> state: array<u32>;
@group(0) @binding(7) var<storage, read_write> slot_tiles: array<u32>;
@group(0) @binding(8) var<storage, read_write> slot_ids: array<u32>;

// Tile counts in depth order, followed by a zero, so that the scan ends with the total.
@compute @workgroup_size(64)
fn rank_counts(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let rank = group_index(group) * 64u + lane;
    if (rank < u.count) {
        starts[rank] = counts[order[rank]];
    } else if (rank == u.count) {
        starts[rank] = 0u;
    }
}

// The words of `state`: 0: Gaussians; 1: slots in use; 2: the first step that needed more slots than
// exist (it and all later steps do nothing until the host has made room); 3: the slots it needed.
@compute @workgroup_size(1)
fn check_capacity() {
    let total = starts[u.count];
    state[0] = u.count;
    if (state[2] == 0u && total > u.capacity) {
        state[2] = u.step;
        state[3] = total;
    }
    state[1] = select(0u, total, state[2] == 0u);
}

@compute @workgroup_size(64)
fn emit(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let rank = group_index(group) * 64u + lane;
    if (rank >= u.count || state[1] == 0u) {
        return;
    }
    let i = order[rank];
    var at = starts[rank];
    let end = at + counts[i];
    if (at == end) {
        return;
    }
    let s = splats[i];
    let box = boxes[i];
    for (var ty = box.z; ty < box.w; ty++) {
        for (var tx = box.x; tx < box.y; tx++) {
            // `project` counted with the same function, but its compilation may round differently:
            // never write past the count.
            if (at < end && touches(s, tx, ty)) {
                slot_tiles[at] = ty * u.tiles_x + tx;
                slot_ids[at] = i;
                at++;
            }
        }
    }
    // For the same reason slots may be left over: they belong to no tile and sort last.
    for (; at < end; at++) {
        slot_tiles[at] = u.tiles_x * u.tiles_y;
        slot_ids[at] = i;
    }
}

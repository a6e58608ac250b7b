// Stage `emit`: one (tile, slot) pair per Gaussian and tile that it touches, in depth order.

@group(0) @binding(1) var<storage, read> splats: array<Splat>;
@group(0) @binding(2) var<storage, read> starts: array<u32>;
@group(0) @binding(3) var<storage, read> depth_keys_b: array<u32>;
@group(0) @binding(4) var<storage, read_write> state: array<u32>;
@group(0) @binding(5) var<storage, read_write> slot_tiles: array<u32>;
@group(0) @binding(6) var<storage, read_write> slot_ids: array<u32>;

// The Gaussians that the band shows: those whose key is not that of the culled ones.
fn shown() -> u32 {
    var low = 0u;
    var high = u.count;
    while (low < high) {
        let middle = (low + high) / 2u;
        if (depth_keys_b[middle] != 0xffffffffu) {
            low = middle + 1u;
        } else {
            high = middle;
        }
    }
    return low;
}

// The words of `state`: 0: Gaussians; 1: slots in use; 2: the first step that needed more slots or splats than
// exist (it and all later steps do nothing until the host has made room); 3 and 4: slots and splats it needed.
@compute @workgroup_size(1)
fn check_capacity() {
    let total = starts[u.count];
    let splat_count = shown();
    state[0] = u.count;
    if (state[2] == 0u && (total > u.capacity || splat_count > u.most_splats)) {
        state[2] = u.step;
        state[3] = total;
        state[4] = splat_count;
    }
    state[1] = select(0u, total, state[2] == 0u);
}

@compute @workgroup_size(64)
fn emit(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let rank = group_index(group) * 64u + lane;
    if (rank >= u.count || state[1] == 0u) {
        return;
    }
    var at = starts[rank];
    let end = starts[rank + 1u];
    if (at == end) {
        return;
    }
    let s = splats[rank];
    let columns = range_of(s.columns);
    let rows = range_of(s.rows);
    for (var ty = rows.x; ty < rows.y; ty++) {
        for (var tx = columns.x; tx < columns.y; tx++) {
            // `project` counted with the same function, but its compilation may round differently:
            // never write past the count.
            if (at < end && touches(s, tx, ty)) {
                slot_tiles[at] = ty * u.tiles_x + tx;
                slot_ids[at] = rank;
                at++;
            }
        }
    }
    // For the same reason slots may be left over: they belong to no tile and sort last.
    for (; at < end; at++) {
        slot_tiles[at] = u.tiles_x * u.tiles_y;
        slot_ids[at] = rank;
    }
}

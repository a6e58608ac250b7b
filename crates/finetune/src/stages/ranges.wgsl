// Stage `ranges`: makes the tiles' lists from the slots sorted by tile, and stores the position of
// each slot in the lists.

@group(0) @binding(1) var<storage, read> state: array<u32>;
@group(0) @binding(2) var<storage, read> tile_keys: array<u32>;
@group(0) @binding(3) var<storage, read> tile_slots: array<u32>;
@group(0) @binding(4) var<storage, read> slot_ids: array<u32>;
@group(0) @binding(5) var<storage, read_write> ids: array<u32>;
@group(0) @binding(6) var<storage, read_write> list_positions: array<u32>;
@group(0) @binding(7) var<storage, read_write> offsets: array<u32>;

@compute @workgroup_size(64)
fn ranges(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let k = group_index(group) * 64u + lane;
    let n = state[1];
    if (k < n) {
        ids[k] = slot_ids[tile_slots[k]];
        list_positions[tile_slots[k]] = k;
    }
    // The start of tile k: the first slot whose tile is at least k.
    if (k <= u.tiles_x * u.tiles_y) {
        var low = 0u;
        var high = n;
        while (low < high) {
            let middle = (low + high) / 2u;
            if (tile_keys[middle] < k) {
                low = middle + 1u;
            } else {
                high = middle;
            }
        }
        offsets[k] = low;
    }
}

// Stage `emit`: one (tile, slot) pair per Gaussian and tile that it touches, in depth order. The entry point runs
// twice: it counts the pairs, and after the scan of the counts it writes them. The compiler of a GPU may fuse products
// and sums in each entry point differently, and two of them would not find the same tiles.

struct Mode {
    // 1 if the pairs are written, 0 if they are counted.
    writes: u32,
    pad0: u32,
    pad1: u32,
    pad2: u32,
}

@group(0) @binding(1) var<storage, read> splats: array<Splat>;
// The counts, then a zero. After the scan: the first slot of each Gaussian, then the number of slots.
@group(0) @binding(2) var<storage, read_write> starts: array<u32>;
@group(0) @binding(3) var<storage, read> depth_keys_b: array<u32>;
@group(0) @binding(4) var<storage, read_write> state: array<u32>;
@group(0) @binding(5) var<storage, read_write> slot_tiles: array<u32>;
@group(0) @binding(6) var<storage, read_write> slot_ids: array<u32>;
@group(0) @binding(7) var<uniform> mode: Mode;

// First tile and one past the last, of packed columns or rows.
fn range_of(packed: u32) -> vec2<u32> {
    return vec2<u32>(packed & 0xffffu, packed >> 16u);
}

// Whether the splat reaches a pixel centre of tile (tx, ty).
fn touches(s: Splat, tx: u32, ty: u32) -> bool {
    if (u.reference == 1u) {
        return true;
    }
    let edge = f32(TILE - 1u);
    let dx1 = s.a.x - (f32(tx * TILE) + 0.5);
    let dy1 = s.a.y - (f32(ty * TILE) + 0.5);
    let least = least_sigma(s.a.z, s.a.w, s.b.x, dx1 - edge, dx1, dy1 - edge, dy1);
    return least <= s.b.y;
}

// The Gaussians that the band shows: those whose key is not that of the culled ones.
fn shown() -> u32 {
    var low = 0u;
    var high = u.count;
    while (low < high) {
        let middle = (low + high) / 2u;
        if (depth_keys_b[middle] != CULLED) {
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
    let writes = mode.writes == 1u;
    if (rank > u.count || (writes && state[1] == 0u)) {
        return;
    }
    let first = starts[rank];
    var n = 0u;
    if (rank < min(u.count, u.most_splats) && depth_keys_b[rank] != CULLED) {
        let s = splats[rank];
        let columns = range_of(s.columns);
        let rows = range_of(s.rows);
        for (var ty = rows.x; ty < rows.y; ty++) {
            for (var tx = columns.x; tx < columns.y; tx++) {
                if (!touches(s, tx, ty)) {
                    continue;
                }
                if (writes) {
                    slot_tiles[first + n] = ty * u.tiles_x + tx;
                    slot_ids[first + n] = rank;
                }
                n++;
            }
        }
    }
    if (!writes) {
        starts[rank] = n;
    }
}

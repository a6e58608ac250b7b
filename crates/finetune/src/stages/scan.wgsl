// Exclusive prefix sums in place, 1024 values per workgroup. The next level scans the totals of the
// workgroups, and they are added back.

struct Level {
    length: u32,
    pad0: u32,
    pad1: u32,
    pad2: u32,
}

@group(0) @binding(1) var<uniform> level: Level;
@group(0) @binding(2) var<storage, read_write> values: array<u32>;
@group(0) @binding(3) var<storage, read_write> totals: array<u32>;

var<workgroup> sums: array<u32, 256>;

@compute @workgroup_size(256)
fn scan_local(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let block = group_index(group);
    let first = block * 1024u + lane * 4u;
    var v = vec4<u32>();
    for (var k = 0u; k < 4u; k++) {
        if (first + k < level.length) {
            v[k] = values[first + k];
        }
    }
    sums[lane] = v.x + v.y + v.z + v.w;
    workgroupBarrier();
    for (var offset = 1u; offset < 256u; offset *= 2u) {
        var before = 0u;
        if (lane >= offset) {
            before = sums[lane - offset];
        }
        workgroupBarrier();
        sums[lane] += before;
        workgroupBarrier();
    }
    var running = 0u;
    if (lane > 0u) {
        running = sums[lane - 1u];
    }
    for (var k = 0u; k < 4u; k++) {
        if (first + k < level.length) {
            values[first + k] = running;
        }
        running += v[k];
    }
    if (lane == 255u && first < level.length + 1024u) {
        totals[block] = sums[255];
    }
}

@compute @workgroup_size(256)
fn scan_add(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let block = group_index(group);
    let first = block * 1024u + lane * 4u;
    for (var k = 0u; k < 4u; k++) {
        if (first + k < level.length) {
            values[first + k] += totals[block];
        }
    }
}

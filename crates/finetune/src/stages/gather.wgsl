// Stage `gather`: sums the records of the slots of a page's Gaussians in the order of emission. Bands follow each
// other from top to bottom, so the order is that of a view without bands. With TOTALS, the sums of the stage `removal` over
// all views: those of a view count u.view_weight times.

@group(0) @binding(1) var<storage, read> state: array<u32>;
@group(0) @binding(2) var<storage, read> order: array<u32>;
@group(0) @binding(3) var<storage, read> starts: array<u32>;
@group(0) @binding(4) var<storage, read> list_positions: array<u32>;
@group(0) @binding(5) var<storage, read> records: array<f32>;
// Sums per Gaussian; after them, 1.0 if the step is void.
@group(0) @binding(6) var<storage, read_write> sums: array<f32>;
@group(0) @binding(7) var<storage, read> splats: array<Splat>;

@compute @workgroup_size(64)
fn gather(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let rank = group_index(group) * 64u + lane;
    if (rank == 0u) {
        sums[SUMS * page.count] = select(0.0, 1.0, state[2] != 0u);
    }
    if (rank >= u.count || state[2] != 0u) {
        return;
    }
    let i = order[rank] - page.first;
    let first = starts[rank];
    let end = starts[rank + 1u];
    let begins = !TOTALS && u.first_row == 0u;
    // Of another page; numbers before `first` wrap around.
    if (i >= page.count || (first == end && !begins)) {
        return;
    }
    //@each c EACH_SUM
    var s$c = 0.0;
    if (!begins) {
        s$c = sums[SUMS * i + $cu];
    }
    //@end
    for (var k = first; k < end; k++) {
        let at = SUMS * list_positions[k];
        //@each c EACH_SUM
        s$c += select(records[at + $cu], u.view_weight * records[at + $cu], TOTALS);
        //@end
    }
    //@each _ OF_STEP
    if (first != end) {
        // The gradient of a colour that was clamped at zero is zero.
        let colour = splats[rank].c;
        s0 = select(0.0, s0, colour.x > 0.0);
        s1 = select(0.0, s1, colour.y > 0.0);
        s2 = select(0.0, s2, colour.z > 0.0);
    }
    //@end
    //@each c EACH_SUM
    sums[SUMS * i + $cu] = s$c;
    //@end
}

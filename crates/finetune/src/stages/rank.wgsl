// Stage `rank`: splats and tile counts of a page's Gaussians in depth order. What follows does not know pages.

@group(0) @binding(1) var<storage, read> order: array<u32>;
@group(0) @binding(2) var<storage, read> page_splats: array<Splat>;
@group(0) @binding(3) var<storage, read> page_counts: array<u32>;
@group(0) @binding(4) var<storage, read_write> splats: array<Splat>;
// The counts; behind them a zero, so that the scan ends with the total.
@group(0) @binding(5) var<storage, read_write> starts: array<u32>;

@compute @workgroup_size(64)
fn rank(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let rank = group_index(group) * 64u + lane;
    if (rank == u.count) {
        starts[rank] = 0u;
    }
    if (rank >= u.count) {
        return;
    }
    let i = order[rank] - page.first;
    // Of another page; numbers before `first` wrap around.
    if (i >= page.count) {
        return;
    }
    let n = page_counts[i];
    starts[rank] = n;
    if (n != 0u && rank < u.most_splats) {
        splats[rank] = page_splats[i];
    }
}

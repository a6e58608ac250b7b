// Stage `rank`: splats of a page's Gaussians in depth order. What follows does not know pages.

@group(0) @binding(1) var<storage, read> order: array<u32>;
@group(0) @binding(2) var<storage, read> page_splats: array<Splat>;
@group(0) @binding(3) var<storage, read> depth_keys_b: array<u32>;
@group(0) @binding(4) var<storage, read_write> splats: array<Splat>;

@compute @workgroup_size(64)
fn rank(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let rank = group_index(group) * 64u + lane;
    if (rank >= min(u.count, u.most_splats) || depth_keys_b[rank] == CULLED) {
        return;
    }
    let i = order[rank] - page.first;
    // Not of another page; numbers before `first` wrap around.
    if (i < page.count) {
        splats[rank] = page_splats[i];
    }
}

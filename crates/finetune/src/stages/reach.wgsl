// Second half of the stage `ranges`: which blocks of its tile each splat of the lists reaches. A
// splat has a byte, with a bit per block; a lane writes a word, four splats. The Rust executor skips
// rows instead.

@group(0) @binding(1) var<storage, read> state: array<u32>;
@group(0) @binding(2) var<storage, read> tile_keys: array<u32>;
@group(0) @binding(3) var<storage, read> ids: array<u32>;
@group(0) @binding(4) var<storage, read> splats: array<Splat>;
@group(0) @binding(5) var<storage, read_write> hits: array<u32>;

@compute @workgroup_size(64)
fn reach(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let word = group_index(group) * 64u + lane;
    let n = state[1];
    if (4u * word >= n) {
        return;
    }
    //@each k 0 1 2 3
    let at_$k = min(4u * word + $ku, n - 1u);
    let tile_$k = tile_keys[at_$k];
    let s_$k = splats[ids[at_$k]];
    let x_$k = (tile_$k % u.tiles_x) * TILE;
    let y_$k = (tile_$k / u.tiles_x) * TILE;
    //@end
    let p = vec4<f32>(s_0.a.z, s_1.a.z, s_2.a.z, s_3.a.z);
    let q = vec4<f32>(s_0.a.w, s_1.a.w, s_2.a.w, s_3.a.w);
    let r = vec4<f32>(s_0.b.x, s_1.b.x, s_2.b.x, s_3.b.x);
    let cut = vec4<f32>(s_0.b.y, s_1.b.y, s_2.b.y, s_3.b.y);
    let x = vec4<f32>(s_0.a.x, s_1.a.x, s_2.a.x, s_3.a.x);
    let y = vec4<f32>(s_0.a.y, s_1.a.y, s_2.a.y, s_3.a.y);
    // The tiles' first pixel centres.
    let left = vec4<f32>(vec4<u32>(x_0, x_1, x_2, x_3)) + vec4<f32>(0.5);
    let top = vec4<f32>(vec4<u32>(y_0, y_1, y_2, y_3)) + vec4<f32>(0.5);
    var bytes = vec4<u32>();
    //@each block 0 1 2 3 4 5 6 7
    let dx_$block = x - (left + f32($block / 4 * 8));
    let dy_$block = y - (top + f32($block % 4 * 4));
    let least_$block =
        least_sigma(p, q, r, dx_$block - 7.0, dx_$block, dy_$block - 3.0, dy_$block);
    bytes |= select(vec4<u32>(), vec4<u32>(1u << $blocku), least_$block <= cut);
    //@end
    hits[word] = bytes.x | (bytes.y << 8u) | (bytes.z << 16u) | (bytes.w << 24u);
}

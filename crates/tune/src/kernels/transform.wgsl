// Stage `transform`: one level of the forward RAHT, on means and differences.

@group(0) @binding(1) var<uniform> codec: Codec;
@group(0) @binding(2) var<uniform> call: Call;
@group(0) @binding(3) var<storage, read> merges: array<Merge>;
@group(0) @binding(4) var<storage, read_write> latent_rows: array<f32>;

@compute @workgroup_size(64)
fn transform(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let groups = groups_of_pass(call.pass_index, codec.sh_degree);
    let task = group_index(group) * 64u + lane;
    if (task >= call.count * groups) {
        return;
    }
    let merge = merges[call.first + task / groups];
    let g = group_of_pass(call.pass_index, task % groups);
    let first = first_channel(g, codec.channels);
    let left = merge.left * codec.channels + first;
    let right = merge.right * codec.channels + first;
    for (var c = 0u; c < channels_of(g); c++) {
        let difference = latent_rows[right + c] - latent_rows[left + c];
        latent_rows[left + c] += difference * merge.share;
        latent_rows[right + c] = difference;
    }
}

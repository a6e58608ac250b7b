// Stage `transform`: one level of the forward RAHT, on means and differences.

@group(0) @binding(1) var<uniform> codec: Codec;
@group(0) @binding(2) var<uniform> call: Call;
@group(0) @binding(3) var<storage, read> merges: array<Merge>;
@group(0) @binding(4) var<storage, read_write> latent_rows: array<f32>;

@compute @workgroup_size(64)
fn transform(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let task = group_index(group) * 64u + lane;
    if (task >= call.count * call.groups) {
        return;
    }
    let merge = merges[call.first + task / call.groups];
    let own = codec.groups[call.first_group + task % call.groups];
    let left = merge.left * codec.channels + own.first;
    let right = merge.right * codec.channels + own.first;
    for (var c = 0u; c < own.channels; c++) {
        let difference = latent_rows[right + c] - latent_rows[left + c];
        latent_rows[left + c] += difference * merge.share;
        latent_rows[right + c] = difference;
    }
}

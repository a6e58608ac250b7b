// Stage `blend_adjoint`: one record of nine sums per slot, with the lanes as in block.wgsl. A lane
// adds up its pixels in registers and stores a sum per splat in workgroup memory. Then the lanes
// add up the columns of a block and the blocks, in the fixed order of blend_adjoint.rs.

@group(0) @binding(1) var<storage, read> splats: array<Splat>;
@group(0) @binding(2) var<storage, read> ids: array<u32>;
@group(0) @binding(3) var<storage, read> offsets: array<u32>;
// Per tile: gradients with respect to red, green, blue, 256 each.
@group(0) @binding(6) var<storage, read> gradient: array<f32>;

fn gradients_at(at: u32) -> vec4<f32> {
    return vec4<f32>(
        gradient[at], gradient[at + TILE], gradient[at + 2u * TILE], gradient[at + 3u * TILE],
    );
}

// Colour over the background, dotted with the gradient.
fn light(at: u32, g_red: vec4<f32>, g_green: vec4<f32>, g_blue: vec4<f32>) -> vec4<f32> {
    let t = abs(pixels_at(at + 768u));
    let tr = t * u.background.x;
    let tg = t * u.background.y;
    let tb = t * u.background.z;
    let red = pixels_at(at) + tr;
    let green = pixels_at(at + 256u) + tg;
    let blue = pixels_at(at + 512u) + tb;
    let mr = red * g_red;
    let mg = green * g_green;
    let mb = blue * g_blue;
    let mrg = mr + mg;
    return mrg + mb;
}

@compute @workgroup_size(TILE_LANES)
fn blend_adjoint(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let tiles = u.end_row * u.tiles_x;
    let wanted = u.first_row * u.tiles_x + group_index(group);
    let tile = min(wanted, tiles - 1u);
    let block = lane / 4u;
    let columns = columns_of(tile, lane);
    let y = columns.y;
    //@each side l r
    let x_$side = f32(columns.$side) + 0.5;
    var t_$side = start_of(columns.$side, columns.rows);
    let red_$side = gradients_at(tile * 768u + columns.at_$side);
    let green_$side = gradients_at(tile * 768u + columns.at_$side + 256u);
    let blue_$side = gradients_at(tile * 768u + columns.at_$side + 512u);
    var rg_$side = light(tile * 1024u + columns.at_$side, red_$side, green_$side, blue_$side);
    //@end
    // Tiles past the last have empty lists.
    let first = offsets[tile];
    let list_end = select(first, offsets[tile + 1u], wanted < tiles);
    let count = needed_of(tile, lane);
    let end = min(first + count, list_end);
    for (var begin = 0u; begin < count; begin += RECORD_BATCH) {
        let start = first + begin;
        let n = min(RECORD_BATCH, max(end, start) - start);
        var mask = reaching(start, n, block);
        while (mask != 0u) {
            let k = firstTrailingBit(mask);
            mask &= mask - 1u;
            let s = splats[ids[start + k]];
            let cut = vec4<f32>(s.b.y);
            let opacity = vec4<f32>(s.b.z);
            let dy = s.a.y - y;
            let qy = s.a.w * dy;
            let e1 = s.b.x * dy;
            let e11 = e1 * e1;
            //@each side l r
            let px_$side = s.a.z * (s.a.x - x_$side);
            let e0_$side = px_$side + qy;
            let cr_$side = s.c.x * red_$side;
            let cgr_$side = s.c.y * green_$side;
            let cb_$side = s.c.z * blue_$side;
            let crg_$side = cr_$side + cgr_$side;
            let cg_$side = crg_$side + cb_$side;
            let step_$side = replay(e0_$side, e1, cut, opacity, STOP, t_$side, rg_$side, cg_$side);
            t_$side = step_$side.t;
            rg_$side = step_$side.rg;
            let v_$side = step_$side.v_sigma;
            let v0_$side = v_$side * e0_$side;
            let sum0$side = sum_rows(step_$side.w * red_$side);
            let sum1$side = sum_rows(step_$side.w * green_$side);
            let sum2$side = sum_rows(step_$side.w * blue_$side);
            let sum3$side = sum_rows(v_$side);
            let sum4$side = sum_rows(v0_$side * e0_$side);
            let sum5$side = sum_rows(v0_$side * e1);
            let sum6$side = sum_rows(v_$side * e11);
            let sum7$side = sum_rows(v0_$side);
            let sum8$side = sum_rows(v_$side * e1);
            //@end
            //@each sum EACH_SUM
            sums[(k * SUMS + $sumu) * (TILE_LANES + 1u) + lane] = sum$suml + sum$sumr;
            //@end
        }
        workgroupBarrier();
        store_records(start, n, lane);
        workgroupBarrier();
    }
    clear_records(end, list_end, lane);
}

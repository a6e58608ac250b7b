// Stage `blend`, with the lanes as in block.wgsl.

@group(0) @binding(1) var<storage, read> splats: array<Splat>;
@group(0) @binding(2) var<storage, read> ids: array<u32>;
@group(0) @binding(3) var<storage, read> offsets: array<u32>;
// Per tile: red, green, blue, transmittance, 256 each, row-major.
@group(0) @binding(4) var<storage, read_write> pixels: array<f32>;
// Per lane: the leading splats of the tile's list that some pixel may have blended.
@group(0) @binding(5) var<storage, read_write> last: array<u32>;

// Per position in the lists, a byte: which blocks the splat reaches.
@group(0) @binding(6) var<storage, read> hits: array<u32>;

const BATCH: u32 = 32u;

fn store(at: u32, v: vec4<f32>) {
    pixels[at] = v.x;
    pixels[at + TILE] = v.y;
    pixels[at + 2u * TILE] = v.z;
    pixels[at + 3u * TILE] = v.w;
}

@compute @workgroup_size(TILE_LANES)
fn blend(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let tile = u.first_row * u.tiles_x + group_index(group);
    if (tile >= u.end_row * u.tiles_x) {
        return;
    }
    let block = lane / 4u;
    let columns = columns_of(tile, lane);
    let y = columns.y;
    //@each side l r
    let x_$side = f32(columns.$side) + 0.5;
    var t_$side = start_of(columns.$side, columns.rows);
    var red_$side = vec4<f32>();
    var green_$side = vec4<f32>();
    var blue_$side = vec4<f32>();
    //@end
    let first = offsets[tile];
    let end = offsets[tile + 1u];
    var done = 0u;
    for (var start = first; start < end; start += BATCH) {
        let n = min(BATCH, end - start);
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
            //@each side l r
            let px_$side = s.a.z * (s.a.x - x_$side);
            let e0_$side = px_$side + qy;
            let step_$side = gate(e0_$side, e1, cut, opacity, STOP, t_$side);
            let r_$side = step_$side.w * s.c.x;
            let g_$side = step_$side.w * s.c.y;
            let b_$side = step_$side.w * s.c.z;
            red_$side += r_$side;
            green_$side += g_$side;
            blue_$side += b_$side;
            t_$side = step_$side.t;
            //@end
        }
        done += n;
        if (!any(max(t_l, t_r) > vec4<f32>(0.0))) {
            break;
        }
    }
    last[tile * TILE_LANES + lane] = done;
    //@each side l r
    let at_$side = tile * 1024u + columns.at_$side;
    store(at_$side, red_$side);
    store(at_$side + 256u, green_$side);
    store(at_$side + 512u, blue_$side);
    store(at_$side + 768u, t_$side);
    //@end
}

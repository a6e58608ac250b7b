// Stage `blend`, with the lanes as in block.wgsl.

@group(0) @binding(1) var<storage, read> splats: array<Splat>;
@group(0) @binding(2) var<storage, read> ids: array<u32>;
@group(0) @binding(3) var<storage, read> offsets: array<u32>;
// Per tile: red, green, blue, transmittance, 256 each, row-major.
@group(0) @binding(4) var<storage, read_write> pixels: array<f32>;
// Per block: the leading splats of the tile's list that some pixel may have blended.
@group(0) @binding(5) var<storage, read_write> last: array<u32>;

// Per position in the lists, a byte: which blocks the splat reaches.
@group(0) @binding(6) var<storage, read> hits: array<u32>;

const BATCH: u32 = 32u;

fn store(at: u32, v: vec4<f32>) {
    pixels[at] = v.x;
    pixels[at + 1u] = v.y;
    pixels[at + 2u] = v.z;
    pixels[at + 3u] = v.w;
}

@compute @workgroup_size(32)
fn blend(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let tile = u.first_row * u.tiles_x + group_index(group) * TILES + lane / BLOCKS;
    if (tile >= u.end_row * u.tiles_x) {
        return;
    }
    let block = lane % BLOCKS;
    let pixel = corner_of(tile, block);
    let corner = vec2<f32>(pixel);
    let column_l = vec4<u32>(pixel.x) + vec4<u32>(0u, 1u, 2u, 3u);
    let column_r = column_l + vec4<u32>(4u);
    let x_l = vec4<f32>(column_l) + vec4<f32>(0.5);
    let x_r = vec4<f32>(column_r) + vec4<f32>(0.5);
    //@each row 0 1 2 3
    //@each side l r
    var t_$row$side = start_of(column_$side, pixel.y + $rowu);
    var red_$row$side = vec4<f32>();
    var green_$row$side = vec4<f32>();
    var blue_$row$side = vec4<f32>();
    //@end
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
            let px_l = s.a.z * (s.a.x - x_l);
            let px_r = s.a.z * (s.a.x - x_r);
            //@each row 0 1 2 3
            let dy_$row = s.a.y - (corner.y + $row.5);
            let qy_$row = vec4<f32>(s.a.w * dy_$row);
            let e1_$row = vec4<f32>(s.b.x * dy_$row);
            //@each side l r
            let e0_$row$side = px_$side + qy_$row;
            let step_$row$side = gate(e0_$row$side, e1_$row, cut, opacity, STOP, t_$row$side);
            let r_$row$side = step_$row$side.w * s.c.x;
            let g_$row$side = step_$row$side.w * s.c.y;
            let b_$row$side = step_$row$side.w * s.c.z;
            red_$row$side += r_$row$side;
            green_$row$side += g_$row$side;
            blue_$row$side += b_$row$side;
            t_$row$side = step_$row$side.t;
            //@end
            //@end
        }
        done += n;
        var live = t_0l;
        //@each pixels 0r 1l 1r 2l 2r 3l 3r
        live = max(live, t_$pixels);
        //@end
        if (!any(live > vec4<f32>(0.0))) {
            break;
        }
    }
    last[tile * BLOCKS + block] = done;
    let base = tile * 1024u + offset_of(block);
    //@each row 0 1 2 3
    let at_$rowl = base + $rowu * TILE;
    let at_$rowr = at_$rowl + 4u;
    //@each side l r
    store(at_$row$side, red_$row$side);
    store(at_$row$side + 256u, green_$row$side);
    store(at_$row$side + 512u, blue_$row$side);
    store(at_$row$side + 768u, t_$row$side);
    //@end
    //@end
}

// Stage `blend_adjoint`: one record of seven sums per slot, with the lanes as in block.wgsl. A lane
// adds up its block's pixels in registers and stores a sum per splat in workgroup memory. Then the
// lanes of a tile add up the blocks, in the fixed order of blend_adjoint.rs.

@group(0) @binding(1) var<storage, read> splats: array<Splat>;
@group(0) @binding(2) var<storage, read> ids: array<u32>;
@group(0) @binding(3) var<storage, read> offsets: array<u32>;
@group(0) @binding(4) var<storage, read> pixels: array<f32>;
// Per block, as `blend` left it.
@group(0) @binding(5) var<storage, read> last: array<u32>;
// Per tile: gradients with respect to red, green, blue, 256 each.
@group(0) @binding(6) var<storage, read> gradient: array<f32>;
@group(0) @binding(7) var<storage, read_write> records: array<f32>;
// Per position in the lists, a byte: which blocks the splat reaches.
@group(0) @binding(8) var<storage, read> hits: array<u32>;

// Per tile of the workgroup, splat of the batch, sum, block.
var<workgroup> sums: array<f32, RECORD_WORDS>;
var<workgroup> longest: atomic<u32>;
var<workgroup> rounds: u32;

fn gradients_at(at: u32) -> vec4<f32> {
    return vec4<f32>(gradient[at], gradient[at + 1u], gradient[at + 2u], gradient[at + 3u]);
}

fn pixels_at(at: u32) -> vec4<f32> {
    return vec4<f32>(pixels[at], pixels[at + 1u], pixels[at + 2u], pixels[at + 3u]);
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

// Eight columns, halves onto halves.
fn sum_columns(l: vec4<f32>, r: vec4<f32>) -> f32 {
    let four = l + r;
    let two = four.xy + four.zw;
    return two.x + two.y;
}

@compute @workgroup_size(32)
fn blend_adjoint(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let tiles = u.end_row * u.tiles_x;
    let wanted = u.first_row * u.tiles_x + group_index(group) * TILES + lane / BLOCKS;
    let tile = min(wanted, tiles - 1u);
    let block = lane % BLOCKS;
    let pixel = corner_of(tile, block);
    let corner = vec2<f32>(pixel);
    let column_l = vec4<u32>(pixel.x) + vec4<u32>(0u, 1u, 2u, 3u);
    let column_r = column_l + vec4<u32>(4u);
    let x_l = vec4<f32>(column_l) + vec4<f32>(0.5);
    let x_r = vec4<f32>(column_r) + vec4<f32>(0.5);
    let g_at = tile * 768u + offset_of(block);
    let p_at = tile * 1024u + offset_of(block);
    //@each row 0 1 2 3
    let at_$rowl = $rowu * TILE;
    let at_$rowr = $rowu * TILE + 4u;
    //@each side l r
    var t_$row$side = start_of(column_$side, pixel.y + $rowu);
    let red_$row$side = gradients_at(g_at + at_$row$side);
    let green_$row$side = gradients_at(g_at + at_$row$side + 256u);
    let blue_$row$side = gradients_at(g_at + at_$row$side + 512u);
    var rg_$row$side =
        light(p_at + at_$row$side, red_$row$side, green_$row$side, blue_$row$side);
    //@end
    //@end
    // Tiles past the last have empty lists.
    let first = offsets[tile];
    let list_end = select(first, offsets[tile + 1u], wanted < tiles);
    var tile_last = 0u;
    for (var b = 0u; b < BLOCKS; b++) {
        tile_last = max(tile_last, last[tile * BLOCKS + b]);
    }
    let end = min(first + tile_last, list_end);
    atomicMax(&longest, end - first);
    workgroupBarrier();
    if (lane == 0u) {
        rounds = (atomicLoad(&longest) + RECORD_BATCH - 1u) / RECORD_BATCH;
    }
    let last_round = workgroupUniformLoad(&rounds);
    let of_tile = (lane / BLOCKS) * RECORD_BATCH * 7u * BLOCKS;
    for (var round = 0u; round < last_round; round++) {
        let start = first + round * RECORD_BATCH;
        let n = min(RECORD_BATCH, max(end, start) - start);
        var mask = reaching(start, n, block);
        while (mask != 0u) {
            let k = firstTrailingBit(mask);
            mask &= mask - 1u;
            let s = splats[ids[start + k]];
            let cut = vec4<f32>(s.b.y);
            let opacity = vec4<f32>(s.b.z);
            let px_l = s.a.z * (s.a.x - x_l);
            let px_r = s.a.z * (s.a.x - x_r);
            //@each side l r
            //@each sum 0 1 2 3 4 5 6
            var sum$sum$side = vec4<f32>();
            //@end
            //@end
            //@each row 0 1 2 3
            let dy_$row = s.a.y - (corner.y + $row.5);
            let qy_$row = vec4<f32>(s.a.w * dy_$row);
            let e1_$row = vec4<f32>(s.b.x * dy_$row);
            let e11_$row = e1_$row * e1_$row;
            //@each side l r
            let e0_$row$side = px_$side + qy_$row;
            let cr_$row$side = s.c.x * red_$row$side;
            let cgr_$row$side = s.c.y * green_$row$side;
            let cb_$row$side = s.c.z * blue_$row$side;
            let crg_$row$side = cr_$row$side + cgr_$row$side;
            let cg_$row$side = crg_$row$side + cb_$row$side;
            let step_$row$side = replay(
                e0_$row$side,
                e1_$row,
                cut,
                opacity,
                STOP,
                t_$row$side,
                rg_$row$side,
                cg_$row$side,
            );
            t_$row$side = step_$row$side.t;
            rg_$row$side = step_$row$side.rg;
            let v_$row$side = step_$row$side.v_sigma;
            let v0_$row$side = v_$row$side * e0_$row$side;
            let wr_$row$side = step_$row$side.w * red_$row$side;
            let wg_$row$side = step_$row$side.w * green_$row$side;
            let wb_$row$side = step_$row$side.w * blue_$row$side;
            let v00_$row$side = v0_$row$side * e0_$row$side;
            let v01_$row$side = v0_$row$side * e1_$row;
            let v11_$row$side = v_$row$side * e11_$row;
            sum0$side += wr_$row$side;
            sum1$side += wg_$row$side;
            sum2$side += wb_$row$side;
            sum3$side += v_$row$side;
            sum4$side += v00_$row$side;
            sum5$side += v01_$row$side;
            sum6$side += v11_$row$side;
            //@end
            //@end
            let slot = of_tile + k * 7u * BLOCKS + block;
            //@each sum 0 1 2 3 4 5 6
            sums[slot + $sumu * BLOCKS] = sum_columns(sum$suml, sum$sumr);
            //@end
        }
        workgroupBarrier();
        for (var j = block; j < n * 7u; j += BLOCKS) {
            let position = start + j / 7u;
            var bits = (hits[position / 4u] >> (8u * (position % 4u))) & 255u;
            var left = 0.0;
            var right = 0.0;
            while (bits != 0u) {
                let b = firstTrailingBit(bits);
                bits &= bits - 1u;
                let v = sums[of_tile + j * BLOCKS + b];
                left += select(v, 0.0, b >= 4u);
                right += select(0.0, v, b >= 4u);
            }
            records[start * 7u + j] = left + right;
        }
        workgroupBarrier();
    }
    // Slots behind the last one that a pixel needs.
    for (var j = end * 7u + block; j < list_end * 7u; j += BLOCKS) {
        records[j] = 0.0;
    }
}

// Stage `removal`: per slot, the squared change of the tile's pixels without the splat, and its squared blending weights. The
// order of the sums is that of records.wgsl, not that of removal.rs.

@group(0) @binding(1) var<storage, read> splats: array<Splat>;
@group(0) @binding(2) var<storage, read> ids: array<u32>;
@group(0) @binding(3) var<storage, read> offsets: array<u32>;

@compute @workgroup_size(TILE_LANES)
fn removal(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let tiles = u.end_row * u.tiles_x;
    let wanted = u.first_row * u.tiles_x + group_index(group);
    let tile = min(wanted, tiles - 1u);
    let block = lane / 4u;
    let columns = columns_of(tile, lane);
    let y = columns.y;
    // The light of this and all later splats and the background.
    //@each side l r
    let x_$side = f32(columns.$side) + 0.5;
    var t_$side = start_of(columns.$side, columns.rows);
    let at_$side = tile * 1024u + columns.at_$side;
    let end_$side = abs(pixels_at(at_$side + 768u));
    //@each c 0 1 2
    var rest$c$side = pixels_at(at_$side + 256u * $cu) + end_$side * u.background[$c];
    //@end
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
            //@each side l r
            let px_$side = s.a.z * (s.a.x - x_$side);
            let e0_$side = px_$side + qy;
            let step_$side = gate(e0_$side, e1, cut, opacity, STOP, t_$side);
            t_$side = step_$side.t;
            let alpha_$side = select(vec4<f32>(), step_$side.alpha, step_$side.counts);
            let clear_$side = 1.0 - alpha_$side;
            var squares_$side = vec4<f32>();
            //@each c 0 1 2
            let shown$c$side = step_$side.w * s.c[$c];
            rest$c$side -= shown$c$side;
            let change$c$side = alpha_$side * rest$c$side / clear_$side - shown$c$side;
            squares_$side += change$c$side * change$c$side;
            //@end
            let sum0$side = sum_rows(squares_$side);
            let sum1$side = sum_rows(step_$side.w * step_$side.w);
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

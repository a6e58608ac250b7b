// Stage `blend_adjoint`: one record of seven sums per slot. One workgroup per tile, 32 lanes
// with half a column each. A lane keeps its partial sums of RECORD_BATCH splats in workgroup memory;
// then each lane adds up some of the (splat, sum) pairs over the lanes, in the fixed order of
// `sum_lanes` in Rust.

@group(0) @binding(1) var<storage, read> splats: array<Splat>;
@group(0) @binding(2) var<storage, read> ids: array<u32>;
@group(0) @binding(3) var<storage, read> offsets: array<u32>;
@group(0) @binding(4) var<storage, read> pixels: array<f32>;
@group(0) @binding(5) var<storage, read> last: array<u32>;
// Per tile: gradients with respect to red, green, blue, 256 each.
@group(0) @binding(6) var<storage, read> gradient: array<f32>;
@group(0) @binding(7) var<storage, read_write> records: array<f32>;

const LANES: u32 = 32u;
// Lanes of one sum, padded by one so that lanes hit different banks.
const STRIDE: u32 = 33u;

var<workgroup> batch: array<Splat, RECORD_BATCH>;
var<workgroup> partial: array<f32, RECORD_WORDS>;

fn column(base: u32) -> vec4<f32> {
    return vec4<f32>(
        gradient[base],
        gradient[base + TILE],
        gradient[base + 2u * TILE],
        gradient[base + 3u * TILE],
    );
}

fn column_of_pixels(base: u32) -> vec4<f32> {
    return vec4<f32>(
        pixels[base],
        pixels[base + TILE],
        pixels[base + 2u * TILE],
        pixels[base + 3u * TILE],
    );
}

// Colour over the background, dotted with the gradient.
fn light(at: u32, g_red: vec4<f32>, g_green: vec4<f32>, g_blue: vec4<f32>) -> vec4<f32> {
    let t = abs(column_of_pixels(at + 768u));
    let tr = t * u.background.x;
    let tg = t * u.background.y;
    let tb = t * u.background.z;
    let red = column_of_pixels(at) + tr;
    let green = column_of_pixels(at + 256u) + tg;
    let blue = column_of_pixels(at + 512u) + tb;
    let mr = red * g_red;
    let mg = green * g_green;
    let mb = blue * g_blue;
    let mrg = mr + mg;
    return mrg + mb;
}

// Adds the rows of both halves of a lane's column to `sum`, top to bottom.
fn add_rows(sum: f32, a: vec4<f32>, b: vec4<f32>) -> f32 {
    let s0 = sum + a.x;
    let s1 = s0 + a.y;
    let s2 = s1 + a.z;
    let s3 = s2 + a.w;
    let s4 = s3 + b.x;
    let s5 = s4 + b.y;
    let s6 = s5 + b.z;
    return s6 + b.w;
}

@compute @workgroup_size(32)
fn blend_adjoint(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let tile = group_index(group);
    if (tile >= u.tiles_x * u.tiles_y) {
        return;
    }
    let x0 = (tile % u.tiles_x) * TILE;
    let y0 = (tile / u.tiles_x) * TILE;
    let x = lane % TILE;
    let row = (lane / TILE) * 8u;
    let px = f32(x0 + x) + 0.5;
    let below = vec4<u32>(0u, 1u, 2u, 3u);
    let row_a = vec4<u32>(y0 + row) + below;
    let row_b = row_a + vec4<u32>(4u);
    let py_a = vec4<f32>(row_a) + vec4<f32>(0.5);
    let py_b = vec4<f32>(row_b) + vec4<f32>(0.5);
    let within = x0 + x < u.width;
    let on_a = vec4<bool>(within) & (row_a < vec4<u32>(u.height));
    let on_b = vec4<bool>(within) & (row_b < vec4<u32>(u.height));
    var t_a = select(vec4<f32>(-1.0), vec4<f32>(1.0), on_a);
    var t_b = select(vec4<f32>(-1.0), vec4<f32>(1.0), on_b);
    let at = row * TILE + x;
    let g_at = tile * 768u + at;
    let half = 4u * TILE;
    let red_a = column(g_at);
    let red_b = column(g_at + half);
    let green_a = column(g_at + 256u);
    let green_b = column(g_at + 256u + half);
    let blue_a = column(g_at + 512u);
    let blue_b = column(g_at + 512u + half);
    let p_at = tile * 1024u + at;
    var rg_a = light(p_at, red_a, green_a, blue_a);
    var rg_b = light(p_at + half, red_b, green_b, blue_b);
    let first = offsets[tile];
    let end = first + last[tile];
    for (var start = first; start < end; start += RECORD_BATCH) {
        workgroupBarrier();
        if (lane < RECORD_BATCH && start + lane < end) {
            batch[lane] = splats[ids[start + lane]];
        }
        workgroupBarrier();
        let n = min(RECORD_BATCH, end - start);
        for (var k = 0u; k < n; k++) {
            let s = batch[k];
            let row0 = vec4<u32>(bitcast<u32>(s.b.w));
            let row1 = vec4<u32>(bitcast<u32>(s.c.w));
            let dx = s.a.x - px;
            let e0x = vec4<f32>(s.a.z * dx);
            let cut = vec4<f32>(s.b.y);
            let opacity = vec4<f32>(s.b.z);
            let none = vec4<f32>(-1.0);
            let cut_a = select(none, cut, (row_a >= row0) & (row_a < row1));
            let cut_b = select(none, cut, (row_b >= row0) & (row_b < row1));
            let dy_a = vec4<f32>(s.a.y) - py_a;
            let dy_b = vec4<f32>(s.a.y) - py_b;
            let qy_a = s.a.w * dy_a;
            let qy_b = s.a.w * dy_b;
            let e0_a = e0x + qy_a;
            let e0_b = e0x + qy_b;
            let e1_a = s.b.x * dy_a;
            let e1_b = s.b.x * dy_b;
            let e11_a = e1_a * e1_a;
            let e11_b = e1_b * e1_b;
            let cr_a = s.c.x * red_a;
            let cr_b = s.c.x * red_b;
            let cgr_a = s.c.y * green_a;
            let cgr_b = s.c.y * green_b;
            let cb_a = s.c.z * blue_a;
            let cb_b = s.c.z * blue_b;
            let crg_a = cr_a + cgr_a;
            let crg_b = cr_b + cgr_b;
            let cg_a = crg_a + cb_a;
            let cg_b = crg_b + cb_b;
            let step_a = replay(e0_a, e1_a, cut_a, opacity, t_a, rg_a, cg_a);
            let step_b = replay(e0_b, e1_b, cut_b, opacity, t_b, rg_b, cg_b);
            t_a = step_a.t;
            t_b = step_b.t;
            rg_a = step_a.rg;
            rg_b = step_b.rg;
            let v0_a = step_a.v_sigma * e0_a;
            let v0_b = step_b.v_sigma * e0_b;
            let slot = k * 7u * STRIDE + lane;
            partial[slot] = add_rows(0.0, step_a.w * red_a, step_b.w * red_b);
            partial[slot + STRIDE] = add_rows(0.0, step_a.w * green_a, step_b.w * green_b);
            partial[slot + 2u * STRIDE] = add_rows(0.0, step_a.w * blue_a, step_b.w * blue_b);
            partial[slot + 3u * STRIDE] = add_rows(0.0, step_a.v_sigma, step_b.v_sigma);
            partial[slot + 4u * STRIDE] = add_rows(0.0, v0_a * e0_a, v0_b * e0_b);
            partial[slot + 5u * STRIDE] = add_rows(0.0, v0_a * e1_a, v0_b * e1_b);
            partial[slot + 6u * STRIDE] = add_rows(0.0, step_a.v_sigma * e11_a, step_b.v_sigma * e11_b);
        }
        workgroupBarrier();
        for (var j = lane; j < n * 7u; j += LANES) {
            var v: array<f32, 16>;
            for (var l = 0u; l < 16u; l++) {
                v[l] = partial[j * STRIDE + l] + partial[j * STRIDE + l + 16u];
            }
            for (var l = 0u; l < 8u; l++) {
                v[l] += v[l + 8u];
            }
            for (var l = 0u; l < 4u; l++) {
                v[l] += v[l + 4u];
            }
            v[0] += v[2];
            v[1] += v[3];
            records[(start * 7u) + j] = v[0] + v[1];
        }
    }
    // Slots that no pixel got to.
    for (var j = end * 7u + lane; j < offsets[tile + 1u] * 7u; j += LANES) {
        records[j] = 0.0;
    }
}

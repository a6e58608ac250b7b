// Stage `blend`: one workgroup per tile, 32 lanes, each with half a column of pixels as two
// vec4. The textbook shape (one pixel a lane, a barrier a splat) is ten times slower where
// subgroups are narrow.

@group(0) @binding(1) var<storage, read> splats: array<Splat>;
@group(0) @binding(2) var<storage, read> ids: array<u32>;
@group(0) @binding(3) var<storage, read> offsets: array<u32>;
// Per tile: red, green, blue, transmittance, 256 each, row-major.
@group(0) @binding(4) var<storage, read_write> pixels: array<f32>;
@group(0) @binding(5) var<storage, read_write> last: array<u32>;

const LANES: u32 = 32u;

var<workgroup> batch: array<Splat, 32>;
var<workgroup> live: atomic<u32>;
var<workgroup> going: u32;

@compute @workgroup_size(32)
fn blend(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
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
    // Pixels beyond the image's edge never start.
    let within = x0 + x < u.width;
    let on_a = vec4<bool>(within) & (row_a < vec4<u32>(u.height));
    let on_b = vec4<bool>(within) & (row_b < vec4<u32>(u.height));
    var t_a = select(vec4<f32>(-1.0), vec4<f32>(1.0), on_a);
    var t_b = select(vec4<f32>(-1.0), vec4<f32>(1.0), on_b);
    var red_a = vec4<f32>();
    var red_b = vec4<f32>();
    var green_a = vec4<f32>();
    var green_b = vec4<f32>();
    var blue_a = vec4<f32>();
    var blue_b = vec4<f32>();
    let first = offsets[tile];
    let end = offsets[tile + 1u];
    var done = 0u;
    for (var start = first; start < end; start += LANES) {
        if (start + lane < end) {
            batch[lane] = splats[ids[start + lane]];
        }
        if (lane == 0u) {
            atomicStore(&live, 0u);
        }
        workgroupBarrier();
        let n = min(LANES, end - start);
        for (var k = 0u; k < n; k++) {
            let s = batch[k];
            let row0 = vec4<u32>(bitcast<u32>(s.b.w));
            let row1 = vec4<u32>(bitcast<u32>(s.c.w));
            let dx = s.a.x - px;
            let e0x = vec4<f32>(s.a.z * dx);
            let cut = vec4<f32>(s.b.y);
            let opacity = vec4<f32>(s.b.z);
            // Rows outside the splat's box get a cut that nothing passes.
            let none = vec4<f32>(-1.0);
            let cut_a = select(none, cut, (row_a >= row0) & (row_a < row1));
            let cut_b = select(none, cut, (row_b >= row0) & (row_b < row1));
            let dy_a = vec4<f32>(s.a.y) - py_a;
            let dy_b = vec4<f32>(s.a.y) - py_b;
            let qy_a = s.a.w * dy_a;
            let qy_b = s.a.w * dy_b;
            let step_a = gate(e0x + qy_a, s.b.x * dy_a, cut_a, opacity, t_a);
            let step_b = gate(e0x + qy_b, s.b.x * dy_b, cut_b, opacity, t_b);
            let r_a = step_a.w * s.c.x;
            let g_a = step_a.w * s.c.y;
            let b_a = step_a.w * s.c.z;
            let r_b = step_b.w * s.c.x;
            let g_b = step_b.w * s.c.y;
            let b_b = step_b.w * s.c.z;
            red_a += r_a;
            red_b += r_b;
            green_a += g_a;
            green_b += g_b;
            blue_a += b_a;
            blue_b += b_b;
            t_a = step_a.t;
            t_b = step_b.t;
        }
        done += n;
        if (any(t_a > vec4<f32>(0.0)) || any(t_b > vec4<f32>(0.0))) {
            atomicStore(&live, 1u);
        }
        workgroupBarrier();
        if (lane == 0u) {
            going = atomicLoad(&live);
        }
        if (workgroupUniformLoad(&going) == 0u) {
            break;
        }
    }
    if (lane == 0u) {
        last[tile] = done;
    }
    let base = tile * 1024u + row * TILE + x;
    for (var k = 0u; k < 4u; k++) {
        let at = base + k * TILE;
        let at_b = at + 4u * TILE;
        pixels[at] = red_a[k];
        pixels[at + 256u] = green_a[k];
        pixels[at + 512u] = blue_a[k];
        pixels[at + 768u] = t_a[k];
        pixels[at_b] = red_b[k];
        pixels[at_b + 256u] = green_b[k];
        pixels[at_b + 512u] = blue_b[k];
        pixels[at_b + 768u] = t_b[k];
    }
}

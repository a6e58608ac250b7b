// Stage `project`: one splat per Gaussian of a page that the band of the view shows, and its depth key.

@group(0) @binding(1) var<storage, read> geo: array<f32>;
@group(0) @binding(2) var<storage, read> sh: array<f32>;
@group(0) @binding(3) var<storage, read_write> page_splats: array<Splat>;
// Of all pages.
@group(0) @binding(4) var<storage, read_write> keys: array<u32>;

fn load_sh(i: u32, k: u32) -> vec3<f32> {
    let at = 3u * (i * u.sh_len + k);
    return vec3<f32>(sh[at], sh[at + 1u], sh[at + 2u]);
}

fn raw_colour(basis: ptr<function, array<f32, 16>>, i: u32) -> vec3<f32> {
    var c = vec3<f32>(0.5);
    for (var k = 0u; k < u.sh_len; k++) {
        let term = load_sh(i, k) * (*basis)[k];
        c += term;
    }
    return c;
}

// Index range of the pixels whose centres lie in `centre` +- `half`, within 0..limit.
fn span(centre: f32, half: f32, limit: u32) -> vec2<u32> {
    let bound = f32(limit);
    let below = centre - half;
    let above = centre + half;
    let first = clamp(ceil(below - 0.5), 0.0, bound);
    let last = clamp(floor(above - 0.5) + 1.0, 0.0, bound);
    return vec2<u32>(u32(first), u32(last));
}

fn square_tiles(centre: f32, half: f32, limit: u32) -> vec2<u32> {
    let tile = f32(TILE);
    let bound = f32(limit);
    let c = centre - 0.5;
    let first = clamp((c - half) / tile, 0.0, bound);
    let last = clamp((c + half + tile - 1.0) / tile, 0.0, bound);
    return vec2<u32>(u32(first), u32(last));
}

fn reference_radius(shape: Shape) -> f32 {
    let mid = 0.5 * (shape.cov_xx + shape.cov_yy);
    let det = shape.det_over_m * shape.m;
    let root = sqrt(max(mid * mid - det, 0.1));
    return ceil(3.0 * sqrt(mid + root));
}

// The tiles of a range of pixels.
fn tiles_of(pixels: vec2<u32>) -> vec2<u32> {
    return vec2<u32>(pixels.x / TILE, (pixels.y + TILE - 1u) / TILE);
}

@compute @workgroup_size(64)
fn project(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let i = group_index(group) * 64u + lane;
    if (i >= page.count) {
        return;
    }
    keys[page.first + i] = CULLED;
    let f = frame_of(i);
    let opacity = opacity_of(f, load_opacity(i));
    let o255 = opacity * 255.0;
    if (!(o255 > 1.0 && f.visible)) {
        return;
    }
    let slope_x = f.m.x * f.inv_z;
    let slope_y = f.m.y * f.inv_z;
    let px = u.lens.x * slope_x;
    let py = u.lens.y * slope_y;
    let x = px + u.lens.z;
    let y = py + u.lens.w;
    let shape = f.shape;
    let sane = finite(x) && finite(y) && finite(shape.p) && finite(shape.q) && finite(shape.r);
    if (!sane) {
        return;
    }
    let cut = ln_polynomial(o255);
    var cols: vec2<u32>;
    var rows: vec2<u32>;
    if (u.reference == 1u) {
        let half = reference_radius(shape);
        let xs = square_tiles(x, half, u.tiles_x);
        let ys = square_tiles(y, half, u.tiles_y);
        cols = vec2<u32>(xs.x * TILE, min(xs.y * TILE, u.width));
        rows = vec2<u32>(ys.x * TILE, min(ys.y * TILE, u.height));
    } else {
        let t = 2.0 * cut * 1.0001;
        let half_x = sqrt(t * shape.cov_xx) + 0.01;
        let half_y = sqrt(t * shape.cov_yy) + 0.01;
        cols = span(x, half_x, u.width);
        rows = span(y, half_y, u.height);
    }
    if (!(cols.x < cols.y && rows.x < rows.y)) {
        return;
    }
    let columns = tiles_of(cols);
    let shown_rows = vec2<u32>(max(tiles_of(rows).x, u.first_row), min(tiles_of(rows).y, u.end_row));
    if (shown_rows.x >= shown_rows.y) {
        return;
    }
    var basis = sh_basis(direction_of(f.from_eye));
    let raw = raw_colour(&basis, i);
    if (!(finite(raw.x) && finite(raw.y) && finite(raw.z))) {
        return;
    }
    let colour = max(raw, vec3<f32>(0.0));
    let s = Splat(
        vec4<f32>(x, y, shape.p, shape.q),
        vec3<f32>(shape.r, cut, opacity),
        columns.x | (columns.y << 16u),
        colour,
        shown_rows.x | (shown_rows.y << 16u),
    );
    page_splats[i] = s;
    keys[page.first + i] = bitcast<u32>(f.m.z);
}

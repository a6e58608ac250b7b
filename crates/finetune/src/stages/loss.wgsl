// Stage `loss`: value and gradient, one colour channel after another in the same buffers. A
// lane blurs a run of eight pixels along a row or a column: a window of eight slides over the
// run, so a value is loaded two or three times instead of eleven.

@group(0) @binding(1) var<storage, read> pixels: array<f32>;
// Three planes of the photo, a byte per value.
@group(0) @binding(2) var<storage, read> photo: array<u32>;
// Five planes, blurred along the rows: x, y, x^2, y^2, x y. Later three: `partials`, blurred likewise.
@group(0) @binding(3) var<storage, read_write> moments: array<f32>;
// Three planes: the partials of SSIM with respect to mean, variance, covariance.
@group(0) @binding(4) var<storage, read_write> partials: array<f32>;
// Loss and squared error of every pixel.
@group(0) @binding(5) var<storage, read_write> values: array<vec2<f32>>;
@group(0) @binding(6) var<storage, read_write> gradient: array<f32>;
@group(0) @binding(7) var<storage, read_write> losses: array<vec2<f32>>;
@group(0) @binding(8) var<storage, read_write> block_sums: array<vec2<f32>>;
// The channel, in x.
@group(0) @binding(9) var<uniform> colour: vec4<u32>;

const C1: f32 = 1.0e-4;
const C2: f32 = 9.0e-4;
const TAPS = array<f32, 11>(SSIM_TAPS);

fn rendered(channel: u32, x: u32, y: u32) -> f32 {
    let tile = (y / TILE) * u.tiles_x + x / TILE;
    let at = tile * 1024u + (y % TILE) * TILE + x % TILE;
    let under = abs(pixels[at + 768u]) * u.background[channel];
    return pixels[at + channel * 256u] + under;
}

fn target_at(channel: u32, x: u32, y: u32) -> f32 {
    let at = channel * u.width * u.height + y * u.width + x;
    return f32((photo[at / 4u] >> (8u * (at % 4u))) & 255u) / 255.0;
}

// Eight consecutive values.
struct Run { a: vec4<f32>, b: vec4<f32> }

fn slide(r: Run, next: f32) -> Run {
    return Run(vec4<f32>(r.a.yzw, r.b.x), vec4<f32>(r.b.yzw, next));
}

fn weigh(sum: Run, tap: f32, r: Run) -> Run {
    return Run(sum.a + tap * r.a, sum.b + tap * r.b);
}

fn multiply(p: Run, q: Run) -> Run {
    return Run(p.a * q.a, p.b * q.b);
}

// The value `k - 5` pixels from `at` along a row or column of `limit` pixels; zero outside it.
struct Reach { at: u32, inside: bool }

fn reach_of(at: u32, k: u32, limit: u32) -> Reach {
    let inside = at + k >= 5u && at + k < limit + 5u;
    return Reach(select(0u, at + k - 5u, inside), inside);
}

// The first pixel of a lane's run, along a row or down a column.
struct Place { channel: u32, x: u32, y: u32, inside: bool }

fn along_row(group: vec3<u32>, lane: u32) -> Place {
    let runs = (u.width + RUN - 1u) / RUN;
    let index = group_index(group) * 64u + lane;
    return Place(colour.x, (index % runs) * RUN, index / runs, index < runs * u.height);
}

fn down_column(group: vec3<u32>, lane: u32, width: u32, height: u32) -> Place {
    let index = group_index(group) * 64u + lane;
    return Place(colour.x, index % width, (index / width) * RUN, index < width * (height / RUN));
}

fn pair_at(p: Place, k: u32) -> vec2<f32> {
    let r = reach_of(p.x, k, u.width);
    let v = vec2<f32>(rendered(p.channel, r.at, p.y), target_at(p.channel, r.at, p.y));
    return select(vec2<f32>(), v, r.inside);
}

fn store_moments(plane: u32, p: Place, r: Run) {
    let at = plane * u.width * u.height + p.y * u.width + p.x;
    //@each k 0 1 2 3
    if (p.x + $ku < u.width) { moments[at + $ku] = r.a[$k]; }
    if (p.x + $ku + 4u < u.width) { moments[at + $ku + 4u] = r.b[$k]; }
    //@end
}

@compute @workgroup_size(64)
fn ssim_rows(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let p = along_row(group, lane);
    if (!p.inside) {
        return;
    }
    //@each k 0 1 2 3 4 5 6 7
    let v$k = pair_at(p, $ku);
    //@end
    var a = Run(vec4<f32>(v0.x, v1.x, v2.x, v3.x), vec4<f32>(v4.x, v5.x, v6.x, v7.x));
    var b = Run(vec4<f32>(v0.y, v1.y, v2.y, v3.y), vec4<f32>(v4.y, v5.y, v6.y, v7.y));
    var m0: Run;
    var m1: Run;
    var m2: Run;
    var m3: Run;
    var m4: Run;
    //@each tap 0 1 2 3 4 5 6 7 8 9 10
    m0 = weigh(m0, TAPS[$tap], a);
    m1 = weigh(m1, TAPS[$tap], b);
    m2 = weigh(m2, TAPS[$tap], multiply(a, a));
    m3 = weigh(m3, TAPS[$tap], multiply(b, b));
    m4 = weigh(m4, TAPS[$tap], multiply(a, b));
    if ($tap < 10) {
        let next = pair_at(p, $tapu + RUN);
        a = slide(a, next.x);
        b = slide(b, next.y);
    }
    //@end
    //@each plane 0 1 2 3 4
    store_moments($planeu, p, m$plane);
    //@end
}

fn moment_at(plane: u32, p: Place, k: u32) -> f32 {
    let r = reach_of(p.y, k, u.height);
    let v = moments[plane * u.width * u.height + r.at * u.width + p.x];
    return select(0.0, v, r.inside);
}

// A plane of `moments`, blurred down the column.
fn moment_run(plane: u32, p: Place) -> Run {
    //@each k 0 1 2 3 4 5 6 7
    let v$k = moment_at(plane, p, $ku);
    //@end
    var r = Run(vec4<f32>(v0, v1, v2, v3), vec4<f32>(v4, v5, v6, v7));
    var sum: Run;
    //@each tap 0 1 2 3 4 5 6 7 8 9 10
    sum = weigh(sum, TAPS[$tap], r);
    if ($tap < 10) {
        r = slide(r, moment_at(plane, p, $tapu + RUN));
    }
    //@end
    return sum;
}

struct Ssim { value: vec4<f32>, d_mean: vec4<f32>, d_var: vec4<f32>, d_cov: vec4<f32> }

fn ssim_of(x: vec4<f32>, y: vec4<f32>, xx: vec4<f32>, yy: vec4<f32>, xy: vec4<f32>) -> Ssim {
    let uxx = x * x;
    let uyy = y * y;
    let uxy = x * y;
    let a1 = 2.0 * uxy + C1;
    let a2 = 2.0 * (xy - uxy) + C2;
    let b1 = uxx + uyy + C1;
    let b2 = (xx - uxx) + (yy - uyy) + C2;
    let inv = 1.0 / (b1 * b2);
    let s = a1 * a2 * inv;
    let d_var = -(s / b2);
    let d_cov = 2.0 * a1 * inv;
    let d_mean = 2.0 * y * a2 * inv - 2.0 * x * (s / b1);
    return Ssim(s, d_mean - 2.0 * x * d_var - y * d_cov, d_var, d_cov);
}

fn store_ssim(x: u32, y: u32, value: f32, mean: f32, variance: f32, cov: f32) {
    if (y < u.height) {
        let n = u.width * u.height;
        let at = y * u.width + x;
        partials[at] = mean;
        partials[n + at] = variance;
        partials[2u * n + at] = cov;
        values[at] = vec2<f32>(u.ssim * (1.0 - value), 0.0);
    }
}

@compute @workgroup_size(64)
fn ssim_values(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let p = down_column(group, lane, u.width, u.height + RUN - 1u);
    if (!p.inside) {
        return;
    }
    //@each plane 0 1 2 3 4
    let m$plane = moment_run($planeu, p);
    //@end
    let s_a = ssim_of(m0.a, m1.a, m2.a, m3.a, m4.a);
    let s_b = ssim_of(m0.b, m1.b, m2.b, m3.b, m4.b);
    //@each k 0 1 2 3
    //@each half a b
    store_ssim(
        p.x,
        p.y + $ku + HALF_$half,
        s_$half.value[$k],
        s_$half.d_mean[$k],
        s_$half.d_var[$k],
        s_$half.d_cov[$k],
    );
    //@end
    //@end
}

// First pixel of a run's halves.
const HALF_a: u32 = 0u;
const HALF_b: u32 = 4u;

fn partial_along(plane: u32, p: Place, k: u32) -> f32 {
    let r = reach_of(p.x, k, u.width);
    let v = partials[plane * u.width * u.height + p.y * u.width + r.at];
    return select(0.0, v, r.inside);
}

@compute @workgroup_size(64)
fn ssim_spread(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let p = along_row(group, lane);
    if (!p.inside) {
        return;
    }
    let n = u.width * u.height;
    for (var plane = 0u; plane < 3u; plane++) {
        //@each k 0 1 2 3 4 5 6 7
        let v$k = partial_along(plane, p, $ku);
        //@end
        var r = Run(vec4<f32>(v0, v1, v2, v3), vec4<f32>(v4, v5, v6, v7));
        var sum: Run;
        //@each tap 0 1 2 3 4 5 6 7 8 9 10
        sum = weigh(sum, TAPS[$tap], r);
        if ($tap < 10) {
            r = slide(r, partial_along(plane, p, $tapu + RUN));
        }
        //@end
        let at = plane * n + p.y * u.width + p.x;
        //@each k 0 1 2 3
        if (p.x + $ku < u.width) { moments[at + $ku] = sum.a[$k]; }
        if (p.x + $ku + 4u < u.width) { moments[at + $ku + 4u] = sum.b[$k]; }
        //@end
    }
}

fn spread_at(plane: u32, p: Place, k: u32) -> f32 {
    let r = reach_of(p.y, k, u.height);
    let v = moments[plane * u.width * u.height + r.at * u.width + min(p.x, u.width - 1u)];
    return select(0.0, v, r.inside);
}

fn spread_run(plane: u32, p: Place) -> Run {
    //@each k 0 1 2 3 4 5 6 7
    let v$k = spread_at(plane, p, $ku);
    //@end
    var r = Run(vec4<f32>(v0, v1, v2, v3), vec4<f32>(v4, v5, v6, v7));
    var sum: Run;
    //@each tap 0 1 2 3 4 5 6 7 8 9 10
    sum = weigh(sum, TAPS[$tap], r);
    if ($tap < 10) {
        r = slide(r, spread_at(plane, p, $tapu + RUN));
    }
    //@end
    return sum;
}

// One pixel of the gradient, and its contributions to the loss without SSIM and to the squared error.
fn finish(channel: u32, x: u32, y: u32, mean: f32, variance: f32, cov: f32) {
    var g = 0.0;
    if (x < u.width && y < u.height) {
        let n = u.width * u.height;
        let total = f32(3u * n);
        let a = rendered(channel, x, y);
        let b = target_at(channel, x, y);
        let d = a - b;
        let shown = clamp(a, 0.0, 1.0) - b;
        let at = y * u.width + x;
        g = (u.l1 * sign(d) + 2.0 * u.mse * d) / total;
        var value = u.l1 * abs(d) + u.mse * d * d;
        if (u.ssim > 0.0) {
            let s = mean + 2.0 * a * variance + b * cov;
            g -= (u.ssim / total) * s;
            value += values[at].x;
        }
        values[at] = vec2<f32>(value, shown * shown);
    }
    // Zero beyond the image's edge.
    let tile = (y / TILE) * u.tiles_x + x / TILE;
    gradient[tile * 768u + channel * 256u + (y % TILE) * TILE + x % TILE] = g;
}

// Over all pixels of all tiles.
@compute @workgroup_size(64)
fn loss_gradient(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let p = down_column(group, lane, u.tiles_x * TILE, u.tiles_y * TILE);
    if (!p.inside) {
        return;
    }
    var mean: Run;
    var variance: Run;
    var cov: Run;
    if (u.ssim > 0.0) {
        mean = spread_run(0u, p);
        variance = spread_run(1u, p);
        cov = spread_run(2u, p);
    }
    //@each k 0 1 2 3
    finish(p.channel, p.x, p.y + $ku, mean.a[$k], variance.a[$k], cov.a[$k]);
    finish(p.channel, p.x, p.y + $ku + 4u, mean.b[$k], variance.b[$k], cov.b[$k]);
    //@end
}

var<workgroup> lanes: array<vec2<f32>, 64>;

// A sum in a fixed order: 64 lanes add 64 consecutive values each, then halves are added to halves.
@compute @workgroup_size(64)
fn loss_blocks(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let block = group_index(group);
    let n = u.width * u.height;
    let first = (block * 64u + lane) * 64u;
    var sum = vec2<f32>();
    for (var k = 0u; k < 64u; k++) {
        if (first + k < n) {
            sum += values[first + k];
        }
    }
    lanes[lane] = sum;
    workgroupBarrier();
    for (var half = 32u; half > 0u; half /= 2u) {
        if (lane < half) {
            lanes[lane] += lanes[lane + half];
        }
        workgroupBarrier();
    }
    if (lane == 0u && block * 4096u < n) {
        block_sums[colour.x * ((n + 4095u) / 4096u) + block] = lanes[0];
    }
}

@compute @workgroup_size(1)
fn loss_total() {
    let n = u.width * u.height;
    let blocks = (n + 4095u) / 4096u;
    var sum = vec2<f32>();
    for (var k = 0u; k < 3u * blocks; k++) {
        sum += block_sums[k];
    }
    losses[u.loss_slot] = sum / f32(3u * n);
}

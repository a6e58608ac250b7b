// Stage `loss`: value and gradient. The third coordinate of a workgroup is the colour channel.

@group(0) @binding(1) var<storage, read> pixels: array<f32>;
// Three planes of the photo.
@group(0) @binding(2) var<storage, read> photo: array<f32>;
// Per channel five planes: x, y, x^2, y^2, x y blurred along the rows.
@group(0) @binding(3) var<storage, read_write> moments: array<f32>;
// Per channel six planes: the partials of SSIM with respect to mean, variance, covariance; the same
// blurred along the rows.
@group(0) @binding(4) var<storage, read_write> partials: array<f32>;
// Per channel: loss and squared error of every pixel.
@group(0) @binding(5) var<storage, read_write> values: array<vec2<f32>>;
@group(0) @binding(6) var<storage, read_write> gradient: array<f32>;
@group(0) @binding(7) var<storage, read_write> losses: array<vec2<f32>>;
@group(0) @binding(8) var<storage, read_write> block_sums: array<vec2<f32>>;

const C1: f32 = 1.0e-4;
const C2: f32 = 9.0e-4;

fn rendered(channel: u32, x: u32, y: u32) -> f32 {
    let tile = (y / TILE) * u.tiles_x + x / TILE;
    let at = tile * 1024u + (y % TILE) * TILE + x % TILE;
    let under = abs(pixels[at + 768u]) * u.background[channel];
    return pixels[at + channel * 256u] + under;
}

fn target_at(channel: u32, x: u32, y: u32) -> f32 {
    return photo[channel * u.width * u.height + y * u.width + x];
}

struct Place { channel: u32, x: u32, y: u32, at: u32, inside: bool }

fn place_of(group: vec3<u32>, lane: u32) -> Place {
    let at = group_index(group) * 64u + lane;
    return Place(group.z, at % u.width, at / u.width, at, at < u.width * u.height);
}

fn taps() -> array<f32, 11> {
    return array<f32, 11>(SSIM_TAPS);
}

// Index range of the taps that stay within 0..limit around `centre`.
fn window(centre: u32, limit: u32) -> vec2<u32> {
    let low = select(0u, 5u - centre, centre < 5u);
    let high = min(11u, limit + 5u - centre);
    return vec2<u32>(low, high);
}

@compute @workgroup_size(64)
fn ssim_rows(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let p = place_of(group, lane);
    if (!p.inside) {
        return;
    }
    let n = u.width * u.height;
    var t = taps();
    var sums: array<f32, 5>;
    let w = window(p.x, u.width);
    for (var k = w.x; k < w.y; k++) {
        let a = rendered(p.channel, p.x + k - 5u, p.y);
        let b = target_at(p.channel, p.x + k - 5u, p.y);
        sums[0] += t[k] * a;
        sums[1] += t[k] * b;
        sums[2] += t[k] * (a * a);
        sums[3] += t[k] * (b * b);
        sums[4] += t[k] * (a * b);
    }
    for (var c = 0u; c < 5u; c++) {
        moments[(p.channel * 5u + c) * n + p.at] = sums[c];
    }
}

@compute @workgroup_size(64)
fn ssim_values(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let p = place_of(group, lane);
    if (!p.inside) {
        return;
    }
    let n = u.width * u.height;
    var t = taps();
    var m: array<f32, 5>;
    let w = window(p.y, u.height);
    for (var k = w.x; k < w.y; k++) {
        let at = p.at + (k * u.width) - 5u * u.width;
        for (var c = 0u; c < 5u; c++) {
            m[c] += t[k] * moments[(p.channel * 5u + c) * n + at];
        }
    }
    let uxx = m[0] * m[0];
    let uyy = m[1] * m[1];
    let uxy = m[0] * m[1];
    let a1 = 2.0 * uxy + C1;
    let a2 = 2.0 * (m[4] - uxy) + C2;
    let b1 = uxx + uyy + C1;
    let b2 = (m[2] - uxx) + (m[3] - uyy) + C2;
    let inv = 1.0 / (b1 * b2);
    let s = a1 * a2 * inv;
    let d_var = -(s / b2);
    let d_cov = 2.0 * a1 * inv;
    let d_mean = 2.0 * m[1] * a2 * inv - 2.0 * m[0] * (s / b1);
    partials[(p.channel * 6u) * n + p.at] = d_mean - 2.0 * m[0] * d_var - m[1] * d_cov;
    partials[(p.channel * 6u + 1u) * n + p.at] = d_var;
    partials[(p.channel * 6u + 2u) * n + p.at] = d_cov;
    add_value(p, u.ssim_weight * (1.0 - s), 0.0);
}

fn add_value(p: Place, loss: f32, error: f32) {
    values[p.channel * u.width * u.height + p.at] += vec2<f32>(loss, error);
}

@compute @workgroup_size(64)
fn ssim_spread(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let p = place_of(group, lane);
    if (!p.inside) {
        return;
    }
    let n = u.width * u.height;
    var t = taps();
    let w = window(p.x, u.width);
    for (var c = 0u; c < 3u; c++) {
        var sum = 0.0;
        for (var k = w.x; k < w.y; k++) {
            sum += t[k] * partials[(p.channel * 6u + c) * n + p.at + k - 5u];
        }
        partials[(p.channel * 6u + c + 3u) * n + p.at] = sum;
    }
}

// The gradient, and the pixel's share of everything but SSIM.
@compute @workgroup_size(64)
fn loss_gradient(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let p = place_of(group, lane);
    if (!p.inside) {
        return;
    }
    let n = u.width * u.height;
    let total = f32(3u * n);
    let a = rendered(p.channel, p.x, p.y);
    let b = target_at(p.channel, p.x, p.y);
    let d = a - b;
    let shown = clamp(a, 0.0, 1.0) - b;
    var g = 2.0 / total * d;
    if (u.l1_ssim == 1u) {
        var t = taps();
        let w = window(p.y, u.height);
        var m: array<f32, 3>;
        for (var k = w.x; k < w.y; k++) {
            let at = p.at + (k * u.width) - 5u * u.width;
            for (var c = 0u; c < 3u; c++) {
                m[c] += t[k] * partials[(p.channel * 6u + c + 3u) * n + at];
            }
        }
        let s = m[0] + 2.0 * a * m[1] + b * m[2];
        let l1 = sign(d) * ((1.0 - u.ssim_weight) / total);
        g = l1 - (u.ssim_weight / total) * s;
        add_value(p, (1.0 - u.ssim_weight) * abs(d), shown * shown);
    } else {
        add_value(p, d * d, shown * shown);
    }
    let tile = (p.y / TILE) * u.tiles_x + p.x / TILE;
    gradient[tile * 768u + p.channel * 256u + (p.y % TILE) * TILE + p.x % TILE] = g;
}

// Clears what the channels add to, and the gradients beyond the image's edge.
@compute @workgroup_size(64)
fn loss_clear(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let at = group_index(group) * 64u + lane;
    if (at < 3u * u.width * u.height) {
        values[at] = vec2<f32>();
    }
    if (at < u.tiles_x * u.tiles_y * 768u) {
        gradient[at] = 0.0;
    }
}

var<workgroup> lanes: array<vec2<f32>, 64>;

// A sum of fixed shape: 64 lanes with 64 consecutive values each, halves onto halves.
@compute @workgroup_size(64)
fn loss_blocks(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let block = group_index(group);
    let n = 3u * u.width * u.height;
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
        block_sums[block] = lanes[0];
    }
}

@compute @workgroup_size(1)
fn loss_total() {
    let n = 3u * u.width * u.height;
    let blocks = (n + 4095u) / 4096u;
    var sum = vec2<f32>();
    for (var k = 0u; k < blocks; k++) {
        sum += block_sums[k];
    }
    losses[u.loss_slot] = sum / f32(n);
}

// Whether a splat reaches a rectangle of pixels. Valid WGSL and a valid Rust module body; see
// ../mod.rs. In WGSL, F is f32 or vec4<f32> (four splats).

// Smallest sigma over a rectangle of pixel centres, given by its edges relative to the mean
// (dx = mean - pixel is within [dx0, dx1]), minus a bound of its rounding error, so that comparing
// it with the cut never excludes a splat that reaches the rectangle.
fn least_sigma(p: F, q: F, r: F, dx0: F, dx1: F, dy0: F, dy1: F) -> F {
    let dx = clamp(F(0.0), dx0, dx1);
    let dy = clamp(F(0.0), dy0, dy1);
    // On the vertical edge at dx, the best dy; on the horizontal edge at dy, the best dx.
    let qq = q * q;
    let rr = r * r;
    let cc = max(qq + rr, F(1.0e-30));
    let pq = p * q;
    let ratio_y = pq / cc;
    let best_y = clamp(-(ratio_y * dx), dy0, dy1);
    let ratio_x = q / max(p, F(1.0e-15));
    let best_x = clamp(-(ratio_x * dy), dx0, dx1);
    let s1 = sigma_with_margin(p, q, r, dx, best_y);
    let s2 = sigma_with_margin(p, q, r, best_x, dy);
    return min(s1, s2);
}

fn sigma_with_margin(p: F, q: F, r: F, dx: F, dy: F) -> F {
    let px = p * dx;
    let qy = q * dy;
    let e0 = px + qy;
    let spread = abs(px) + abs(qy);
    let error = spread * 1.0e-6;
    let low = max(abs(e0) - error, F(0.0));
    let e1 = r * dy;
    let s0 = low * low;
    let s1 = e1 * e1;
    let sum = s0 + s1;
    return sum * 0.99999;
}

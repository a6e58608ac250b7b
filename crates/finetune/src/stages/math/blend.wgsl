// One splat on one pixel. Valid WGSL and a valid Rust module body; see ../mod.rs. In WGSL, F
// is f32 or vec4<f32> (four pixels).

// Result of one blend step: the weight alpha T (zero where the splat does not count) and the
// transmittance after it. A negative transmittance marks a pixel that has stopped.
struct Step { w: F, t: F }

// Weight of a splat on a pixel: `e0` and `e1` as in Shape, `cut` = ln(255 opacity). The
// test is on sigma rather than on alpha: the same set, up to one rounding, as
// alpha >= 1/255, and it keeps the exponential within [-5.55, 0].
fn blend_step(e0: F, e1: F, cut: F, opacity: F, t: F) -> Step {
    let s0 = e0 * e0;
    let s1 = e1 * e1;
    let sigma = s0 + s1;
    let inside = (sigma <= cut) & (t > F(0.0));
    let g = exp_own(-min(sigma, F(6.0)));
    let og = opacity * g;
    let alpha = min(og, F(0.99));
    let w = alpha * t;
    let rest = t - w;
    let stop = inside & (rest < F(T_STOP));
    let counts = inside & (rest >= F(T_STOP));
    let kept = select(t, rest, counts);
    return Step(select(F(0.0), w, counts), select(kept, -t, stop));
}

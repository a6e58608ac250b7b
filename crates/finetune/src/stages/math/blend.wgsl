// One splat on one pixel. Valid WGSL and a valid Rust module body; see ../mod.rs. In WGSL, F
// is f32 or vec4<f32> (four pixels).

// What a splat does at a pixel: opacity times the Gaussian, alpha (capped), the weight
// alpha T (zero where the splat does not count), and the transmittance after it. A negative
// transmittance marks a pixel that has stopped.
struct Gate { og: F, alpha: F, w: F, t: F, counts: B }

// One adjoint step: the weight and transmittance as in Gate, the light still to come dotted
// with the gradient, and the gradient with respect to sigma.
struct Replay { w: F, t: F, rg: F, v_sigma: F }

// `e0` and `e1` as in Shape, `cut` = ln(255 opacity), `t` the transmittance so far, `least` the
// least that blending may leave of it. The test is on sigma rather than on alpha: the same set, up
// to one rounding, as alpha >= 1/255, and it keeps the exponential within [-5.55, 0]. A splat that
// would take the transmittance below `least` is not blended and stops the pixel.
fn gate(e0: F, e1: F, cut: F, opacity: F, least: F, t: F) -> Gate {
    let s0 = e0 * e0;
    let s1 = e1 * e1;
    let sigma = s0 + s1;
    let inside = (sigma <= cut) & (t > F(0.0));
    let g = exp_polynomial(-min(sigma, F(SIGMA_MAX)));
    let og = opacity * g;
    let alpha = min(og, F(ALPHA_MAX));
    let w = alpha * t;
    let rest = t - w;
    let counts = inside & (rest >= least);
    let stop = inside & (rest < least);
    let kept = select(t, rest, counts);
    return Gate(og, alpha, select(F(0.0), w, counts), select(kept, -t, stop), counts);
}

// The adjoint of `gate`, front to back. `cg` is the splat's colour dotted with the pixel's
// gradient, `rg` the colour of this and all later splats and the background, dotted with it.
// Gates and transmittance are recomputed as in the forward pass; nothing is divided by T.
fn replay(e0: F, e1: F, cut: F, opacity: F, least: F, t: F, rg: F, cg: F) -> Replay {
    let a = gate(e0, e1, cut, opacity, least, t);
    let shown = a.w * cg;
    let behind = rg - shown;
    let clear = 1.0 - a.alpha;
    let lit = t * cg;
    let shaded = behind / clear;
    let v_alpha = lit - shaded;
    let v = -(a.og * v_alpha);
    // Above the cap the derivative of alpha is zero.
    let moves = a.counts & (a.og <= F(ALPHA_MAX));
    return Replay(a.w, a.t, behind, select(F(0.0), v, moves));
}

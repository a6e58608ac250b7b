// The gradient with respect to the 2D covariance, from E, the sum of v_sigma e e^T over the pixels, and the gradient
// with respect to the logarithm of the opacity that the view shows.
fn shape_gradient(f: Frame, e: Sym2, v_ln_opacity: f32) -> Sym2 {
    let v_s = covariance_adjoint(f.shape.p, f.shape.q, f.shape.r, e);
    if (u.antialiased == 1u) {
        return add_sym2(v_s, compensation_adjoint(f.v0, f.v1, f.shape, u.blur, v_ln_opacity));
    }
    return v_s;
}

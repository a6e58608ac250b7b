// Real spherical harmonics by band, in the order and with the signs of 3DGS files. Valid WGSL
// and a valid Rust module body; see ../mod.rs. The argument is a unit vector.

struct Band2 { b0: F, b1: F, b2: F, b3: F, b4: F }
struct Band3 { b0: F, b1: F, b2: F, b3: F, b4: F, b5: F, b6: F }

fn sh_band1(d: V3) -> V3 {
    return V3(-0.4886025119029199 * d.y, 0.4886025119029199 * d.z, -0.4886025119029199 * d.x);
}

fn sh_band2(d: V3) -> Band2 {
    let xx = d.x * d.x;
    let yy = d.y * d.y;
    let zz = d.z * d.z;
    let xy = d.x * d.y;
    let yz = d.y * d.z;
    let xz = d.x * d.z;
    let zz2 = zz * 2.0;
    let a = zz2 - xx;
    let q = a - yy;
    let h = xx - yy;
    return Band2(
        1.0925484305920792 * xy,
        -1.0925484305920792 * yz,
        0.31539156525252005 * q,
        -1.0925484305920792 * xz,
        0.5462742152960396 * h,
    );
}

fn sh_band3(d: V3) -> Band3 {
    let xx = d.x * d.x;
    let yy = d.y * d.y;
    let zz = d.z * d.z;
    let xy = d.x * d.y;
    let xx3 = xx * 3.0;
    let yy3 = yy * 3.0;
    let zz4 = zz * 4.0;
    let zz2 = zz * 2.0;
    let a = xx3 - yy;
    let b0 = zz4 - xx;
    let b = b0 - yy;
    let c0 = zz2 - xx3;
    let c = c0 - yy3;
    let h = xx - yy;
    let e = xx - yy3;
    let ya = d.y * a;
    let xyz = xy * d.z;
    let yb = d.y * b;
    let zc = d.z * c;
    let xb = d.x * b;
    let zh = d.z * h;
    let xe = d.x * e;
    return Band3(
        -0.5900435899266435 * ya,
        2.890611442640554 * xyz,
        -0.4570457994644658 * yb,
        0.3731763325901154 * zc,
        -0.4570457994644658 * xb,
        1.445305721320277 * zh,
        -0.5900435899266435 * xe,
    );
}

struct ShGradient {
    g1: V3, g2: V3, g3: V3,
    g4: V3, g5: V3, g6: V3, g7: V3, g8: V3,
    g9: V3, g10: V3, g11: V3, g12: V3, g13: V3, g14: V3, g15: V3,
}

// Gradients of the basis functions but the constant one with respect to the direction, the polynomials being those of
// `sh_band1` to `sh_band3`.
fn sh_gradient(d: V3) -> ShGradient {
    let x = d.x;
    let y = d.y;
    let z = d.z;
    let xx = x * x;
    let yy = y * y;
    let zz = z * z;
    let c1 = F(0.4886025119029199);
    let c2 = F(1.0925484305920792);
    let e2 = F(0.31539156525252005);
    let h2 = F(0.5462742152960396);
    let a = F(-0.5900435899266435);
    let b = F(2.890611442640554);
    let c = F(-0.4570457994644658);
    let e = F(0.3731763325901154);
    let h = F(1.445305721320277);
    return ShGradient(
        V3(F(0.0), -c1, F(0.0)),
        V3(F(0.0), F(0.0), c1),
        V3(-c1, F(0.0), F(0.0)),
        V3(c2 * y, c2 * x, F(0.0)),
        V3(F(0.0), -c2 * z, -c2 * y),
        V3(-2.0 * e2 * x, -2.0 * e2 * y, 4.0 * e2 * z),
        V3(-c2 * z, F(0.0), -c2 * x),
        V3(2.0 * h2 * x, -2.0 * h2 * y, F(0.0)),
        V3(a * 6.0 * x * y, a * 3.0 * (xx - yy), F(0.0)),
        V3(b * y * z, b * x * z, b * x * y),
        V3(-2.0 * c * x * y, c * (4.0 * zz - xx - 3.0 * yy), 8.0 * c * y * z),
        V3(-6.0 * e * x * z, -6.0 * e * y * z, e * (6.0 * zz - 3.0 * xx - 3.0 * yy)),
        V3(c * (4.0 * zz - 3.0 * xx - yy), -2.0 * c * x * y, 8.0 * c * x * z),
        V3(2.0 * h * x * z, -2.0 * h * y * z, h * (xx - yy)),
        V3(a * 3.0 * (xx - yy), -6.0 * a * x * y, F(0.0)),
    );
}

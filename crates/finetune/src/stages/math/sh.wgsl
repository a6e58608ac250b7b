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

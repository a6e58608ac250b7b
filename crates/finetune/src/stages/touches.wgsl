// A projected Gaussian as the host lays it out; `Splat` in Rust.
struct Splat {
    // x, y, p, q
    a: vec4<f32>,
    // r, cut, opacity, first row (bits)
    b: vec4<f32>,
    // colour, one past the last row (bits)
    c: vec4<f32>,
}

// Whether the splat reaches a pixel centre of tile (tx, ty).
fn touches(s: Splat, tx: u32, ty: u32) -> bool {
    if (u.reference == 1u) {
        return true;
    }
    let edge = f32(TILE - 1u);
    let dx1 = s.a.x - (f32(tx * TILE) + 0.5);
    let dy1 = s.a.y - (f32(ty * TILE) + 0.5);
    let least = least_sigma(s.a.z, s.a.w, s.b.x, dx1 - edge, dx1, dy1 - edge, dy1);
    return least <= s.b.y;
}

// First tile and one past the last, of packed columns or rows.
fn range_of(packed: u32) -> vec2<u32> {
    return vec2<u32>(packed & 0xffffu, packed >> 16u);
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

// Stages `blend` and `blend_adjoint`: a workgroup of 32 lanes per tile. A block is eight columns and four rows of
// pixels. Four lanes share a block: each has a column of its left half (l) and the same one of its right half (r), a
// vec4 of four rows each. A lane visits only the splats that reach its block, as the stage `reach` found. A lane per
// block needs more registers than a GPU has: on an H100 `blend` took 1.8 times as long and `blend_adjoint` 2.7 times.

const STOP = vec4<f32>(T_STOP);

// Corner pixel of a block.
fn corner_of(tile: u32, block: u32) -> vec2<u32> {
    let x = (tile % u.tiles_x) * TILE + (block / 4u) * 8u;
    let y = (tile / u.tiles_x) * TILE + (block % 4u) * 4u;
    return vec2<u32>(x, y);
}

// Index of the block's first pixel within a plane of the tile's 256.
fn offset_of(block: u32) -> u32 {
    return (block % 4u) * 4u * TILE + (block / 4u) * 8u;
}

// Initial transmittance of a column. Pixels beyond the image's edge begin as stopped.
fn start_of(x: u32, rows: vec4<u32>) -> vec4<f32> {
    let within = (rows < vec4<u32>(u.height)) & vec4<bool>(x < u.width);
    return select(vec4<f32>(-1.0), vec4<f32>(1.0), within);
}

// Bit k is set if splat k of the n <= 32 from position `start` of the lists on reaches the block.
fn reaching(start: u32, n: u32, block: u32) -> u32 {
    var mask = 0u;
    let shift = 8u * (start % 4u);
    var word = hits[start / 4u];
    for (var k = 0u; k < n; k += 4u) {
        // The four bytes from `start` on, which may begin inside a word.
        let next = hits[(start + k) / 4u + 1u];
        let straddling = (word >> shift) | (next << (31u - shift) << 1u);
        word = next;
        // The block's bit of each byte, packed into four bits.
        let bits = (straddling >> block) & 0x01010101u;
        mask |= (((bits * 0x01020408u) >> 24u) & 15u) << k;
    }
    return mask & (0xffffffffu >> (32u - n));
}

// Stages `blend` and `blend_adjoint`: eight lanes a tile, four tiles a workgroup. A lane owns a
// block of eight columns and four rows of pixels, two vec4 a row, and visits only the splats
// that reach the block, which the stage `reach` found out. Where lanes are few and loads are dear
// (lavapipe), this is several times faster than lanes that share every splat.

const STOP = vec4<f32>(T_STOP);

// Corner pixel of a block.
fn corner_of(tile: u32, block: u32) -> vec2<u32> {
    let x = (tile % u.tiles_x) * TILE + (block / 4u) * 8u;
    let y = (tile / u.tiles_x) * TILE + (block % 4u) * 4u;
    return vec2<u32>(x, y);
}

// Where the block's pixels begin within a plane of the tile's 256.
fn offset_of(block: u32) -> u32 {
    return (block % 4u) * 4u * TILE + (block / 4u) * 8u;
}

// Transmittance at the beginning: pixels beyond the image's edge never start.
fn start_of(x: vec4<u32>, y: u32) -> vec4<f32> {
    let within = (x < vec4<u32>(u.width)) & vec4<bool>(y < u.height);
    return select(vec4<f32>(-1.0), vec4<f32>(1.0), within);
}

// Bit k is set if splat k of the n <= 32 from place `start` of the lists on reaches the block.
fn reaching(start: u32, n: u32, block: u32) -> u32 {
    var mask = 0u;
    let shift = 8u * (start % 4u);
    var word = hits[start / 4u];
    for (var k = 0u; k < n; k += 4u) {
        // Four bytes from wherever `start` is within a word.
        let next = hits[(start + k) / 4u + 1u];
        let straddling = (word >> shift) | (next << (31u - shift) << 1u);
        word = next;
        // The block's bit of each byte, moved together.
        let bits = (straddling >> block) & 0x01010101u;
        mask |= (((bits * 0x01020408u) >> 24u) & 15u) << k;
    }
    return mask & (0xffffffffu >> (32u - n));
}

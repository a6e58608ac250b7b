// Stages `blend` and `blend_adjoint`: a workgroup of 32 lanes per tile. A block is eight columns and four rows of
// pixels. Four lanes share a block: each has a column of its left half (l) and the same one of its right half (r), a
// vec4 of four rows each. A lane visits only the splats that reach its block, as the stage `reach` found. A lane per
// block needs more registers than a GPU has: on an H100 `blend` took 1.8 times as long and `blend_adjoint` 2.7 times.

const STOP = vec4<f32>(T_STOP);

// The pixels of a lane: its columns of both halves, their rows, the rows' centres, and where the first pixel of each
// column is in a plane of the tile's 256.
struct Columns {
    l: u32,
    r: u32,
    rows: vec4<u32>,
    y: vec4<f32>,
    at_l: u32,
    at_r: u32,
}

fn columns_of(tile: u32, lane: u32) -> Columns {
    let block = lane / 4u;
    let x = (block / 4u) * 8u + lane % 4u;
    let y = (block % 4u) * 4u;
    let column = (tile % u.tiles_x) * TILE + x;
    let rows = vec4<u32>((tile / u.tiles_x) * TILE + y) + vec4<u32>(0u, 1u, 2u, 3u);
    let at = y * TILE + x;
    return Columns(column, column + 4u, rows, vec4<f32>(rows) + vec4<f32>(0.5), at, at + 4u);
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

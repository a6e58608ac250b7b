// Stages `blend_adjoint` and `removal`: a record of SUMS sums per slot. A lane adds up its pixels in registers and stores a
// sum per splat in workgroup memory. Then the lanes add up the columns of a block and the blocks, in a fixed order.

@group(0) @binding(4) var<storage, read> pixels: array<f32>;
// Per lane, as `blend` left it.
@group(0) @binding(5) var<storage, read> last: array<u32>;
@group(0) @binding(7) var<storage, read_write> records: array<f32>;
// Per position in the lists, a byte: which blocks the splat reaches.
@group(0) @binding(8) var<storage, read> hits: array<u32>;

// Per splat of the batch and sum: a value per lane. A row has a word more than lanes, so that lanes that add up
// different rows read different banks.
var<workgroup> sums: array<f32, RECORD_WORDS>;
var<workgroup> longest: atomic<u32>;
var<workgroup> needed: u32;

// How many splats of the tile's list some pixel needs.
fn needed_of(tile: u32, lane: u32) -> u32 {
    atomicMax(&longest, last[tile * TILE_LANES + lane]);
    workgroupBarrier();
    if (lane == 0u) {
        needed = atomicLoad(&longest);
    }
    return workgroupUniformLoad(&needed);
}

fn pixels_at(at: u32) -> vec4<f32> {
    return vec4<f32>(
        pixels[at], pixels[at + TILE], pixels[at + 2u * TILE], pixels[at + 3u * TILE],
    );
}

// Eight columns of a block, halves onto halves: lane k of the block has added columns k and k + 4.
fn sum_columns(at: u32) -> f32 {
    let even = sums[at] + sums[at + 2u];
    let odd = sums[at + 1u] + sums[at + 3u];
    return even + odd;
}

fn sum_rows(v: vec4<f32>) -> f32 {
    let two = v.x + v.y;
    let three = two + v.z;
    return three + v.w;
}

// Adds up the partial sums of the n splats from position `start` of the lists on.
fn store_records(start: u32, n: u32, lane: u32) {
    for (var j = lane; j < n * SUMS; j += TILE_LANES) {
        let position = start + j / SUMS;
        var bits = (hits[position / 4u] >> (8u * (position % 4u))) & 255u;
        var left = 0.0;
        var right = 0.0;
        while (bits != 0u) {
            let b = firstTrailingBit(bits);
            bits &= bits - 1u;
            let v = sum_columns(j * (TILE_LANES + 1u) + 4u * b);
            left += select(v, 0.0, b >= 4u);
            right += select(0.0, v, b >= 4u);
        }
        records[start * SUMS + j] = left + right;
    }
}

// Slots behind the last one that a pixel needs.
fn clear_records(end: u32, list_end: u32, lane: u32) {
    for (var j = end * SUMS + lane; j < list_end * SUMS; j += TILE_LANES) {
        records[j] = 0.0;
    }
}

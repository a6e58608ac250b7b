//! Morton (Z-order) codes of up to 21 bits per axis in a `u64`.

/// Greatest octree depth a `u64` Morton code can hold.
pub const MAX_DEPTH: u8 = 21;

/// Interleaves `[x, y, z]`, each below 2^21; x is the most significant bit of each triplet.
#[must_use]
pub fn encode(index: [u32; 3]) -> u64 {
    (spread(index[0]) << 2) | (spread(index[1]) << 1) | spread(index[2])
}

/// The inverse of [`encode`].
#[must_use]
pub fn decode(code: u64) -> [u32; 3] {
    [gather(code >> 2), gather(code >> 1), gather(code)]
}

fn spread(v: u32) -> u64 {
    let mut x = u64::from(v) & 0x1f_ffff;
    x = (x | (x << 32)) & 0x001f_0000_0000_ffff;
    x = (x | (x << 16)) & 0x001f_0000_ff00_00ff;
    x = (x | (x << 8)) & 0x100f_00f0_0f00_f00f;
    x = (x | (x << 4)) & 0x10c3_0c30_c30c_30c3;
    (x | (x << 2)) & 0x1249_2492_4924_9249
}

fn gather(code: u64) -> u32 {
    let mut x = code & 0x1249_2492_4924_9249;
    x = (x | (x >> 2)) & 0x10c3_0c30_c30c_30c3;
    x = (x | (x >> 4)) & 0x100f_00f0_0f00_f00f;
    x = (x | (x >> 8)) & 0x001f_0000_ff00_00ff;
    x = (x | (x >> 16)) & 0x001f_0000_0000_ffff;
    ((x | (x >> 32)) & 0x1f_ffff) as u32
}

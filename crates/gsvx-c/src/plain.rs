//! Plain data that crosses the border. The comments are the header's.

/// What became of a call.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Status {
    /// It did what it promises.
    Ok = 0,
    /// The bytes are no gsvx stream.
    NotGsvx = 1,
    /// A stream of another version of the format.
    Version = 2,
    /// Bytes that the call needs have not been given. If there are no more, the file is truncated.
    Truncated = 3,
    /// The stream is damaged.
    Damaged = 4,
    /// More Gaussians than the limit; see `gsvx_options.max_gaussians`.
    Limit = 5,
    /// An argument is a null pointer or out of its range.
    Argument = 6,
    /// The caller's buffer is too small. Nothing was written to it.
    Buffer = 7,
    /// The model cannot be encoded.
    Model = 8,
    /// A mistake in gsvx. Close the stream: all further calls on it fail.
    Internal = 9,
}

/// Coordinate axes. Lengths stay as they are in every one.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub enum Axes {
    /// As trained and stored: right-handed, x to the right, y down, z forward.
    Stored = 0,
    /// Right-handed: x to the right, y up, z backward, as in OpenGL.
    YUp = 1,
    /// Left-handed: x to the right, y up, z forward.
    Unity = 2,
    /// Left-handed: x forward, y to the right, z up. Unreal's unit is the centimetre; the scene's stays what it
    /// is, so a scene in metres is to be scaled by 100.
    Unreal = 3,
}

/// Arrays that `gsvx_copy` writes, Gaussian after Gaussian. `d` is `gsvx_info.sh_degree`. "float" is a 32-bit
/// float and "word" a 32-bit unsigned integer, both in the byte order of the machine.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Array {
    /// 3 floats: x, y, z.
    Means = 0,
    /// 4 floats: a quaternion w, x, y, z. In exact chunks its length need not be 1.
    Rotations = 1,
    /// 3 floats: natural logarithms of the standard deviations along the Gaussian's axes.
    LogScales = 2,
    /// 1 float: the opacity before the sigmoid.
    OpacityLogits = 3,
    /// 3 (d + 1)^2 floats: coefficient after coefficient of the spherical harmonics (SH), each red, green, blue, in
    /// the order and with the signs of 3DGS. The first is degree 0: the base colour is 0.5 + 0.28209479 times it. PLY
    /// files have degree 0 as f_dc, and as f_rest all further coefficients of red, then of green, then of blue.
    Sh = 4,
    /// 3 floats: standard deviations along the Gaussian's axes.
    Scales = 5,
    /// 4 floats: red, green and blue of the base colour in sRGB, which may be outside 0 to 1, and the opacity from
    /// 0 to 1.
    Colours = 6,
    /// 6 floats: the covariance xx, xy, xz, yy, yz, zz.
    Covariances = 7,
    /// 4 bytes: red, green, blue, opacity, each from 0 to 255.
    ColourBytes = 8,
    /// 12 bytes, if d >= 1: the 3 coefficients of degree 1, each red, green, blue; -1 to 1 is 0 to 255, 128 is 0.
    /// The bytes that are left are 128. Larger coefficients are cut.
    ShBytes1 = 9,
    /// 16 bytes, if d >= 2: the 5 coefficients of degree 2, likewise.
    ShBytes2 = 10,
    /// 24 bytes, if d >= 3: the 7 coefficients of degree 3, likewise.
    ShBytes3 = 11,
    /// 4 words: x, y, z as floats; the opacity from 0 to 1 as a half float. These and the next are the arrays of
    /// Spark's ExtSplats.
    PackedA = 12,
    /// 4 words: red and green; blue and the log-scale along x; the log-scales along y and z, all as half floats,
    /// the first in the low bits; the rotation as axis (two numbers of 10 bits on an octahedron, u in the low bits)
    /// and angle (12 bits, half a turn is 4095).
    PackedB = 13,
    /// 4 words, if d >= 1: coefficients 1 to 4. A coefficient is magnitudes of red, green and blue in 8 bits each
    /// from the low bits on, their signs in 3 bits, and an exponent e in 5 bits: the value is
    /// magnitude / 255 * 2^(e - 15).
    PackedSh1 = 14,
    /// 4 words, if d >= 2: coefficients 5 to 8.
    PackedSh2 = 15,
    /// 4 words, if d >= 3: coefficients 9 to 12.
    PackedSh3a = 16,
    /// 4 words, if d >= 3: coefficients 13 to 15, and 0.
    PackedSh3b = 17,
}

/// Text that explains a status: one line in UTF-8 that ends in a zero, cut if it is longer.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct Message {
    /// The text; empty where there is nothing to say.
    pub text: [std::ffi::c_char; 512],
}

/// How a stream is decoded. 0 is the default of each option; NULL stands for all defaults.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct Options {
    /// Axes of all that comes out, bounds included: one of `gsvx_axes`.
    pub axes: u32,
    /// Most SH coefficients for each colour channel: 1 (base colours alone), 4, 9 or 16. Layers with more are never
    /// asked for. 0 stands for all there are.
    pub max_sh_coefficients: u32,
    /// Most Gaussians that a chunk may have. Bounds the memory that a hostile stream can take. 0 stands for as many as
    /// take, as floats, 1024 bytes for each byte of the chunk and 64 MiB more, which no trained scene exceeds.
    pub max_gaussians: u64,
}

/// What holds for the whole stream.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct Info {
    /// Gaussians of the finest level of detail, those of exact chunks included.
    pub gaussians: u64,
    /// Bytes of the whole stream. A shorter file is truncated, even if what was asked for is all there.
    pub bytes: u64,
    /// Number of chunks, of all levels of detail: from the coarsest to the finest, then exact chunks.
    pub chunks: u64,
    /// Number of levels of detail, 1 or more. Level 0 is the finest.
    pub levels: u32,
    /// SH degree of the arrays, 0 to 3: the stream's, or less if `gsvx_options.max_sh_coefficients` says so.
    pub sh_degree: u32,
    /// Least coordinates of the means of the finest level; infinity in a stream without Gaussians. Means of coarse
    /// levels may lie outside.
    pub low: [f32; 3],
    /// Greatest coordinates of the means of the finest level; minus infinity in a stream without Gaussians.
    pub high: [f32; 3],
    /// 1 if the model was trained to be drawn with opacity compensated for the blur of 0.3 square pixels
    /// (Mip-Splatting, gsplat's "antialiased"), otherwise 0.
    pub antialiased: u32,
}

/// What the index knows of a chunk: a part of the scene that decodes alone.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct Chunk {
    /// Number of its Gaussians.
    pub gaussians: u64,
    /// The chunks of the next finer level that together replace this one are `finer_begin`,
    /// `finer_begin + 1` ... `finer_end - 1`. Both are 0 in a chunk of the finest level. Exact chunks are in no such
    /// range.
    pub finer_begin: u64,
    /// See `finer_begin`.
    pub finer_end: u64,
    /// Least coordinates of the means.
    pub low: [f32; 3],
    /// Greatest coordinates of the means.
    pub high: [f32; 3],
    /// Level of detail: 0 is the finest. 0 for an exact chunk too.
    pub level: u32,
    /// 1 if its Gaussians are coded bit for bit, otherwise 0. Such a chunk has one layer, with all SH degrees. It
    /// belongs to every level of detail: show it beside the chunks of any level.
    pub exact: u32,
    /// Number of its layers that are of use: the base layer (means, shapes, opacities, base colours) and one for
    /// each SH degree up to `gsvx_info.sh_degree`. Layers of coarse levels may have no bytes.
    pub layers: u32,
}

/// A frame that is held, and the sequence that it is of.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct Frame {
    /// Frames of the sequence.
    pub frames: u64,
    /// Gaussians of this frame.
    pub gaussians: u64,
    /// Frames per second.
    pub fps: f32,
    /// SH degree of the arrays: see `gsvx_info.sh_degree`.
    pub sh_degree: u32,
}

/// Bytes of the stream from `begin` to before `end`, counted from its first.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct ByteRange {
    /// The first byte.
    pub begin: u64,
    /// The byte behind the last.
    pub end: u64,
}

/// A model in the parametrisation of 3DGS training. The arrays are as those of `gsvx_array`; they are only read,
/// and not after `gsvx_encode` returns. Without Gaussians they may be NULL.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct Model {
    /// Number of Gaussians.
    pub gaussians: u64,
    /// 3 floats for each Gaussian.
    pub means: *const f32,
    /// 4 floats for each Gaussian: w, x, y, z.
    pub rotations: *const f32,
    /// 3 floats for each Gaussian: natural logarithms.
    pub log_scales: *const f32,
    /// 1 float for each Gaussian.
    pub opacity_logits: *const f32,
    /// 3 (sh_degree + 1)^2 floats for each Gaussian.
    pub sh: *const f32,
    /// 0 to 3.
    pub sh_degree: u32,
    /// One of `gsvx_axes`.
    pub axes: u32,
    /// See `gsvx_info.antialiased`.
    pub antialiased: u32,
}

/// What a stream aims for. 0 is the default of each option; NULL stands for all defaults.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct EncodeOptions {
    /// If not 0: the best stream of at most so many bytes. `quality` has no effect then.
    pub max_bytes: u64,
    /// From above 0 (smallest) to 100 (best); 15 points more make all values twice as precise. 0 stands for 80, where
    /// a difference is hard to see.
    pub quality: f32,
}

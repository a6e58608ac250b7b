// A projected Gaussian.
struct Splat {
    // x, y, p, q
    a: vec4<f32>,
    // r, cut, opacity
    b: vec3<f32>,
    // Tiles that it may touch: columns, the first in the low half and one past the last in the high half.
    columns: u32,
    // colour
    c: vec3<f32>,
    // Rows, likewise.
    rows: u32,
}

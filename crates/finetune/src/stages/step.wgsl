// Everything about a step that is not an array; `gpu::StepUniform` in Rust.
struct StepUniform {
    w0: vec4<f32>,
    w1: vec4<f32>,
    w2: vec4<f32>,
    eye: vec4<f32>,
    // fx, fy, cx, cy
    lens: vec4<f32>,
    // lo_x, hi_x, lo_y, hi_y
    limits: vec4<f32>,
    background: vec4<f32>,
    width: u32,
    height: u32,
    tiles_x: u32,
    tiles_y: u32,
    // Number of Gaussians, SH coefficients of each, 1 for the reference profile, slots.
    count: u32,
    sh_len: u32,
    reference: u32,
    capacity: u32,
    // Entry of the loss ring, number of the step, 1 if the opacity of the Gaussians is compensated for the blur.
    loss_slot: u32,
    step: u32,
    antialiased: u32,
    // A number for kernels of another crate.
    extra: f32,
    // Learning rates: SH DC, other SH, opacity, log-scale; rotation; Adam's second correction. Kernels of another
    // crate have four rates of their own.
    rates: vec4<f32>,
    rotation_rate: f32,
    inv_sqrt_bias2: f32,
    // Splats that there is room for.
    most_splats: u32,
    // What the gradients of the view are multiplied by.
    view_weight: f32,
    // The band of the view: its first row of tiles and one past its last.
    first_row: u32,
    end_row: u32,
    // Weights of the loss: the absolute error, the squared error, 1 - SSIM.
    l1: f32,
    mse: f32,
    ssim: f32,
    // Variance of the low-pass filter, pixels squared.
    blur: f32,
    // Learning rate of the means; zero if they stay.
    mean_rate: f32,
}

@group(0) @binding(0) var<uniform> u: StepUniform;

// Dispatches of more than 65535 workgroups are folded into rows of this length.
fn group_index(group: vec3<u32>) -> u32 {
    return group.y * DISPATCH_ROW + group.x;
}

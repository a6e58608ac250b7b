//! A driver's limit on loops.
//!
//! Mesa's software Vulkan (22.3.6) gives every invocation 65,535 iterations, counted over all its
//! loops, and then ends its loops without an error. The rest of a long list would be missing from
//! the image. Splitting or nesting the loops does not help, because there is one count. Therefore
//! every device is measured once, and where there is a limit, a step that might reach it is refused.

use super::device::Context;
use super::uniform::StepUniform;
use crate::error::{Error, Result};

/// Iterations of the measurement.
const TRIED: u32 = 70_000;

const SOURCE: &str = "
    @group(0) @binding(0) var<storage, read_write> out: array<u32>;
    @compute @workgroup_size(1)
    fn count() {
        var n = 0u;
        for (var i = 0u; i < out[1]; i++) { n += 1u; }
        out[0] = n;
    }";

/// Iterations after which the driver ends loops, if it does.
pub(super) fn limit(context: &Context) -> Result<Option<u32>> {
    let module = context.device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: Some("loops"),
        source: wgpu::ShaderSource::Wgsl(SOURCE.into()),
    });
    let pipeline = context.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: Some("loops"),
        layout: None,
        module: &module,
        entry_point: Some("count"),
        compilation_options: Default::default(),
        cache: None,
    });
    let buffer = context.device.create_buffer(&wgpu::BufferDescriptor {
        label: Some("loops"),
        size: 8,
        usage: wgpu::BufferUsages::STORAGE
            | wgpu::BufferUsages::COPY_SRC
            | wgpu::BufferUsages::COPY_DST,
        mapped_at_creation: false,
    });
    let group = context.device.create_bind_group(&wgpu::BindGroupDescriptor {
        label: Some("loops"),
        layout: &pipeline.get_bind_group_layout(0),
        entries: &[wgpu::BindGroupEntry { binding: 0, resource: buffer.as_entire_binding() }],
    });
    context.queue.write_buffer(&buffer, 0, bytemuck::cast_slice(&[0, TRIED]));
    let mut encoder = context.device.create_command_encoder(&Default::default());
    {
        let mut pass = encoder.begin_compute_pass(&Default::default());
        pass.set_pipeline(&pipeline);
        pass.set_bind_group(0, &group, &[]);
        pass.dispatch_workgroups(1, 1, 1);
    }
    context.queue.submit([encoder.finish()]);
    let counted: u32 = bytemuck::pod_read_unaligned(&context.read(&buffer, 4)?);
    Ok((counted < TRIED).then_some(counted))
}

/// Upper bound of the iterations of `blend_adjoint` per splat of a tile's list: one for its bit, seven
/// of its record's words over 32 lanes with up to eight for the blocks of each, and, for each batch
/// of 16 splats, one round and four words of `reaching`. `blend` needs fewer.
const PER_SPLAT: u32 = 4;

/// Iterations of all other loops: clearing tables, summing blocks of losses.
const OTHER: u32 = 500;

/// Longest list of a tile that stays below a limit on loops.
pub(super) fn longest_list(limit: u32) -> u32 {
    limit.saturating_sub(OTHER) / PER_SPLAT
}

/// Refuses a view with so many tiles that the loops over the tiles of a Gaussian might reach the
/// limit.
pub(super) fn check_view(limit: u32, u: &StepUniform) -> Result<()> {
    // `emit` visits a box of tiles row by row.
    let iterations = u.tiles_x * u.tiles_y + u.tiles_y + OTHER;
    if iterations <= limit {
        return Ok(());
    }
    let (w, h) = (u.width, u.height);
    let reason = format!("the driver ends loops after {limit} iterations, too few for {w}x{h}");
    Err(Error::Gpu { reason })
}

/// Refuses lists that are too long. `offsets` are the starts of the tiles' lists.
pub(super) fn check_lists(limit: u32, offsets: &[u32]) -> Result<()> {
    let longest = offsets.windows(2).map(|w| w[1].saturating_sub(w[0])).max().unwrap_or(0);
    if longest <= longest_list(limit) {
        return Ok(());
    }
    let reason = format!(
        "the driver ends loops after {limit} iterations, too few for {longest} Gaussians in one \
         tile"
    );
    Err(Error::Gpu { reason })
}

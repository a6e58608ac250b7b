//! The codec on the device: its uniform, the bind groups of its levels, and the order of its stages.

use super::workspace::Workspace;
use crate::latents::Codec;

/// `Codec` of `stages/codec/codec.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, bytemuck::Pod, bytemuck::Zeroable)]
struct CodecUniform {
    /// Of opacity, DC, SH degrees 1 to 3, covariance.
    steps: [f32; 6],
    no_step: [f32; 2],
    leaves: u32,
    channels: u32,
    sh_degree: u32,
    chunks: u32,
    half_lambda: f32,
    pad: [u32; 3],
}

/// One level of merges.
struct Level {
    merges: u32,
    transform: wgpu::BindGroup,
    quantise: wgpu::BindGroup,
}

/// One pass over all levels, for groups of channels that do not depend on each other.
struct Pass {
    side: wgpu::BindGroup,
    means: wgpu::BindGroup,
    /// From coarse to fine.
    levels: Vec<Level>,
    /// Groups of channels.
    groups: u32,
}

/// What the codec binds.
pub(crate) struct CodecGroups {
    uniform: wgpu::Buffer,
    passes: Vec<Pass>,
}

impl Workspace {
    /// Uploads what does not change of a codec, and binds its stages.
    pub(crate) fn set_codec(&mut self, codec: &Codec) {
        let merges: Vec<[u32; 6]> = codec
            .merges
            .iter()
            .map(|m| {
                let [share, scale, gain] = [m.share, m.scale, m.noise_gain].map(f32::to_bits);
                [m.left, m.right, m.parent, share, scale, gain]
            })
            .collect();
        self.write("merges", merges.as_flattened());
        self.write("leaf_words", &codec.leaf_words());
        self.write("leaf_weights", &codec.leaves.iter().map(|l| l.weight).collect::<Vec<_>>());
        let uniform = self.context.uniform("codec", size_of::<CodecUniform>());
        let level =
            |pass: u32, [first, count]: [u32; 2]| self.constant("level", &[first, count, pass, 0]);
        let bind = |shader, level: &wgpu::Buffer| {
            self.bind_group(shader, &[], &[("codec", &uniform), ("level", level)])
        };
        let one_pass = |pass: u32| {
            let none = level(pass, [0, 0]);
            let levels = codec.levels.windows(2).filter(|w| w[0] < w[1]).map(|w| {
                let buffer = level(pass, [w[0], w[1] - w[0]]);
                Level {
                    merges: w[1] - w[0],
                    transform: bind("transform", &buffer),
                    quantise: bind("quantise", &buffer),
                }
            });
            Pass {
                side: bind("side", &none),
                means: bind("quantise", &none),
                levels: levels.collect(),
                groups: match pass {
                    0 => 3 + u32::from(codec.sh_degree >= 1),
                    _ => 1,
                },
            }
        };
        let passes = (0..u32::from(codec.sh_degree).max(1)).map(one_pass).collect();
        for shader in ["rebuild", "move_latents"] {
            let group = self.bind_group(shader, &[], &[("codec", &uniform)]);
            self.groups.insert(shader, group);
        }
        self.codec = Some(CodecGroups { uniform, passes });
        self.update_codec(codec);
    }

    /// Uploads steps and predictions.
    pub(crate) fn update_codec(&self, codec: &Codec) {
        let Some(groups) = &self.codec else { return };
        let uniform = CodecUniform {
            steps: codec.steps,
            leaves: codec.leaves.len() as u32,
            channels: codec.channels() as u32,
            sh_degree: codec.sh_degree.into(),
            chunks: codec.chunks.len() as u32,
            half_lambda: 0.5 * codec.lambda,
            ..CodecUniform::default()
        };
        self.context.queue.write_buffer(&groups.uniform, 0, bytemuck::bytes_of(&uniform));
        let (chunks, factors) = codec.chunk_words();
        self.write("chunks", &chunks);
        self.write("sh_factors", &factors);
    }

    /// Workgroups of one lane per leaf.
    pub(super) fn leaf_groups(&self) -> u32 {
        (self.sizes.codec.leaves as u32).div_ceil(64)
    }

    /// Records the codec.
    pub(super) fn code(&self, pass: &mut wgpu::ComputePass<'_>) {
        let Some(codec) = &self.codec else { return };
        let leaves = self.leaf_groups();
        for p in &codec.passes {
            let lanes = |tasks: u32| (tasks * p.groups).div_ceil(64);
            self.dispatch(pass, "side", "load", &p.side, leaves, 1);
            for level in p.levels.iter().rev() {
                let groups = lanes(level.merges);
                self.dispatch(pass, "transform", "transform", &level.transform, groups, 1);
            }
            let chunks = lanes(self.sizes.codec.chunks as u32);
            self.dispatch(pass, "quantise", "quantise_means", &p.means, chunks, 1);
            for level in &p.levels {
                let groups = lanes(level.merges);
                self.dispatch(pass, "quantise", "quantise", &level.quantise, groups, 1);
            }
            self.dispatch(pass, "side", "add_predicted", &p.side, leaves, 1);
        }
        self.dispatch(pass, "rebuild", "rebuild", self.group("rebuild"), leaves, 1);
    }
}

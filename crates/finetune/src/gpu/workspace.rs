//! The device's buffers, pipelines and bind groups.

use std::collections::BTreeMap;

use gs_model::Scene;

use super::device::Context;
use super::uniform::StepUniform;
use crate::error::{Error, Result};
use crate::shaders::{Access, BLOCKS, RADIX_BLOCK, SCAN_BLOCK, SHADERS, bindings};
use crate::stages::adam::Moments;

/// Losses that the device keeps before the host has to fetch them.
pub(crate) const LOSS_RING: usize = 256;

/// Sizes that the buffers are made for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Sizes {
    /// Gaussians.
    pub(crate) count: usize,
    /// SH coefficients of each.
    pub(crate) sh_len: usize,
    /// Slots: (Gaussian, tile) pairs.
    pub(crate) capacity: usize,
    /// Tiles of the largest view.
    pub(crate) tiles: usize,
    /// Pixels of the largest view.
    pub(crate) pixels: usize,
}

impl Sizes {
    fn blocks(n: usize) -> usize {
        n.div_ceil(RADIX_BLOCK as usize).max(1)
    }

    pub(crate) fn depth_blocks(&self) -> usize {
        Self::blocks(self.count)
    }

    pub(crate) fn tile_blocks(&self) -> usize {
        Self::blocks(self.capacity)
    }

    /// Every buffer by name, with its length in 32-bit words.
    fn buffers(&self) -> Vec<(&'static str, usize)> {
        let Self { count: n, sh_len: k, capacity, tiles, pixels } = *self;
        let mut list = vec![
            ("means", 3 * n),
            ("geo", 8 * n),
            ("geo_m", 8 * n),
            ("geo_v", 8 * n),
            ("sh", 3 * k * n),
            ("sh_m", 3 * k * n),
            ("sh_v", 3 * k * n),
            ("splats", 12 * n),
            ("boxes", 4 * n),
            ("keys", n),
            ("counts", n),
            ("depth_keys_a", n),
            ("depth_keys_b", n),
            ("order_a", n),
            ("order", n),
            ("starts", n + 1),
            ("state", 4),
            ("slot_tiles", capacity),
            ("slot_ids", capacity),
            ("tile_keys_a", capacity),
            ("tile_keys_b", capacity),
            ("tile_slots_a", capacity),
            ("tile_slots_b", capacity),
            ("depth_histogram", 16 * self.depth_blocks()),
            ("tile_histogram", 16 * self.tile_blocks()),
            ("ids", capacity),
            ("places", capacity),
            // One more than there are: `reaching` looks ahead.
            ("hits", capacity.div_ceil(4) + 2),
            ("offsets", tiles + 1),
            ("pixels", 1024 * tiles),
            ("last", BLOCKS as usize * tiles),
            ("gradient", 768 * tiles),
            ("records", 7 * capacity),
            ("sums", 7 * n + 1),
            ("moments", 15 * pixels),
            ("partials", 18 * pixels),
            ("values", 6 * pixels),
            ("losses", 2 * LOSS_RING),
            ("block_sums", 2 * (3 * pixels).div_ceil(4096)),
        ];
        for (name, length) in self.scans() {
            for (level, words) in scan_lengths(length).into_iter().enumerate() {
                list.push((SCAN_TOTALS[name as usize][level], words.div_ceil(SCAN_BLOCK as usize)));
            }
        }
        list
    }

    /// The arrays that are scanned, and their lengths.
    pub(crate) fn scans(&self) -> [(Scan, usize); 3] {
        [
            (Scan::Starts, self.count + 1),
            (Scan::DepthHistogram, 16 * self.depth_blocks()),
            (Scan::TileHistogram, 16 * self.tile_blocks()),
        ]
    }
}

/// An array that is scanned.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Scan {
    Starts,
    DepthHistogram,
    TileHistogram,
}

/// Levels of a scan: 1024^4 values are more than a buffer can hold.
const LEVELS: usize = 4;
const SCAN_TOTALS: [[&str; LEVELS]; 3] = [
    ["starts_1", "starts_2", "starts_3", "starts_4"],
    ["depth_histogram_1", "depth_histogram_2", "depth_histogram_3", "depth_histogram_4"],
    ["tile_histogram_1", "tile_histogram_2", "tile_histogram_3", "tile_histogram_4"],
];
const SCANNED: [&str; 3] = ["starts", "depth_histogram", "tile_histogram"];

/// Lengths of the arrays that the levels of a scan of `length` values work on.
fn scan_lengths(mut length: usize) -> Vec<usize> {
    let mut out = vec![length];
    while length > SCAN_BLOCK as usize && out.len() < LEVELS {
        length = length.div_ceil(SCAN_BLOCK as usize);
        out.push(length);
    }
    out
}

/// One dispatch: pipeline, bind group, and number of workgroups (folded by the encoder).
pub(crate) struct Level {
    pub(crate) group: wgpu::BindGroup,
    pub(crate) blocks: u32,
}

struct Pipeline {
    layout: wgpu::BindGroupLayout,
    bindings: Vec<crate::shaders::Binding>,
    entries: BTreeMap<&'static str, wgpu::ComputePipeline>,
}

/// Everything on the device.
pub(crate) struct Workspace {
    pub(crate) context: Context,
    pub(crate) sizes: Sizes,
    pipelines: BTreeMap<&'static str, Pipeline>,
    buffers: BTreeMap<&'static str, wgpu::Buffer>,
    pub(crate) uniform: wgpu::Buffer,
    groups: BTreeMap<&'static str, wgpu::BindGroup>,
    /// Eight passes over the depth keys.
    pub(crate) depth_passes: Vec<wgpu::BindGroup>,
    /// Passes over the tile keys, as many as the largest tile index needs.
    pub(crate) tile_passes: Vec<wgpu::BindGroup>,
    scans: Vec<Vec<Level>>,
}

impl Workspace {
    pub(crate) fn new(context: Context, sizes: Sizes) -> Result<Self> {
        let pipelines = SHADERS.iter().map(|s| (s.name, pipeline(&context.device, s))).collect();
        let uniform = context.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("step"),
            size: size_of::<StepUniform>() as u64,
            usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        let mut out = Self {
            context,
            sizes,
            pipelines,
            buffers: BTreeMap::new(),
            uniform,
            groups: BTreeMap::new(),
            depth_passes: Vec::new(),
            tile_passes: Vec::new(),
            scans: Vec::new(),
        };
        for (name, words) in sizes.buffers() {
            let buffer = out.storage(name, words)?;
            out.buffers.insert(name, buffer);
        }
        out.bind();
        out.context.check()?;
        Ok(out)
    }

    /// A storage buffer of `words` 32-bit words, zeroed.
    pub(crate) fn storage(&self, name: &str, words: usize) -> Result<wgpu::Buffer> {
        let size = 4 * words.max(4) as u64;
        let l = &self.context.limits;
        let limit = l.max_storage_buffer_binding_size.min(l.max_buffer_size);
        if size > limit {
            let reason = format!("{name} needs {size} bytes, the adapter binds {limit}");
            return Err(Error::Gpu { reason });
        }
        Ok(self.context.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some(name),
            size,
            usage: wgpu::BufferUsages::STORAGE
                | wgpu::BufferUsages::COPY_DST
                | wgpu::BufferUsages::COPY_SRC,
            mapped_at_creation: false,
        }))
    }

    /// Makes the slot buffers larger. Their contents are lost.
    pub(crate) fn grow(&mut self, capacity: usize) -> Result<()> {
        let old = self.sizes.buffers();
        self.sizes.capacity = capacity;
        for (name, words) in self.sizes.buffers() {
            if !old.contains(&(name, words)) {
                let buffer = self.storage(name, words)?;
                self.buffers.insert(name, buffer);
            }
        }
        self.bind();
        self.context.check()
    }

    /// The buffer of that name; all names are in [`Sizes::buffers`].
    pub(crate) fn buffer(&self, name: &str) -> &wgpu::Buffer {
        // proof: names come from the shaders' own text and from this module; the conformance
        // test binds every one of them.
        &self.buffers[name]
    }

    pub(crate) fn write<T: bytemuck::NoUninit>(&self, name: &str, data: &[T]) {
        self.context.queue.write_buffer(self.buffer(name), 0, bytemuck::cast_slice(data));
    }

    pub(crate) fn read<T: bytemuck::AnyBitPattern>(&self, name: &str, n: usize) -> Result<Vec<T>> {
        let bytes = self.context.read(self.buffer(name), (n * size_of::<T>()) as u64)?;
        Ok(bytes.chunks_exact(size_of::<T>()).map(bytemuck::pod_read_unaligned).collect())
    }

    pub(crate) fn pipeline(&self, shader: &str, entry: &str) -> &wgpu::ComputePipeline {
        // proof: as for `buffer`.
        &self.pipelines[shader].entries[entry]
    }

    pub(crate) fn group(&self, shader: &str) -> &wgpu::BindGroup {
        // proof: as for `buffer`.
        &self.groups[shader]
    }

    pub(crate) fn scan_levels(&self, scan: Scan) -> &[Level] {
        &self.scans[scan as usize]
    }

    /// Index in `tile_passes` is odd or even: which of the pair of buffers the last pass wrote.
    fn sorted_tiles(&self) -> (&'static str, &'static str) {
        if self.tile_passes.len() % 2 == 1 {
            ("tile_keys_a", "tile_slots_a")
        } else {
            ("tile_keys_b", "tile_slots_b")
        }
    }

    fn bind(&mut self) {
        self.depth_passes = self.passes(
            8,
            (0, self.sizes.depth_blocks()),
            "keys",
            [("depth_keys_a", "order_a"), ("depth_keys_b", "order")],
            "depth_histogram",
        );
        // The sentinel is the number of tiles.
        let bits = usize::BITS - self.sizes.tiles.leading_zeros();
        self.tile_passes = self.passes(
            bits.div_ceil(4).max(1),
            (1, self.sizes.tile_blocks()),
            "slot_tiles",
            [("tile_keys_a", "tile_slots_a"), ("tile_keys_b", "tile_slots_b")],
            "tile_histogram",
        );
        let (keys, slots) = self.sorted_tiles();
        for shader in
            ["project", "emit", "ranges", "reach", "blend", "blend_adjoint", "gather", "adam"]
        {
            let group = self.bind_group(shader, &[("tile_keys", keys), ("tile_slots", slots)], &[]);
            self.groups.insert(shader, group);
        }
        self.scans = self.sizes.scans().iter().map(|&(s, n)| self.bind_scan(s, n)).collect();
    }

    /// Bind groups of the passes of a radix sort: from `keys` (with values 0, 1, 2 ..) to the
    /// first of `pairs`, from there to the second, and back.
    fn passes(
        &self,
        count: u32,
        (count_slot, blocks): (u32, usize),
        keys: &'static str,
        pairs: [(&'static str, &'static str); 2],
        histogram: &'static str,
    ) -> Vec<wgpu::BindGroup> {
        (0..count)
            .map(|k| {
                let words = [4 * k, count_slot, blocks as u32, u32::from(k == 0)];
                let pass = self.constant("radix pass", &words);
                let (keys_out, values_out) = pairs[k as usize % 2];
                let (from, values_in) = pairs[(k as usize + 1) % 2];
                let keys_in = if k == 0 { keys } else { from };
                let names = [
                    ("keys_in", keys_in),
                    ("values_in", values_in),
                    ("keys_out", keys_out),
                    ("values_out", values_out),
                    ("histogram", histogram),
                ];
                self.bind_group("sort", &names, &[("p", &pass)])
            })
            .collect()
    }

    fn bind_scan(&self, scan: Scan, length: usize) -> Vec<Level> {
        let mut values = SCANNED[scan as usize];
        let mut out = Vec::new();
        for (k, n) in scan_lengths(length).into_iter().enumerate() {
            let totals = SCAN_TOTALS[scan as usize][k];
            let level = self.constant("scan level", &[n as u32, 0, 0, 0]);
            let names = [("values", values), ("totals", totals)];
            out.push(Level {
                group: self.bind_group("scan", &names, &[("level", &level)]),
                blocks: n.div_ceil(SCAN_BLOCK as usize) as u32,
            });
            values = totals;
        }
        out
    }

    fn constant(&self, label: &str, words: &[u32; 4]) -> wgpu::Buffer {
        let buffer = self.context.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some(label),
            size: 16,
            usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        self.context.queue.write_buffer(&buffer, 0, bytemuck::cast_slice(words));
        buffer
    }

    /// Binds a shader's variables to the buffers of the same names, but for those in `renamed`
    /// (variable, buffer) and `extra`.
    pub(crate) fn bind_group(
        &self,
        shader: &'static str,
        renamed: &[(&str, &str)],
        extra: &[(&str, &wgpu::Buffer)],
    ) -> wgpu::BindGroup {
        // proof: as for `buffer`.
        let pipeline = &self.pipelines[shader];
        let entries: Vec<_> = pipeline
            .bindings
            .iter()
            .map(|b| {
                let name = b.name.as_str();
                let other = renamed.iter().find(|r| r.0 == name).map_or(name, |r| r.1);
                let buffer = match extra.iter().find(|e| e.0 == name) {
                    Some(e) => e.1,
                    None if name == "u" => &self.uniform,
                    None => self.buffer(other),
                };
                wgpu::BindGroupEntry { binding: b.index, resource: buffer.as_entire_binding() }
            })
            .collect();
        self.context.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some(shader),
            layout: &pipeline.layout,
            entries: &entries,
        })
    }

    /// Uploads a scene and the optimiser's moments.
    pub(crate) fn upload(&self, scene: &Scene, moments: &Moments) {
        self.write("means", scene.means.as_flattened());
        self.write("sh", scene.sh.as_flattened());
        let [sh_m, sh_v] = &moments.sh;
        self.write("sh_m", sh_m);
        self.write("sh_v", sh_v);
        let geo = |o: &[f32], l: &[f32], q: &[f32]| -> Vec<f32> {
            let mut out = Vec::with_capacity(8 * o.len());
            for ((o, l), q) in o.iter().zip(l.chunks_exact(3)).zip(q.chunks_exact(4)) {
                out.push(*o);
                out.extend_from_slice(l);
                out.extend_from_slice(q);
            }
            out
        };
        let (l, q) = (scene.log_scales.as_flattened(), scene.rotations.as_flattened());
        self.write("geo", &geo(&scene.opacity_logits, l, q));
        for (k, name) in ["geo_m", "geo_v"].into_iter().enumerate() {
            let m = moments;
            self.write(name, &geo(&m.opacity[k], &m.log_scale[k], &m.rotation[k]));
        }
    }

    /// Uploads what the Rust executor projected and repeats the stages that make the lists of it,
    /// so that `blend` and its adjoint have the same inputs on both sides.
    pub(crate) fn upload_lists(&self, forward: &crate::forward::Forward, u: &StepUniform) {
        use super::passes::Stage;
        let (projected, lists) = (&forward.projected, &forward.lists);
        let mut counts = vec![0u32; projected.splats.len()];
        for &i in &lists.ids {
            counts[i as usize] += 1;
        }
        self.write("keys", &projected.keys);
        self.write("splats", &projected.splats);
        self.write("boxes", &projected.boxes);
        self.write("counts", &counts);
        self.write("state", &[counts.len() as u32, lists.ids.len() as u32, 0, 0]);
        self.run(&[Stage::SortDepth, Stage::Emit, Stage::SortTile, Stage::Ranges], u, None);
        self.write("ids", &lists.ids);
        self.write("offsets", &lists.offsets);
    }

    /// The inverse of [`Workspace::upload`], but for the means and the degree, which stay.
    pub(crate) fn download(&self, scene: &mut Scene, moments: &mut Moments) -> Result<()> {
        let n = self.sizes.count;
        let split = |geo: &[f32], o: &mut [f32], l: &mut [f32], q: &mut [f32]| {
            let geo = geo.chunks_exact(8);
            for (((g, o), l), q) in geo.zip(o).zip(l.chunks_exact_mut(3)).zip(q.chunks_exact_mut(4))
            {
                *o = g[0];
                l.copy_from_slice(&g[1..4]);
                q.copy_from_slice(&g[4..8]);
            }
        };
        let (l, q) = (scene.log_scales.as_flattened_mut(), scene.rotations.as_flattened_mut());
        split(&self.read("geo", 8 * n)?, &mut scene.opacity_logits, l, q);
        for (k, name) in ["geo_m", "geo_v"].into_iter().enumerate() {
            let m = &mut *moments;
            let geo = self.read::<f32>(name, 8 * n)?;
            split(&geo, &mut m.opacity[k], &mut m.log_scale[k], &mut m.rotation[k]);
        }
        let words = 3 * self.sizes.sh_len * n;
        scene.sh.as_flattened_mut().copy_from_slice(&self.read::<f32>("sh", words)?);
        moments.sh = [self.read("sh_m", words)?, self.read("sh_v", words)?];
        Ok(())
    }
}

fn pipeline(device: &wgpu::Device, shader: &crate::shaders::Shader) -> Pipeline {
    let source = shader.source();
    let bindings = bindings(&source);
    let entries: Vec<_> = bindings
        .iter()
        .map(|b| wgpu::BindGroupLayoutEntry {
            binding: b.index,
            visibility: wgpu::ShaderStages::COMPUTE,
            ty: wgpu::BindingType::Buffer {
                ty: match b.access {
                    Access::Uniform => wgpu::BufferBindingType::Uniform,
                    access => {
                        wgpu::BufferBindingType::Storage { read_only: access == Access::Read }
                    }
                },
                has_dynamic_offset: false,
                min_binding_size: None,
            },
            count: None,
        })
        .collect();
    let layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
        label: Some(shader.name),
        entries: &entries,
    });
    let pipeline_layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
        label: Some(shader.name),
        bind_group_layouts: &[Some(&layout)],
        immediate_size: 0,
    });
    let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: Some(shader.name),
        source: wgpu::ShaderSource::Wgsl(source.into()),
    });
    let compile = |entry: &&'static str| {
        let pipeline = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some(entry),
            layout: Some(&pipeline_layout),
            module: &module,
            entry_point: Some(entry),
            compilation_options: Default::default(),
            cache: None,
        });
        (*entry, pipeline)
    };
    Pipeline { entries: shader.entries.iter().map(compile).collect(), layout, bindings }
}

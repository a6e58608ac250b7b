//! [`Workspace`]: the buffers, pipelines and bind groups of a run.

use std::collections::BTreeMap;

use super::device::Context;
use super::pipelines::{Pipeline, compile};
use super::program::{Call, Program};
use super::sizes::{Lengths, SCAN_TOTALS, SCANNED, Scan, Sizes, scan_lengths};
use super::uniform::StepUniform;
use crate::error::{Error, Result};
use crate::shaders::{SCAN_BLOCK, SHADERS, Shader};

/// One level of a scan: its bind group and its number of workgroups (folded by the encoder).
pub(crate) struct ScanLevel {
    pub(crate) group: wgpu::BindGroup,
    pub(crate) blocks: u32,
}

/// A radix sort: from `keys` (with values 0, 1, 2 ..) to the first of `pairs`, from there to the second, and back.
struct RadixSort {
    passes: u32,
    /// Where `state` has the number of pairs.
    count_slot: u32,
    blocks: u32,
    keys: &'static str,
    /// Keys and values.
    pairs: [(&'static str, &'static str); 2],
    histogram: &'static str,
}

/// Everything on the device.
pub(crate) struct Workspace {
    pub(crate) context: Context,
    pub(crate) sizes: Sizes,
    pipelines: BTreeMap<&'static str, Pipeline>,
    /// By name: one for each page, or the only one.
    buffers: BTreeMap<&'static str, Vec<wgpu::Buffer>>,
    pub(crate) uniform: wgpu::Buffer,
    /// First Gaussian and length of each page.
    pages: Vec<wgpu::Buffer>,
    /// By shader: one for each page, or the only one.
    pub(super) groups: BTreeMap<&'static str, Vec<wgpu::BindGroup>>,
    /// Eight passes over the depth keys.
    pub(crate) depth_passes: Vec<wgpu::BindGroup>,
    /// Passes over the tile keys, as many as the largest tile index needs.
    pub(crate) tile_passes: Vec<wgpu::BindGroup>,
    /// Of `emit`: the group that counts, and the one that writes.
    pub(super) emits: Vec<wgpu::BindGroup>,
    scans: Vec<Vec<ScanLevel>>,
    /// Calls of kernels of another crate, before and after the other stages.
    pub(super) before: Vec<(Call, wgpu::BindGroup)>,
    pub(super) after: Vec<(Call, wgpu::BindGroup)>,
}

impl Workspace {
    pub(crate) fn new(context: Context, sizes: Sizes, program: Option<&Program>) -> Result<Self> {
        sizes.check(context.binding())?;
        let compiled = |s: &Shader, shared: &str| (s.name, compile(&context.device, s, shared));
        let mut pipelines: BTreeMap<_, _> = SHADERS.iter().map(|s| compiled(s, "")).collect();
        let mut lengths = sizes.buffers();
        if let Some(program) = program {
            program.check()?;
            pipelines.extend(program.shaders.iter().map(|s| compiled(s, &program.shared)));
            lengths.extend(program.lengths());
        }
        let uniform = context.uniform("step", size_of::<StepUniform>());
        let mut out = Self {
            context,
            sizes,
            pipelines,
            buffers: BTreeMap::new(),
            uniform,
            pages: Vec::new(),
            groups: BTreeMap::new(),
            depth_passes: Vec::new(),
            tile_passes: Vec::new(),
            emits: Vec::new(),
            scans: Vec::new(),
            before: Vec::new(),
            after: Vec::new(),
        };
        out.allocate(&lengths)?;
        let mut first = 0;
        for &count in &out.sizes.pages {
            out.pages.push(out.constant("page", &[first, count as u32, 0, 0]));
            first += count as u32;
        }
        out.bind();
        out.context.check()?;
        Ok(out)
    }

    fn allocate(&mut self, lengths: &[Lengths]) -> Result<()> {
        for (name, words) in lengths {
            let buffers = words.iter().map(|&w| self.storage(name, w)).collect::<Result<_>>()?;
            self.buffers.insert(name, buffers);
        }
        Ok(())
    }

    /// A storage buffer of `words` 32-bit words, zeroed.
    pub(crate) fn storage(&self, name: &str, words: usize) -> Result<wgpu::Buffer> {
        let size = 4 * words.max(4) as u64;
        let limit = self.context.binding();
        if size > limit {
            let reason = format!("{name} needs {size} bytes, a binding has at most {limit}");
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

    /// Bytes of all buffers but those of photos.
    pub(crate) fn bytes(&self) -> u64 {
        self.buffers.values().flatten().map(wgpu::Buffer::size).sum()
    }

    /// Makes buffers larger. Their contents are lost.
    pub(crate) fn grow(&mut self, change: impl FnOnce(&mut Sizes)) -> Result<()> {
        let old = self.sizes.buffers();
        change(&mut self.sizes);
        self.sizes.check(self.context.binding())?;
        let mut lengths = self.sizes.buffers();
        lengths.retain(|l| !old.contains(l));
        self.allocate(&lengths)?;
        self.bind();
        self.context.check()
    }

    /// The buffer of that name for a page; all names are in [`Sizes::buffers`] and [`Program::lengths`]. A buffer
    /// without pages is that of every page.
    fn buffer(&self, name: &str, page: usize) -> &wgpu::Buffer {
        // Cannot fail: the names come from the text of the shaders and from this module, and the
        // conformance test binds each of them.
        let buffers = &self.buffers[name];
        if buffers.len() == 1 { &buffers[0] } else { &buffers[page] }
    }

    pub(crate) fn write<T: bytemuck::NoUninit>(&self, name: &str, page: usize, data: &[T]) {
        self.context.queue.write_buffer(self.buffer(name, page), 0, bytemuck::cast_slice(data));
    }

    pub(crate) fn read<T: bytemuck::AnyBitPattern>(
        &self,
        name: &str,
        page: usize,
        n: usize,
    ) -> Result<Vec<T>> {
        let bytes = self.context.read(self.buffer(name, page), (n * size_of::<T>()) as u64)?;
        Ok(bytes.chunks_exact(size_of::<T>()).map(bytemuck::pod_read_unaligned).collect())
    }

    pub(crate) fn pipeline(&self, shader: &str, entry: &str) -> &wgpu::ComputePipeline {
        // Cannot fail, as in `buffer`.
        &self.pipelines[shader].entries[entry]
    }

    pub(crate) fn groups(&self, shader: &str) -> &[wgpu::BindGroup] {
        // Cannot fail, as in `buffer`.
        &self.groups[shader]
    }

    pub(crate) fn scan_levels(&self, scan: Scan) -> &[ScanLevel] {
        &self.scans[scan as usize]
    }

    /// The buffers that the last of `tile_passes` wrote: the passes alternate between two pairs.
    fn sorted_tiles(&self) -> (&'static str, &'static str) {
        if self.tile_passes.len() % 2 == 1 {
            ("tile_keys_a", "tile_slots_a")
        } else {
            ("tile_keys_b", "tile_slots_b")
        }
    }

    fn bind(&mut self) {
        self.depth_passes = self.passes(&RadixSort {
            passes: 8,
            count_slot: 0,
            blocks: self.sizes.depth_blocks() as u32,
            keys: "keys",
            pairs: [("depth_keys_a", "order_a"), ("depth_keys_b", "order")],
            histogram: "depth_histogram",
        });
        // The sentinel is the number of tiles.
        let bits = usize::BITS - self.sizes.tiles.leading_zeros();
        self.tile_passes = self.passes(&RadixSort {
            passes: bits.div_ceil(4).max(1),
            count_slot: 1,
            blocks: self.sizes.tile_blocks() as u32,
            keys: "slot_tiles",
            pairs: [("tile_keys_a", "tile_slots_a"), ("tile_keys_b", "tile_slots_b")],
            histogram: "tile_histogram",
        });
        let (keys, slots) = self.sorted_tiles();
        let sorted = [("tile_keys", keys), ("tile_slots", slots)];
        for shader in ["ranges", "reach", "blend", "blend_adjoint", "removal"] {
            self.groups.insert(shader, vec![self.bind_group(shader, 0, &sorted, &[])]);
        }
        let emit = |writes: u32| {
            let mode = self.constant("mode", &[writes, 0, 0, 0]);
            self.bind_group("emit", 0, &[], &[("mode", &mode)])
        };
        self.emits = [0, 1].map(emit).into();
        for shader in ["project", "rank", "gather", "adam"] {
            let pages = 0..self.pages.len();
            let groups = pages.map(|page| self.bind_group(shader, page, &[], &[])).collect();
            self.groups.insert(shader, groups);
        }
        let pages = 0..self.pages.len();
        let total = |page| self.bind_group("total", page, &[("sums", "totals")], &[]);
        self.groups.insert("total", pages.map(total).collect());
        self.scans = self.sizes.scans().iter().map(|&(s, n)| self.bind_scan(s, n)).collect();
    }

    /// Bind groups of the passes of a sort.
    fn passes(&self, sort: &RadixSort) -> Vec<wgpu::BindGroup> {
        let bind = |k: u32| {
            let words = [4 * k, sort.count_slot, sort.blocks, u32::from(k == 0)];
            let pass = self.constant("radix pass", &words);
            let (keys_out, values_out) = sort.pairs[k as usize % 2];
            let (from, values_in) = sort.pairs[(k as usize + 1) % 2];
            let names = [
                ("keys_in", if k == 0 { sort.keys } else { from }),
                ("values_in", values_in),
                ("keys_out", keys_out),
                ("values_out", values_out),
                ("histogram", sort.histogram),
            ];
            self.bind_group("sort", 0, &names, &[("p", &pass)])
        };
        (0..sort.passes).map(bind).collect()
    }

    fn bind_scan(&self, scan: Scan, length: usize) -> Vec<ScanLevel> {
        let mut values = SCANNED[scan as usize];
        let mut out = Vec::new();
        for (k, n) in scan_lengths(length).into_iter().enumerate() {
            let totals = SCAN_TOTALS[scan as usize][k];
            let level = self.constant("scan level", &[n as u32, 0, 0, 0]);
            let names = [("values", values), ("totals", totals)];
            out.push(ScanLevel {
                group: self.bind_group("scan", 0, &names, &[("level", &level)]),
                blocks: n.div_ceil(SCAN_BLOCK as usize) as u32,
            });
            values = totals;
        }
        out
    }

    pub(crate) fn constant(&self, label: &str, words: &[u32; 4]) -> wgpu::Buffer {
        let buffer = self.context.uniform(label, 16);
        self.context.queue.write_buffer(&buffer, 0, bytemuck::cast_slice(words));
        buffer
    }

    /// Binds a shader's variables to the buffers of the same names for a page, except for those in `renamed`
    /// (variable, buffer) and in `extra`.
    pub(crate) fn bind_group(
        &self,
        shader: &'static str,
        page: usize,
        renamed: &[(&str, &str)],
        extra: &[(&str, &wgpu::Buffer)],
    ) -> wgpu::BindGroup {
        // Cannot fail, as in `buffer`.
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
                    None if name == "page" => &self.pages[page],
                    None => self.buffer(other, page),
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
}

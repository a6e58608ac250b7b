//! [`KernelLoop`]: steps in which kernels of another crate take part.

use gs_model::Scene;

use super::device::Context;
use super::passes::{KERNEL_STEP, MAKING_STEP};
use super::program::{Call, Program};
use super::steps::{DeviceSteps, Mover};
use super::workspace::Workspace;
use crate::error::{Error, Result};
use crate::optimiser::{Adam, rows_of};
use crate::options::Loss;
use crate::stages::loss::ViewLoss;
use crate::view_gradients::PreparedView;

impl Workspace {
    /// Binds calls of a page of a program.
    fn bind_calls(
        &self,
        calls: &[Call],
        page: usize,
        uniform: (&str, &wgpu::Buffer),
    ) -> Vec<(Call, wgpu::BindGroup)> {
        let bind = |call: &Call| {
            let words = self.constant("call", &call.words);
            (*call, self.bind_group(call.shader, page, &[], &[uniform, ("call", &words)]))
        };
        calls.iter().map(bind).collect()
    }

    /// Records calls.
    pub(super) fn calls(
        &self,
        pass: &mut wgpu::ComputePass<'_>,
        calls: &[(Call, wgpu::BindGroup)],
    ) {
        for (call, group) in calls {
            self.dispatch(pass, call.shader, call.entry, group, call.workgroups);
        }
    }
}

/// What a step of [`KernelLoop`] does.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct KernelStep {
    /// View to render, modulo the number of views.
    pub view: usize,
    /// Number of the step, from 1, for Adam.
    pub number: u64,
    /// Rates of four kinds of values: `u.rates` holds them over Adam's first correction, `u.inv_sqrt_bias2` the
    /// second.
    pub rates: [f32; 4],
    /// Whether the kernels make a new scene. Otherwise the step renders that of the step before.
    pub made: bool,
    /// A number for the kernels: `u.extra`.
    pub extra: f32,
}

/// See [`crate::kernels`].
pub struct KernelLoop {
    steps: DeviceSteps,
    pages: Vec<LoopPage>,
}

/// The uniform of a page, and its buffers with their lengths.
#[derive(Debug)]
struct LoopPage {
    uniform: wgpu::Buffer,
    buffers: Vec<(&'static str, usize)>,
}

impl std::fmt::Debug for KernelLoop {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("KernelLoop").field("pages", &self.pages).finish()
    }
}

impl KernelLoop {
    pub(crate) fn new(
        context: Context,
        scene: &Scene,
        program: &Program,
        views: (&[PreparedView], Loss),
    ) -> Result<Self> {
        let mut steps = DeviceSteps::new(context, scene, views, Mover::ByKernels(program))?;
        let workspace = &mut steps.workspace;
        workspace.upload(&[&rows_of(scene)]);
        let mut pages = Vec::new();
        for (number, page) in program.pages.iter().enumerate() {
            let uniform = workspace.context.uniform(program.uniform, 4 * page.uniform.len());
            let named = (program.uniform, &uniform);
            let calls = workspace.bind_calls(&page.before, number, named);
            workspace.before.extend(calls);
            let calls = workspace.bind_calls(&page.after, number, named);
            workspace.after.extend(calls);
            pages.push(LoopPage { uniform, buffers: page.buffers.clone() });
        }
        let mut this = Self { steps, pages };
        for (number, page) in program.pages.iter().enumerate() {
            this.set_uniform(number, &page.uniform)?;
        }
        Ok(this)
    }

    /// Other words of the uniform of a page from now on.
    ///
    /// # Errors
    /// [`Error::Gpu`], also if there is no such page.
    pub fn set_uniform(&mut self, page: usize, words: &[u32]) -> Result<()> {
        self.steps.settle()?;
        let queue = &self.steps.workspace.context.queue;
        let page = self.pages.get(page).ok_or(Error::Gpu { reason: format!("no page {page}") })?;
        queue.write_buffer(&page.uniform, 0, bytemuck::cast_slice(words));
        Ok(())
    }

    /// Writes the beginning of a buffer of a page of the program.
    ///
    /// # Errors
    /// [`Error::Gpu`], also if there is no such buffer or it is shorter.
    pub fn write<T: bytemuck::NoUninit>(
        &mut self,
        buffer: &str,
        page: usize,
        data: &[T],
    ) -> Result<()> {
        self.fits(buffer, page, size_of_val(data).div_ceil(4))?;
        self.steps.settle()?;
        self.steps.workspace.write(buffer, page, data);
        Ok(())
    }

    /// Reads the first `n` values of a buffer of a page of the program. Waits for the device.
    ///
    /// # Errors
    /// As [`KernelLoop::write`].
    pub fn read<T: bytemuck::AnyBitPattern>(
        &mut self,
        buffer: &str,
        page: usize,
        n: usize,
    ) -> Result<Vec<T>> {
        self.fits(buffer, page, (n * size_of::<T>()).div_ceil(4))?;
        self.steps.settle()?;
        self.steps.workspace.read(buffer, page, n)
    }

    fn fits(&self, buffer: &str, page: usize, words: usize) -> Result<()> {
        let buffers = self.pages.get(page).map_or(&[][..], |page| &page.buffers);
        match buffers.iter().find(|b| b.0 == buffer) {
            Some((_, length)) if words <= *length => Ok(()),
            _ => Err(Error::Gpu { reason: format!("no buffer {buffer} of {words} words") }),
        }
    }

    /// Submits a step. It does not wait for the device.
    ///
    /// # Errors
    /// [`Error::Gpu`].
    pub fn step(&mut self, step: &KernelStep) -> Result<()> {
        let (inverse_bias1, inv_sqrt_bias2) = Adam::new(step.number).corrections();
        let mut u = self.steps.uniform(step.view, step.number);
        u.rates = step.rates.map(|r| r * inverse_bias1);
        u.inv_sqrt_bias2 = inv_sqrt_bias2;
        u.extra = step.extra;
        self.steps.step(step.view, u, if step.made { &MAKING_STEP } else { &KERNEL_STEP })
    }

    /// The losses of the steps since the last call, in order. Waits for the device.
    ///
    /// # Errors
    /// [`Error::Gpu`].
    pub fn losses(&mut self) -> Result<Vec<ViewLoss>> {
        self.steps.losses()
    }

    /// The scene that the kernels made last, with the lengths of `like`. Waits for the device.
    ///
    /// # Errors
    /// [`Error::Gpu`].
    pub fn scene(&mut self, like: Scene) -> Result<Scene> {
        self.steps.scene(like)
    }
}

//! Adapters and devices.

use std::sync::{Arc, Mutex};

use crate::error::{Error, Result};

/// A device, its queue, and what it complained about.
pub(crate) struct Context {
    pub(crate) device: wgpu::Device,
    pub(crate) queue: wgpu::Queue,
    pub(crate) limits: wgpu::Limits,
    /// Iterations after which the driver ends the loops of an invocation without a word, if it
    /// does: Mesa's software Vulkan (22.3.6) counts to 65,535.
    pub(crate) loop_limit: Option<u32>,
    complaints: Arc<Mutex<Complaints>>,
}

/// What no call returned.
#[derive(Default)]
struct Complaints {
    /// Why the device was lost.
    lost: Option<String>,
    /// First validation or out-of-memory error; of a lost device, what the loss led to.
    first: Option<String>,
}

fn instance() -> Option<wgpu::Instance> {
    if wgpu::Instance::enabled_backend_features().is_empty() {
        return None;
    }
    Some(wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle()))
}

fn adapters() -> Vec<wgpu::Adapter> {
    match instance() {
        Some(i) => pollster::block_on(i.enumerate_adapters(wgpu::Backends::all())),
        None => Vec::new(),
    }
}

fn describe(adapter: &wgpu::Adapter) -> String {
    let info = adapter.get_info();
    format!("{} ({:?}, {:?})", info.name, info.backend, info.device_type)
}

/// A rasterizer in software: lavapipe, SwiftShader, WARP.
fn is_software(adapter: &wgpu::Adapter) -> bool {
    adapter.get_info().device_type == wgpu::DeviceType::Cpu
}

/// The hardware adapter to use: discrete before integrated before the rest, first of its kind.
fn hardware() -> std::result::Result<wgpu::Adapter, String> {
    let all = adapters();
    if all.is_empty() {
        return Err("no graphics adapter".into());
    }
    let software: Vec<_> = all.iter().filter(|a| is_software(a)).map(describe).collect();
    let rank = |a: &wgpu::Adapter| match a.get_info().device_type {
        wgpu::DeviceType::DiscreteGpu => 0,
        wgpu::DeviceType::IntegratedGpu => 1,
        _ => 2,
    };
    all.into_iter()
        .filter(|a| !is_software(a))
        .min_by_key(rank)
        .ok_or_else(|| format!("only a software adapter: {}", software.join(", ")))
}

/// Name of the hardware adapter, or why there is none.
pub(crate) fn find() -> std::result::Result<String, String> {
    hardware().map(|a| describe(&a))
}

impl Context {
    /// A device on the hardware adapter.
    pub(crate) fn hardware() -> Result<Self> {
        let adapter = hardware().map_err(|reason| Error::NoAdapter { reason })?;
        Self::on(&adapter)
    }

    /// A device on the software adapter if there is one, else on any: for conformance tests and
    /// benchmarks.
    pub(crate) fn software() -> Result<Self> {
        let all = adapters();
        let adapter = all.iter().find(|a| is_software(a)).or_else(|| all.first());
        match adapter {
            Some(adapter) => Self::on(adapter),
            None => Err(Error::NoAdapter { reason: "no graphics adapter".into() }),
        }
    }

    /// A device on any given kind of adapter, with the default limits but for the sizes of
    /// buffers, which are the adapter's.
    fn on(adapter: &wgpu::Adapter) -> Result<Self> {
        let available = adapter.limits();
        let limits = wgpu::Limits {
            max_storage_buffer_binding_size: available.max_storage_buffer_binding_size,
            max_buffer_size: available.max_buffer_size,
            ..wgpu::Limits::default()
        };
        let request = adapter.request_device(&wgpu::DeviceDescriptor {
            label: Some("finetune"),
            required_limits: limits.clone(),
            ..Default::default()
        });
        let (device, queue) = pollster::block_on(request)
            .map_err(|e| Error::Gpu { reason: format!("{}: {e}", describe(adapter)) })?;
        let complaints = Arc::new(Mutex::new(Complaints::default()));
        // Without a handler, wgpu panics.
        let sink = complaints.clone();
        device.on_uncaptured_error(Arc::new(move |e: wgpu::Error| {
            if let Ok(mut c) = sink.lock() {
                c.first.get_or_insert_with(|| one_line(&e.to_string()));
            }
        }));
        // Calls on a lost device return nothing that says so.
        let sink = complaints.clone();
        device.set_device_lost_callback(move |reason, message| {
            if let Ok(mut c) = sink.lock() {
                let text = format!("the device was lost ({reason:?}) {message}");
                c.lost.get_or_insert_with(|| one_line(&text));
            }
        });
        let mut context = Self { device, queue, limits, loop_limit: None, complaints };
        context.loop_limit = super::loops::limit(&context)?;
        Ok(context)
    }

    /// Fails if anything went wrong since the device was made.
    pub(crate) fn check(&self) -> Result<()> {
        let said = |pick: fn(&Complaints) -> Option<String>| match self.complaints.lock() {
            Ok(c) => pick(&c),
            Err(_) => Some("error handler panicked".into()),
        };
        if let Some(first) = said(|c| c.lost.clone().or(c.first.clone())) {
            // A loss is told to whoever polls, after the errors that it led to.
            let _ = wait(|| self.device.poll(wgpu::PollType::Poll));
            return Err(Error::Gpu { reason: said(|c| c.lost.clone()).unwrap_or(first) });
        }
        Ok(())
    }

    /// Waits for the device and copies `size` bytes of `buffer` back.
    pub(crate) fn read(&self, buffer: &wgpu::Buffer, size: u64) -> Result<Vec<u8>> {
        self.check()?;
        let staging = self.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("staging"),
            size: size.max(4),
            usage: wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        let mut encoder = self.device.create_command_encoder(&Default::default());
        encoder.copy_buffer_to_buffer(buffer, 0, &staging, 0, size);
        self.queue.submit([encoder.finish()]);
        let (send, receive) = std::sync::mpsc::channel();
        staging.slice(..).map_async(wgpu::MapMode::Read, move |result| {
            // The receiver outlives the call below, which runs this closure.
            let _ = send.send(result);
        });
        let gpu = |reason: String| Error::Gpu { reason };
        wait(|| self.device.poll(wgpu::PollType::wait_indefinitely()))?;
        self.check()?;
        match receive.try_recv() {
            Ok(Ok(())) => {}
            Ok(Err(e)) => return Err(gpu(e.to_string())),
            Err(e) => return Err(gpu(format!("buffer was not mapped: {e}"))),
        }
        let view = staging.slice(..).get_mapped_range().map_err(|e| gpu(e.to_string()))?;
        Ok(view[..size as usize].to_vec())
    }
}

fn one_line(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

/// Runs `poll`. wgpu panics where the device is lost while someone waits for it: that is an
/// error like any other here.
pub(super) fn wait<T>(poll: impl FnOnce() -> std::result::Result<T, wgpu::PollError>) -> Result<T> {
    let done = std::panic::catch_unwind(std::panic::AssertUnwindSafe(poll));
    match done {
        Ok(Ok(status)) => Ok(status),
        Ok(Err(e)) => Err(Error::Gpu { reason: e.to_string() }),
        Err(_) => Err(Error::Gpu { reason: "the device was lost during a wait".into() }),
    }
}

//! Adapters and devices.

use std::sync::{Arc, Mutex};

use crate::error::{Error, Result};

/// A device, its queue, and what it complained about.
pub(crate) struct Context {
    pub(crate) device: wgpu::Device,
    pub(crate) queue: wgpu::Queue,
    pub(crate) limits: wgpu::Limits,
    /// First validation or out-of-memory error that no call returned.
    complaint: Arc<Mutex<Option<String>>>,
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
        let complaint = Arc::new(Mutex::new(None));
        let sink = complaint.clone();
        // Without a handler, wgpu panics.
        device.on_uncaptured_error(Arc::new(move |e: wgpu::Error| {
            if let Ok(mut first) = sink.lock() {
                first.get_or_insert_with(|| e.to_string());
            }
        }));
        Ok(Self { device, queue, limits, complaint })
    }

    /// Fails if anything went wrong since the device was made.
    pub(crate) fn check(&self) -> Result<()> {
        match self.complaint.lock() {
            Ok(first) => match &*first {
                Some(reason) => Err(Error::Gpu { reason: reason.clone() }),
                None => Ok(()),
            },
            Err(_) => Err(Error::Gpu { reason: "error handler panicked".into() }),
        }
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
        self.device.poll(wgpu::PollType::wait_indefinitely()).map_err(|e| gpu(e.to_string()))?;
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

//! [`Context`]: a device, its queue and its errors.

use std::sync::{Arc, Mutex};

use super::sizes::PAGE_GAUSSIANS;
use crate::error::{Error, Result};

/// A device, its queue, and the errors that no call returned.
pub(crate) struct Context {
    pub(crate) device: wgpu::Device,
    pub(crate) queue: wgpu::Queue,
    pub(crate) limits: wgpu::Limits,
    /// Gaussians of a page, at most.
    pub(crate) page: usize,
    /// Iterations after which the driver ends the loops of an invocation without an error, if it
    /// does: see [`super::loops`].
    pub(crate) loop_limit: Option<u32>,
    /// Whether the adapter is software.
    #[cfg(test)]
    pub(crate) software: bool,
    errors: Arc<Mutex<Errors>>,
}

/// The errors that no call returned.
#[derive(Default)]
struct Errors {
    /// Why the device was lost.
    lost: Option<String>,
    /// The first validation or out-of-memory error. If the device is lost, the loss caused it.
    first: Option<String>,
}

impl Context {
    /// A device on an adapter, whose `name` is for the message. The limits are WebGPU's defaults, whatever the
    /// adapter has: what runs on one runs on all.
    pub(super) fn on(adapter: &wgpu::Adapter, name: &str) -> Result<Self> {
        let limits = wgpu::Limits::default();
        let request = adapter.request_device(&wgpu::DeviceDescriptor {
            label: Some("finetune"),
            required_limits: limits.clone(),
            ..Default::default()
        });
        let (device, queue) = pollster::block_on(request)
            .map_err(|e| Error::Gpu { reason: one_line(&format!("{name}: {e}")) })?;
        let errors = Arc::new(Mutex::new(Errors::default()));
        // Without a handler, wgpu panics.
        let sink = errors.clone();
        device.on_uncaptured_error(Arc::new(move |e: wgpu::Error| {
            if let Ok(mut errors) = sink.lock() {
                errors.first.get_or_insert_with(|| one_line(&e.to_string()));
            }
        }));
        // Calls on a lost device do not return an error.
        let sink = errors.clone();
        device.set_device_lost_callback(move |reason, message| {
            if let Ok(mut errors) = sink.lock() {
                let reason = match reason {
                    wgpu::DeviceLostReason::Destroyed => "destroyed",
                    wgpu::DeviceLostReason::Unknown => "the driver gives no reason",
                };
                let text = format!("the device was lost ({reason}) {message}");
                errors.lost.get_or_insert_with(|| one_line(&text));
            }
        });
        Ok(Self {
            device,
            queue,
            limits,
            page: PAGE_GAUSSIANS,
            loop_limit: None,
            #[cfg(test)]
            software: super::adapter::is_software(adapter),
            errors,
        })
    }

    /// Bytes of a storage buffer, at most.
    pub(super) fn binding(&self) -> u64 {
        self.limits.max_storage_buffer_binding_size.min(self.limits.max_buffer_size)
    }

    /// A uniform buffer of `size` bytes.
    pub(super) fn uniform(&self, label: &str, size: usize) -> wgpu::Buffer {
        self.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some(label),
            size: size as u64,
            usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        })
    }

    /// Fails if anything went wrong since the device was made.
    pub(crate) fn check(&self) -> Result<()> {
        let stored = |pick: fn(&Errors) -> Option<String>| match self.errors.lock() {
            Ok(errors) => pick(&errors),
            Err(_) => Some("error handler panicked".into()),
        };
        if let Some(first) = stored(|e| e.lost.clone().or(e.first.clone())) {
            // wgpu reports a loss during a poll, after the errors that the loss caused.
            let _ = wait(|| self.device.poll(wgpu::PollType::Poll));
            return Err(Error::Gpu { reason: stored(|e| e.lost.clone()).unwrap_or(first) });
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

/// Runs `poll`. wgpu panics if the device is lost during a wait; the panic becomes an error.
pub(super) fn wait<T>(poll: impl FnOnce() -> std::result::Result<T, wgpu::PollError>) -> Result<T> {
    let done = std::panic::catch_unwind(std::panic::AssertUnwindSafe(poll));
    match done {
        Ok(Ok(status)) => Ok(status),
        Ok(Err(e)) => Err(Error::Gpu { reason: e.to_string() }),
        Err(_) => Err(Error::Gpu { reason: "the device was lost during a wait".into() }),
    }
}

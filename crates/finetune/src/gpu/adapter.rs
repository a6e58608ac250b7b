//! Which graphics adapter is used.

use super::device::Context;
use super::loops;
use crate::error::{Error, Result};

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

/// Name, kind and graphics API, for messages.
fn describe(adapter: &wgpu::Adapter) -> String {
    let info = adapter.get_info();
    let kind = match info.device_type {
        wgpu::DeviceType::DiscreteGpu => "discrete GPU",
        wgpu::DeviceType::IntegratedGpu => "integrated GPU",
        wgpu::DeviceType::VirtualGpu => "virtual GPU",
        wgpu::DeviceType::Cpu => "software",
        wgpu::DeviceType::Other => "other device",
    };
    format!("{} ({kind}, {})", info.name, info.backend)
}

/// A rasterizer in software: lavapipe, SwiftShader, WARP.
pub(super) fn is_software(adapter: &wgpu::Adapter) -> bool {
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
pub(crate) fn hardware_name() -> std::result::Result<String, String> {
    hardware().map(|a| describe(&a))
}

/// The software adapter if there is one, else any.
fn software() -> Result<wgpu::Adapter> {
    let mut all = adapters();
    let at = all.iter().position(is_software).unwrap_or(0);
    match all.len() {
        0 => Err(Error::NoAdapter { reason: "no graphics adapter".into() }),
        _ => Ok(all.swap_remove(at)),
    }
}

/// Its name.
pub(crate) fn software_name() -> Result<String> {
    Ok(describe(&software()?))
}

impl Context {
    /// A device on the hardware adapter.
    pub(crate) fn hardware() -> Result<Self> {
        let adapter = hardware().map_err(|reason| Error::NoAdapter { reason })?;
        Self::open(&adapter)
    }

    /// A device on the software adapter if there is one, else on any: for conformance tests and
    /// benchmarks.
    pub(crate) fn software() -> Result<Self> {
        Self::open(&software()?)
    }

    /// A device on an adapter, with its limit on loops.
    fn open(adapter: &wgpu::Adapter) -> Result<Self> {
        let mut context = Self::on(adapter, &describe(adapter))?;
        context.loop_limit = loops::limit(&context)?;
        Ok(context)
    }
}

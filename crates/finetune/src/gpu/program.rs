//! [`Program`]: kernels of another crate, their buffers, and when they run.

use super::sizes::Lengths;
use crate::error::{Error, Result};
use crate::shaders::{Shader, bindings};

/// Buffers of this crate that kernels may bind: opacity with log-scales, quaternion and mean, SH, and the derivatives
/// that the stage `gather` leaves.
const SHARED: [&str; 3] = ["geo", "sh", "sums"];

/// Kernels, their buffers, and when they run.
pub struct Program {
    /// WGSL text that all shaders share.
    pub shared: String,
    /// The kernels. A variable is bound to the buffer of its name: one of [`ProgramPage::buffers`], or `geo`, `sh`,
    /// `sums`. The uniforms `u` and `page` are those of the step and of the page, `call` holds [`Call::words`],
    /// and that of the name `uniform` holds [`ProgramPage::uniform`].
    pub shaders: &'static [Shader],
    /// Name of a uniform.
    pub uniform: &'static str,
    /// The pages: the first Gaussians of the scene, in order. The program does nothing with those behind them.
    pub pages: Vec<ProgramPage>,
}

/// What a [`Program`] does with some Gaussians.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ProgramPage {
    /// Their number.
    pub gaussians: usize,
    /// Buffers by name, with their lengths in 32-bit words: the same names on all pages. They begin with zeros.
    pub buffers: Vec<(&'static str, usize)>,
    /// Words of the uniform.
    pub uniform: Vec<u32>,
    /// Calls that make the scene, in order.
    pub before: Vec<Call>,
    /// Calls that use the derivatives of the loss, in order.
    pub after: Vec<Call>,
}

/// A dispatch of a kernel.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Call {
    /// Name of the shader.
    pub shader: &'static str,
    /// Its entry point.
    pub entry: &'static str,
    /// Words of the uniform `call`.
    pub words: [u32; 4],
    /// Workgroups; `group_index` counts them.
    pub workgroups: u32,
}

impl Program {
    /// Every buffer, with its length on each page.
    pub(super) fn lengths(&self) -> Vec<Lengths> {
        let names = self.pages.iter().take(1).flat_map(|page| &page.buffers);
        let of = |k: usize| self.pages.iter().filter_map(move |page| page.buffers.get(k));
        names.enumerate().map(|(k, b)| (b.0, of(k).map(|b| b.1).collect())).collect()
    }

    /// Names that nothing stands for.
    pub(super) fn check(&self) -> Result<()> {
        let failed = |reason| Err(Error::Gpu { reason });
        for page in &self.pages {
            for shader in self.shaders {
                for binding in bindings(&shader.source(&self.shared)) {
                    let name = binding.name.as_str();
                    let known = ["u", "page", "call", self.uniform].contains(&name)
                        || SHARED.contains(&name)
                        || page.buffers.iter().any(|b| b.0 == name);
                    if !known {
                        return failed(format!("{}: no buffer {name}", shader.name));
                    }
                }
            }
            for call in page.before.iter().chain(&page.after) {
                let of = |s: &&Shader| s.name == call.shader && s.entries.contains(&call.entry);
                if !self.shaders.iter().any(|s| of(&s)) {
                    return failed(format!("no kernel {} in {}", call.entry, call.shader));
                }
            }
        }
        Ok(())
    }
}

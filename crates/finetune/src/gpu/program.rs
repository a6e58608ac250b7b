//! [`Program`]: kernels of another crate, their buffers, and when they run.

use crate::error::{Error, Result};
use crate::shaders::{Shader, bindings};

/// Buffers of this crate that kernels may bind: means, opacity with log-scales and quaternion, SH, and the derivatives
/// that the stage `gather` leaves.
const SHARED: [&str; 4] = ["means", "geo", "sh", "sums"];

/// Kernels, their buffers, and when they run.
pub struct Program {
    /// WGSL text that all shaders share.
    pub shared: String,
    /// The kernels. A variable is bound to the buffer of its name: one of `buffers`, or `means`, `geo`, `sh`, `sums`.
    /// The uniform `u` is that of the step, `call` holds [`Call::words`], and one of another name holds
    /// [`Program::uniform`].
    pub shaders: &'static [Shader],
    /// Buffers by name, with their lengths in 32-bit words. They begin with zeros.
    pub buffers: Vec<(&'static str, usize)>,
    /// A uniform by name, with its words.
    pub uniform: (&'static str, Vec<u32>),
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
    /// Names that nothing stands for.
    pub(super) fn check(&self) -> Result<()> {
        let failed = |reason| Err(Error::Gpu { reason });
        for shader in self.shaders {
            for binding in bindings(&shader.source(&self.shared)) {
                let name = binding.name.as_str();
                let known = ["u", "call", self.uniform.0].contains(&name)
                    || SHARED.contains(&name)
                    || self.buffers.iter().any(|b| b.0 == name);
                if !known {
                    return failed(format!("{}: no buffer {name}", shader.name));
                }
            }
        }
        for call in self.before.iter().chain(&self.after) {
            let of = |s: &&Shader| s.name == call.shader && s.entries.contains(&call.entry);
            if !self.shaders.iter().any(|s| of(&s)) {
                return failed(format!("no kernel {} in {}", call.entry, call.shader));
            }
        }
        Ok(())
    }
}

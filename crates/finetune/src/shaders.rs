//! The WGSL sources: stage files, the shared mathematics they use, and the constants, which
//! come from the Rust side.

use std::fmt::Write as _;

use crate::metrics::taps;
use crate::optimiser::{BETA1, BETA2, EPSILON};
use crate::stages::consts::*;
use crate::stages::project::CULLED;

/// Workgroups per row of a dispatch; more are folded into further rows.
pub(crate) const DISPATCH_ROW: u32 = 32_768;
/// Pairs that one workgroup of the radix sort handles.
pub(crate) const RADIX_BLOCK: u32 = 1024;
/// Values that one workgroup of the scan handles.
pub(crate) const SCAN_BLOCK: u32 = 1024;
/// Sums of a record of `blend_adjoint`, and of one of `removal`.
const SUMS: [u32; 2] = [9, 2];
/// Floats of a Gaussian in the buffer `geo`.
pub(crate) const GEO: u32 = 11;
/// Splats whose partial sums they keep in workgroup memory: the most that fit in 16 KiB, and that a word has bits for.
const RECORD_BATCH: [u32; 2] = [13, 32];
/// Blocks of a tile, two columns of four, in `blend` and `blend_adjoint`; four lanes share a block.
const BLOCKS: u32 = 8;
/// Lanes of a tile, which are those of a workgroup.
pub(crate) const TILE_LANES: u32 = 4 * BLOCKS;
/// Words of these partial sums: a row per splat and sum.
const fn record_words(removal: bool) -> u32 {
    RECORD_BATCH[removal as usize] * SUMS[removal as usize] * (TILE_LANES + 1)
}
/// Pixels of a run in the stage `loss`, where a lane handles a run.
pub(crate) const LOSS_RUN: u32 = 8;

/// A shader module: the entry points of a stage, and the texts that it is made of, its own file last.
#[derive(Debug)]
pub struct Shader {
    pub(crate) name: &'static str,
    pub(crate) entries: &'static [&'static str],
    /// Whether the type F of the shared mathematics is `vec4<f32>`.
    vec4: bool,
    /// Whether its records are those of the stage `removal`.
    removal: bool,
    parts: &'static [&'static str],
}

const PRELUDE: &str = include_str!("stages/math/prelude.wgsl");
const SCALAR: &str = include_str!("stages/math/scalar.wgsl");
/// Parameters of a Gaussian, its projection, its `Frame` in a view, and the SH basis. Needs the buffer
/// `geo`, and [`STEP`].
pub const GAUSSIAN: &str = concat!(
    include_str!("stages/math/scalar.wgsl"),
    include_str!("stages/math/project.wgsl"),
    include_str!("stages/math/sh.wgsl"),
    include_str!("stages/params.wgsl"),
);
/// The adjoint of the projection. Needs [`GAUSSIAN`].
pub const PROJECT_ADJOINT: &str = concat!(
    include_str!("stages/math/project_adjoint.wgsl"),
    include_str!("stages/project_adjoint.wgsl"),
);
const BLEND: &str = include_str!("stages/math/blend.wgsl");
const REACH: &str = include_str!("stages/math/reach.wgsl");
const BLOCK: &str = include_str!("stages/block.wgsl");
const RECORDS: &str = include_str!("stages/records.wgsl");
const GATHER: &str = include_str!("stages/gather.wgsl");
/// The uniform `u` of a step, and `group_index` of a folded dispatch.
pub const STEP: &str = include_str!("stages/step.wgsl");
/// The page that a dispatch works on, `page`. Gaussians of a kernel count from its first.
pub const PAGE: &str = include_str!("stages/page.wgsl");
const SPLAT: &str = include_str!("stages/splat.wgsl");

/// All shaders, in the order of the stages.
pub(crate) const SHADERS: &[Shader] = &[
    Shader::new(
        "project",
        &["project"],
        &[STEP, PAGE, GAUSSIAN, SPLAT, include_str!("stages/project.wgsl")],
    ),
    Shader::new("sort", &["sort_count", "sort_scatter"], &[STEP, include_str!("stages/sort.wgsl")]),
    Shader::new("scan", &["scan_local", "scan_add"], &[STEP, include_str!("stages/scan.wgsl")]),
    Shader::new("rank", &["rank"], &[STEP, PAGE, SPLAT, include_str!("stages/rank.wgsl")]),
    Shader::new(
        "emit",
        &["check_capacity", "emit"],
        &[REACH, STEP, SPLAT, include_str!("stages/emit.wgsl")],
    ),
    Shader::new("ranges", &["ranges"], &[STEP, include_str!("stages/ranges.wgsl")]),
    Shader::new("reach", &["reach"], &[REACH, STEP, SPLAT, include_str!("stages/reach.wgsl")])
        .vec4(),
    Shader::new(
        "blend",
        &["blend"],
        &[SCALAR, BLEND, STEP, SPLAT, BLOCK, include_str!("stages/blend.wgsl")],
    )
    .vec4(),
    Shader::new(
        "loss",
        &["ssim_rows", "ssim_values", "ssim_spread", "loss_gradient", "loss_blocks", "loss_total"],
        &[STEP, include_str!("stages/loss.wgsl")],
    ),
    Shader::new(
        "blend_adjoint",
        &["blend_adjoint"],
        &[SCALAR, BLEND, STEP, SPLAT, BLOCK, RECORDS, include_str!("stages/blend_adjoint.wgsl")],
    )
    .vec4(),
    Shader::new("gather", &["gather"], &[STEP, PAGE, SPLAT, GATHER]),
    Shader::new(
        "removal",
        &["removal"],
        &[SCALAR, BLEND, STEP, SPLAT, BLOCK, RECORDS, include_str!("stages/removal.wgsl")],
    )
    .vec4()
    .removal(),
    Shader::new("total", &["gather"], &[STEP, PAGE, SPLAT, GATHER]).removal(),
    Shader::new(
        "adam",
        &["adam"],
        &[STEP, PAGE, GAUSSIAN, PROJECT_ADJOINT, include_str!("stages/adam.wgsl")],
    ),
];

impl Shader {
    /// A shader of that name with these entry points, made of texts of this crate and of the caller's.
    #[must_use]
    pub const fn new(
        name: &'static str,
        entries: &'static [&'static str],
        parts: &'static [&'static str],
    ) -> Self {
        Self { name, entries, vec4: false, removal: false, parts }
    }

    const fn vec4(self) -> Self {
        Self { vec4: true, ..self }
    }

    const fn removal(self) -> Self {
        Self { removal: true, ..self }
    }

    /// Its name.
    #[must_use]
    pub fn name(&self) -> &'static str {
        self.name
    }

    /// Its entry points.
    #[must_use]
    pub fn entries(&self) -> &'static [&'static str] {
        self.entries
    }

    /// The whole text, with that of the caller before the rest.
    #[must_use]
    pub fn source(&self, shared: &str) -> String {
        let mut out = String::from(shared);
        // Formatting into a String cannot fail.
        let _ = self.constants(&mut out);
        out.push_str(PRELUDE);
        for part in self.parts {
            out.push_str(part);
        }
        let taps: Vec<String> = taps().iter().map(|&t| exact(t as f32)).collect();
        let (sums, of_step) =
            if self.removal { ("0 1", "") } else { ("0 1 2 3 4 5 6 7 8", "once") };
        repeat(
            &out.replace("SSIM_TAPS", &taps.join(", "))
                .replace("EACH_SUM", sums)
                .replace("OF_STEP", of_step),
        )
    }

    fn constants(&self, out: &mut String) -> std::fmt::Result {
        for (name, scalar) in [("F", "f32"), ("B", "bool"), ("I", "i32"), ("U", "u32")] {
            let wide = if self.vec4 { format!("vec4<{scalar}>") } else { scalar.into() };
            writeln!(out, "alias {name} = {wide};")?;
        }
        for (name, value) in [
            ("TILE", TILE),
            ("DISPATCH_ROW", DISPATCH_ROW),
            ("RADIX_BLOCK", RADIX_BLOCK),
            ("RADIX_PER_LANE", RADIX_BLOCK / 64),
            ("SUMS", SUMS[usize::from(self.removal)]),
            ("RECORD_BATCH", RECORD_BATCH[usize::from(self.removal)]),
            ("RECORD_WORDS", record_words(self.removal)),
            ("TILE_LANES", TILE_LANES),
            ("GEO", GEO),
            ("RUN", LOSS_RUN),
            ("CULLED", CULLED),
        ] {
            writeln!(out, "const {name}: u32 = {value}u;")?;
        }
        writeln!(out, "const TOTALS: bool = {};", self.removal)?;
        for (name, value) in [
            ("T_STOP", T_STOP),
            ("ALPHA_MAX", ALPHA_MAX),
            ("SIGMA_MAX", SIGMA_MAX),
            ("LOG_SCALE_MAX", LOG_SCALE_MAX),
            ("MIN_QUATERNION_NORM2", MIN_QUATERNION_NORM2),
            ("MAX_QUATERNION_NORM2", MAX_QUATERNION_NORM2),
            ("ADAM_BETA1", BETA1),
            ("ADAM_BETA1_REST", 1.0 - BETA1),
            ("ADAM_BETA2", BETA2),
            ("ADAM_BETA2_REST", 1.0 - BETA2),
            ("ADAM_EPSILON", EPSILON),
        ] {
            writeln!(out, "const {name}: f32 = {};", exact(value))?;
        }
        Ok(())
    }
}

/// Unrolls blocks of lines between `//@each NAME VALUES` and `//@end`: once per value, with `$NAME`
/// replaced by it; blocks may nest. WGSL has no macros, and compilers keep an array that a loop indexes in
/// memory, but the eight vectors of a lane's pixels must be in registers.
fn repeat(source: &str) -> String {
    let mut out = String::with_capacity(source.len());
    let mut lines = source.lines();
    while let Some(line) = lines.next() {
        let Some(rest) = line.trim_start().strip_prefix("//@each ") else {
            out.push_str(line);
            out.push('\n');
            continue;
        };
        let (name, values) = rest.split_once(' ').unwrap_or((rest, ""));
        let (mut body, mut depth) = (String::new(), 1);
        for line in lines.by_ref() {
            let command = line.trim_start();
            depth += i32::from(command.starts_with("//@each "));
            depth -= i32::from(command.starts_with("//@end"));
            if depth == 0 {
                break;
            }
            body.push_str(line);
            body.push('\n');
        }
        for value in values.split_whitespace() {
            out.push_str(&repeat(&body.replace(&format!("${name}"), value)));
        }
    }
    out
}

/// The exact decimal value, which every parser converts back to the same f32.
fn exact(value: f32) -> String {
    format!("{:e}", f64::from(value))
}

/// How a shader sees a binding.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Access {
    Uniform,
    Read,
    ReadWrite,
}

/// A binding of a shader, as its text declares it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Binding {
    pub(crate) index: u32,
    pub(crate) name: String,
    pub(crate) access: Access,
}

/// The bindings of a shader's source: lines of the form
/// `@group(0) @binding(3) var<storage, read> name: type;`.
pub(crate) fn bindings(source: &str) -> Vec<Binding> {
    let mut out = Vec::new();
    for line in source.lines() {
        let Some(rest) = line.strip_prefix("@group(0) @binding(") else { continue };
        let Some((index, rest)) = rest.split_once(") var<") else { continue };
        let Some((access, rest)) = rest.split_once("> ") else { continue };
        let Some((name, _)) = rest.split_once(':') else { continue };
        let access = match access {
            "uniform" => Access::Uniform,
            "storage, read" => Access::Read,
            _ => Access::ReadWrite,
        };
        if let Ok(index) = index.parse() {
            out.push(Binding { index, name: name.into(), access });
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    /// Every shader is valid without optional capabilities and translates to every language that a
    /// backend of wgpu reads. The test needs no adapter.
    #[test]
    fn every_shader_is_valid_and_translates_everywhere() {
        for shader in SHADERS {
            let source = shader.source("");
            testing::wgsl::check(shader.name, &source, shader.entries);
            let bindings = bindings(&source);
            assert_eq!(bindings.len(), source.matches("@binding(").count(), "{}", shader.name);
            let storage = bindings.iter().filter(|b| b.access != Access::Uniform).count();
            assert!(storage <= 8, "{}: {storage} storage buffers", shader.name);
        }
    }

    #[test]
    fn blocks_of_lines_repeat_and_nest() {
        let text = "a\n  //@each i 0 1\nb$i\n//@each k x y\nc$i$k\n//@end\n  //@end\nd";
        assert_eq!(repeat(text), "a\nb0\nc0x\nc0y\nb1\nc1x\nc1y\nd\n");
        for shader in SHADERS {
            let source = shader.source("");
            assert!(!source.contains('$') && !source.contains("//@"), "{}", shader.name);
        }
    }

    #[test]
    fn workgroup_memory_stays_within_the_portable_limit() {
        for removal in [false, true] {
            let bytes = 4 * (record_words(removal) + 2);
            assert!(bytes <= 16 * 1024, "{bytes} bytes");
        }
    }
}

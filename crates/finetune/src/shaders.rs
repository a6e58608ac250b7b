//! The WGSL sources: stage files, the shared mathematics they use, and the constants, which
//! come from the Rust side.

use std::fmt::Write as _;

use crate::metrics::taps;
use crate::optimiser::{BETA1, BETA2, EPSILON};
use crate::stages::consts::*;

/// Workgroups per row of a dispatch; more are folded into further rows.
pub(crate) const DISPATCH_ROW: u32 = 32_768;
/// Pairs that one workgroup of the radix sort handles.
pub(crate) const RADIX_BLOCK: u32 = 1024;
/// Values that one workgroup of the scan handles.
#[cfg_attr(not(feature = "gpu"), allow(dead_code, reason = "the test only validates"))]
pub(crate) const SCAN_BLOCK: u32 = 1024;
/// Splats whose partial sums `blend_adjoint` keeps in workgroup memory: the most that fit in 16 KiB.
const RECORD_BATCH: u32 = 16;
/// Tiles that one workgroup of `blend` and `blend_adjoint` handles.
pub(crate) const GROUP_TILES: u32 = 4;
/// Blocks of a tile, two columns of four; a lane handles a block.
pub(crate) const BLOCKS: u32 = 8;
/// Pixels of a run in the stage `loss`, where a lane handles a run.
#[cfg_attr(not(feature = "gpu"), allow(dead_code, reason = "the test only validates"))]
pub(crate) const LOSS_RUN: u32 = 8;

/// Words of a chunk of the codec: first leaf, root of the sum of weights, factors of depth and class for
/// opacity and for size, then for SH degrees 2 and 3 the logarithm of the run length and the first factor.
pub(crate) const CHUNK_WORDS: u32 = 10;
/// Groups of channels that the codec transforms apart: opacity, DC, SH degrees 1 to 3, covariance.
#[cfg_attr(not(feature = "gpu"), allow(dead_code, reason = "the test only validates"))]
pub(crate) const CODEC_GROUPS: usize = 6;
/// Greatest class of expected magnitudes; `gpcc_lite::attribute` has as many.
const LAST_CLASS: u32 = 15;
/// Logits of a decoder, and log-scales that count as nearly equal; `gsvx` has the same.
const MIN_LOGIT: f32 = -8.0;
const MAX_LOGIT: f32 = 12.0;
const EQUAL_AXES: f32 = 1e-2;

/// The type F of the shared mathematics in a shader.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum ScalarType {
    F32,
    Vec4,
}

/// A shader module: the entry points of a stage, and the texts that it is made of, its own file last.
#[derive(Debug)]
pub(crate) struct Shader {
    pub(crate) name: &'static str,
    pub(crate) entries: &'static [&'static str],
    scalar: ScalarType,
    parts: &'static [&'static str],
}

const PRELUDE: &str = include_str!("stages/math/prelude.wgsl");
const SCALAR: &str = include_str!("stages/math/scalar.wgsl");
const PROJECT: &str = include_str!("stages/math/project.wgsl");
const PROJECT_ADJOINT: &str = include_str!("stages/math/project_adjoint.wgsl");
const SH: &str = include_str!("stages/math/sh.wgsl");
const BLEND: &str = include_str!("stages/math/blend.wgsl");
const REACH: &str = include_str!("stages/math/reach.wgsl");
const BLOCK: &str = include_str!("stages/block.wgsl");
const STEP: &str = include_str!("stages/step.wgsl");
const PARAMS: &str = include_str!("stages/params.wgsl");
const TOUCHES: &str = include_str!("stages/touches.wgsl");
const CODEC: &str = include_str!("stages/codec/codec.wgsl");
/// `struct Splat` for stages that do not test tiles.
const SPLAT: &str = "struct Splat { a: vec4<f32>, b: vec4<f32>, c: vec4<f32> }\n";

/// All shaders, in the order of the stages.
pub(crate) const SHADERS: &[Shader] = &[
    Shader {
        name: "project",
        entries: &["project"],
        scalar: ScalarType::F32,
        parts: &[
            SCALAR,
            PROJECT,
            REACH,
            SH,
            STEP,
            PARAMS,
            TOUCHES,
            include_str!("stages/project.wgsl"),
        ],
    },
    Shader {
        name: "sort",
        entries: &["sort_count", "sort_scatter"],
        scalar: ScalarType::F32,
        parts: &[STEP, include_str!("stages/sort.wgsl")],
    },
    Shader {
        name: "scan",
        entries: &["scan_local", "scan_add"],
        scalar: ScalarType::F32,
        parts: &[STEP, include_str!("stages/scan.wgsl")],
    },
    Shader {
        name: "emit",
        entries: &["rank_counts", "check_capacity", "emit"],
        scalar: ScalarType::F32,
        parts: &[REACH, STEP, TOUCHES, include_str!("stages/emit.wgsl")],
    },
    Shader {
        name: "ranges",
        entries: &["ranges"],
        scalar: ScalarType::F32,
        parts: &[STEP, include_str!("stages/ranges.wgsl")],
    },
    Shader {
        name: "reach",
        entries: &["reach"],
        scalar: ScalarType::Vec4,
        parts: &[REACH, STEP, SPLAT, include_str!("stages/reach.wgsl")],
    },
    Shader {
        name: "blend",
        entries: &["blend"],
        scalar: ScalarType::Vec4,
        parts: &[SCALAR, BLEND, STEP, SPLAT, BLOCK, include_str!("stages/blend.wgsl")],
    },
    Shader {
        name: "loss",
        entries: &[
            "ssim_rows",
            "ssim_values",
            "ssim_spread",
            "loss_gradient",
            "loss_blocks",
            "loss_total",
        ],
        scalar: ScalarType::F32,
        parts: &[STEP, include_str!("stages/loss.wgsl")],
    },
    Shader {
        name: "blend_adjoint",
        entries: &["blend_adjoint"],
        scalar: ScalarType::Vec4,
        parts: &[SCALAR, BLEND, STEP, SPLAT, BLOCK, include_str!("stages/blend_adjoint.wgsl")],
    },
    Shader {
        name: "gather",
        entries: &["gather"],
        scalar: ScalarType::F32,
        parts: &[STEP, SPLAT, include_str!("stages/gather.wgsl")],
    },
    Shader {
        name: "adam",
        entries: &["adam"],
        scalar: ScalarType::F32,
        parts: &[
            SCALAR,
            PROJECT,
            PROJECT_ADJOINT,
            SH,
            STEP,
            PARAMS,
            include_str!("stages/adam.wgsl"),
        ],
    },
];

/// The shaders of the codec in the loop, in the order of the stages.
pub(crate) const CODEC_SHADERS: &[Shader] = &[
    Shader {
        name: "side",
        entries: &["load", "add_predicted"],
        scalar: ScalarType::F32,
        parts: &[STEP, CODEC, include_str!("stages/codec/side.wgsl")],
    },
    Shader {
        name: "transform",
        entries: &["transform"],
        scalar: ScalarType::F32,
        parts: &[STEP, CODEC, include_str!("stages/codec/transform.wgsl")],
    },
    Shader {
        name: "quantise",
        entries: &["quantise_means", "quantise"],
        scalar: ScalarType::F32,
        parts: &[STEP, CODEC, include_str!("stages/codec/quantise.wgsl")],
    },
    Shader {
        name: "rebuild",
        entries: &["rebuild"],
        scalar: ScalarType::F32,
        parts: &[STEP, CODEC, include_str!("stages/codec/rebuild.wgsl")],
    },
    Shader {
        name: "move_latents",
        entries: &["move_latents"],
        scalar: ScalarType::F32,
        parts: &[
            SCALAR,
            PROJECT,
            PROJECT_ADJOINT,
            SH,
            STEP,
            PARAMS,
            CODEC,
            include_str!("stages/codec/latents.wgsl"),
        ],
    },
];

impl Shader {
    /// The whole text.
    pub(crate) fn source(&self) -> String {
        let mut out = String::new();
        // Formatting into a String cannot fail.
        let _ = self.constants(&mut out);
        out.push_str(PRELUDE);
        for part in self.parts {
            out.push_str(part);
        }
        let taps: Vec<String> = taps().iter().map(|&t| exact(t as f32)).collect();
        repeat(&out.replace("SSIM_TAPS", &taps.join(", ")))
    }

    fn constants(&self, out: &mut String) -> std::fmt::Result {
        let aliases = match self.scalar {
            ScalarType::F32 => ["f32", "bool", "i32", "u32"].map(String::from),
            ScalarType::Vec4 => ["f32", "bool", "i32", "u32"].map(|t| format!("vec4<{t}>")),
        };
        for (name, alias) in ["F", "B", "I", "U"].iter().zip(&aliases) {
            writeln!(out, "alias {name} = {alias};")?;
        }
        for (name, value) in [
            ("TILE", TILE),
            ("DISPATCH_ROW", DISPATCH_ROW),
            ("RADIX_BLOCK", RADIX_BLOCK),
            ("RADIX_PER_LANE", RADIX_BLOCK / 64),
            ("RECORD_BATCH", RECORD_BATCH),
            ("RECORD_WORDS", GROUP_TILES * RECORD_BATCH * 7 * BLOCKS),
            ("TILES", GROUP_TILES),
            ("BLOCKS", BLOCKS),
            ("RUN", LOSS_RUN),
            ("CHUNK_WORDS", CHUNK_WORDS),
            ("LAST_CLASS", LAST_CLASS),
        ] {
            writeln!(out, "const {name}: u32 = {value}u;")?;
        }
        for (name, value) in [
            ("T_STOP", T_STOP),
            ("ALPHA_MAX", ALPHA_MAX),
            ("SIGMA_MAX", SIGMA_MAX),
            ("BLUR", BLUR),
            ("NEAR", NEAR),
            ("LOG_SCALE_MAX", LOG_SCALE_MAX),
            ("MIN_QUATERNION_NORM2", MIN_QUATERNION_NORM2),
            ("MAX_QUATERNION_NORM2", MAX_QUATERNION_NORM2),
            ("ADAM_BETA1", BETA1),
            ("ADAM_BETA1_REST", 1.0 - BETA1),
            ("ADAM_BETA2", BETA2),
            ("ADAM_BETA2_REST", 1.0 - BETA2),
            ("ADAM_EPSILON", EPSILON),
            ("MIN_LOGIT", MIN_LOGIT),
            ("MAX_LOGIT", MAX_LOGIT),
            ("EQUAL_AXES", EQUAL_AXES),
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
    use naga::back;
    use naga::valid::{Capabilities, ValidationFlags, Validator};

    /// Every shader is valid without optional capabilities and translates to every language that a
    /// backend of wgpu reads. The test needs no adapter.
    #[test]
    fn every_shader_is_valid_and_translates_everywhere() {
        for shader in SHADERS.iter().chain(CODEC_SHADERS) {
            let source = shader.source();
            let module = naga::front::wgsl::parse_str(&source)
                .unwrap_or_else(|e| panic!("{}: {}", shader.name, e.emit_to_string(&source)));
            let entries: Vec<_> = module.entry_points.iter().map(|e| e.name.as_str()).collect();
            assert_eq!(entries, shader.entries, "{}", shader.name);
            let info = Validator::new(ValidationFlags::all(), Capabilities::empty())
                .validate(&module)
                .unwrap_or_else(|e| panic!("{}: {}", shader.name, e.emit_to_string(&source)));
            let bindings = bindings(&source);
            assert_eq!(bindings.len(), source.matches("@binding(").count(), "{}", shader.name);
            let storage = bindings.iter().filter(|b| b.access != Access::Uniform).count();
            assert!(storage <= 8, "{}: {storage} storage buffers", shader.name);

            let words =
                back::spv::write_vec(&module, &info, &back::spv::Options::default(), None).unwrap();
            assert!(words.len() > 100);

            let options = back::msl::Options { fake_missing_bindings: true, ..Default::default() };
            let pipeline = back::msl::PipelineOptions::default();
            let (msl, _) = back::msl::write_string(&module, &info, &options, &pipeline).unwrap();

            let options = back::hlsl::Options {
                shader_model: back::hlsl::ShaderModel::V6_0,
                fake_missing_bindings: true,
                ..Default::default()
            };
            let mut hlsl = String::new();
            let pipeline = back::hlsl::PipelineOptions::default();
            back::hlsl::Writer::new(&mut hlsl, &options, &pipeline)
                .write(&module, &info, None)
                .unwrap();
            for entry in shader.entries {
                assert!(msl.contains(entry) && hlsl.contains(entry), "{}", shader.name);
            }
        }
    }

    #[test]
    fn blocks_of_lines_repeat_and_nest() {
        let text = "a\n  //@each i 0 1\nb$i\n//@each k x y\nc$i$k\n//@end\n  //@end\nd";
        assert_eq!(repeat(text), "a\nb0\nc0x\nc0y\nb1\nc1x\nc1y\nd\n");
        for shader in SHADERS.iter().chain(CODEC_SHADERS) {
            let source = shader.source();
            assert!(!source.contains('$') && !source.contains("//@"), "{}", shader.name);
        }
    }

    #[test]
    fn workgroup_memory_stays_within_the_portable_limit() {
        let words = GROUP_TILES * RECORD_BATCH * 7 * BLOCKS + 2;
        let adjoint = 4 * words;
        assert!(adjoint <= 16 * 1024, "{adjoint} bytes");
    }
}

//! Reads `.glb` files.

use std::path::Path;

use super::accessor::View;
use super::axes::{SH_SIGNS, turned, turned_rotation};
use super::json::{POINTS, Primitive, Root, Splats};
use super::{EXTENSION, attribute, container, malformed, sh_attribute};
use crate::error::Result;
use crate::options::ReadOptions;
use crate::report;
use crate::rows::{self, SH};
use crate::scene::{Scene, sh_len};

/// Extensions that a file may require.
const KNOWN: [&str; 2] = [EXTENSION, "KHR_mesh_quantization"];
/// Least bytes that a Gaussian takes: every one has a mean of its own.
const LEAST_BYTES: usize = 3;

/// Reads a `.glb` file: all primitives with the extension, one after the other.
pub(crate) fn decode(
    file: &Path,
    bytes: &[u8],
    options: &ReadOptions,
) -> Result<(Scene, report::Report)> {
    let (json, data) = container::split(bytes).map_err(|e| malformed(file, "the file", e))?;
    let root: Root = serde_json::from_slice(json)
        .map_err(|e| malformed(file, "the JSON", &format!("is not that of a glTF file: {e}")))?;
    check(file, &root)?;
    let mut parts = Vec::new();
    for (m, mesh) in root.meshes.iter().enumerate() {
        for (p, primitive) in mesh.primitives.iter().enumerate() {
            if let Some(splats) = &primitive.extensions.splats {
                let place = format!("mesh {m}, primitive {p}:");
                parts.push(Part::of(file, &root, data, primitive, splats, &place)?);
            }
        }
    }
    if parts.is_empty() {
        return Err(malformed(file, "the file", &format!("has no mesh with {EXTENSION}")));
    }
    let total = parts.iter().try_fold(0usize, |sum, part| sum.checked_add(part.means.count));
    // Primitives that share their data would claim any amount of memory.
    if total.is_none_or(|n| n > data.len() / LEAST_BYTES) {
        return Err(malformed(
            file,
            "the meshes",
            "have more Gaussians than the file has data for",
        ));
    }
    let sh_degree = parts.iter().map(Part::sh_degree).max().unwrap_or(0);
    let mut scene = Scene { sh_degree, ..Scene::default() };
    for part in parts {
        scene.append(&part.scene()?);
    }
    report::finish(file, scene, report::Format::Gltf, options)
}

/// Refuses what would change the splats and is not read.
fn check(file: &Path, root: &Root) -> Result<()> {
    if let Some(name) = root.extensions_required.iter().find(|n| !KNOWN.contains(&n.as_str())) {
        return Err(malformed(file, "the file", &format!("requires {name}, which is not read")));
    }
    // Nodes that something above them moves.
    let mut moved: Vec<bool> = root.nodes.iter().map(super::json::Node::has_transform).collect();
    let mut unvisited: Vec<usize> = (0..moved.len()).filter(|&i| moved[i]).collect();
    while let Some(i) = unvisited.pop() {
        for &child in &root.nodes[i].children {
            if moved.get(child) == Some(&false) {
                moved[child] = true;
                unvisited.push(child);
            }
        }
    }
    let has_splats = |mesh: Option<usize>| {
        let mesh = mesh.and_then(|mesh| root.meshes.get(mesh));
        mesh.is_some_and(|mesh| mesh.primitives.iter().any(|p| p.extensions.splats.is_some()))
    };
    let bad = (0..moved.len()).find(|&i| moved[i] && has_splats(root.nodes[i].mesh));
    match bad {
        Some(i) => {
            let reason = "has a transform, which is not read; apply it to the splats first";
            Err(malformed(file, &format!("node {i}"), reason))
        }
        None => Ok(()),
    }
}

/// The attributes of a primitive, all of one length.
struct Part<'a> {
    means: View<'a>,
    rotations: View<'a>,
    scales: View<'a>,
    opacities: View<'a>,
    sh: Vec<View<'a>>,
}

impl<'a> Part<'a> {
    fn of(
        file: &Path,
        root: &Root,
        data: &'a [u8],
        primitive: &Primitive,
        splats: &Splats,
        place: &str,
    ) -> Result<Self> {
        if let Some(problem) = not_read(primitive, splats) {
            return Err(malformed(file, place, &problem));
        }
        let view = |name: &str, kind: &str| -> Result<View<'a>> {
            let bad = |reason: &str| malformed(file, &format!("{place} {name}"), reason);
            let accessor = primitive.attributes.get(name).ok_or_else(|| bad("is missing"))?;
            View::of(root, data, *accessor, kind).map_err(bad)
        };
        let has = |k: usize| primitive.attributes.contains_key(&sh_attribute(k));
        // A degree is there if its first coefficient is; then all of it must be.
        let degree = (1..=3u8).take_while(|&d| has(sh_len(d - 1))).last().unwrap_or(0);
        let sh = (0..sh_len(degree)).map(|k| view(&sh_attribute(k), "VEC3"));
        let part = Self {
            means: view("POSITION", "VEC3")?,
            rotations: view(&attribute("ROTATION"), "VEC4")?,
            scales: view(&attribute("SCALE"), "VEC3")?,
            opacities: view(&attribute("OPACITY"), "SCALAR")?,
            sh: sh.collect::<Result<_>>()?,
        };
        let others = [&part.rotations, &part.scales, &part.opacities].into_iter().chain(&part.sh);
        if others.into_iter().any(|view| view.count != part.means.count) {
            return Err(malformed(file, place, "has attributes of different lengths"));
        }
        Ok(part)
    }

    fn sh_degree(&self) -> u8 {
        (self.sh.len().isqrt() - 1) as u8
    }

    fn scene(&self) -> Result<Scene> {
        rows::scene(self.means.count, self.sh_degree(), |mut rows| {
            for i in 0..rows.len() {
                let at = rows.first + i;
                let mean = turned([0, 1, 2].map(|k| self.means.number(at, k)));
                // w is last in the file, first in a scene.
                let rotation = turned_rotation([3, 0, 1, 2].map(|k| self.rotations.number(at, k)));
                rows.set(i, |c| match c {
                    0..3 => mean[c],
                    3..7 => rotation[c - 3],
                    7..10 => libm::log(f64::from(self.scales.number(at, c - 7))) as f32,
                    10 => logit(self.opacities.number(at, 0), self.opacities.half_step()),
                    _ => {
                        let (k, channel) = ((c - SH) / 3, (c - SH) % 3);
                        SH_SIGNS[k] * self.sh[k].number(at, channel)
                    }
                });
            }
            Ok(())
        })
    }
}

/// What of a primitive is not read.
fn not_read(primitive: &Primitive, splats: &Splats) -> Option<String> {
    if let Some(name) = splats.extensions.keys().next() {
        return Some(format!("is compressed ({name}), which is not read; decompress it first"));
    }
    if primitive.mode != POINTS {
        return Some("is not of mode POINTS".into());
    }
    if splats.kernel != "ellipse" {
        return Some(format!("has the kernel {:?}; \"ellipse\" is read", splats.kernel));
    }
    if splats.color_space != "srgb_rec709_display" {
        let space = &splats.color_space;
        return Some(format!("has the colour space {space:?}; \"srgb_rec709_display\" is read"));
    }
    None
}

/// The logit of an opacity; NaN outside 0..1. An opacity of 1 stands for what rounds to it, and so for
/// half of a half step below; one of 0 for the least positive float, or likewise.
fn logit(opacity: f32, half_step: f64) -> f32 {
    let opacity = f64::from(opacity);
    if !(0.0..=1.0).contains(&opacity) {
        return f32::NAN;
    }
    let coarse = half_step > 1e-6;
    let least = if coarse { half_step / 2.0 } else { f64::from(f32::MIN_POSITIVE) };
    let opacity = opacity.clamp(least, 1.0 - half_step / 2.0);
    (libm::log(opacity) - libm::log1p(-opacity)) as f32
}

//! Reads `.glb` files.

use std::path::Path;

use super::accessor::Numbers;
use super::coded::Coded;
use super::json::{POINTS, Primitive, Root, SplatExtension};
use super::{EXTENSION, FORMAT, attribute, container, malformed, sh_attribute};
use crate::axes::ABOUT_Z;
use crate::codec::Codec;
use crate::error::{Error, Result};
use crate::report::{ReadOptions, Report};
use crate::rows::{self, SH};
use crate::scene::{Scene, sh_len};

/// Extensions that a file may require.
const KNOWN: [&str; 2] = [EXTENSION, "KHR_mesh_quantization"];
/// Least bytes that a Gaussian takes that is not compressed: every one has a mean of its own.
const LEAST_BYTES: u64 = 3;

/// Reads a `.glb` file: all primitives with the extension, one after the other.
pub(super) fn read(file: &Path, bytes: &[u8], options: &ReadOptions) -> Result<(Scene, Report)> {
    let (json, data) = container::split(bytes).map_err(|e| malformed(file, "the file", e))?;
    let root: Root =
        serde_json::from_slice(json).map_err(|e| Error::json(file, "a glTF file", e))?;
    check(file, &root)?;
    let (mut parts, mut places) = (Vec::new(), Vec::new());
    for (m, mesh) in root.meshes.iter().enumerate() {
        for (p, primitive) in mesh.primitives.iter().enumerate() {
            if let Some(splats) = &primitive.extensions.splats {
                let place = format!("mesh {m}, primitive {p}");
                let bad = |(what, reason): Problem| {
                    malformed(file, &(place.clone() + what.as_str()), reason)
                };
                parts.push(Part::of(&root, data, primitive, splats, options.codec).map_err(bad)?);
                places.push(place);
            }
        }
    }
    if parts.is_empty() {
        return Err(malformed(file, "the file", format!("no mesh has {EXTENSION}")));
    }
    bound(&parts, data.len(), options.max_gaussians)
        .map_err(|why| malformed(file, "the meshes", why))?;
    let form = form(&parts);
    let mut scenes = Vec::with_capacity(parts.len());
    for (part, place) in parts.iter().zip(places) {
        scenes.push(part.scene().map_err(|why| malformed(file, &place, why))?);
    }
    Ok((joined(scenes), Report::of(FORMAT.name, form)))
}

/// Refuses what would claim any amount of memory or time: primitives that share their data.
fn bound(parts: &[Part<'_>], data_len: usize, trusted: Option<u64>) -> Result<(), &'static str> {
    let (mut plain, mut coded, mut coded_len) = (0u64, 0u64, 0u64);
    for part in parts {
        let sum = if part.coded().is_some() { &mut coded } else { &mut plain };
        *sum = sum.saturating_add(part.len() as u64);
        coded_len += part.coded().map_or(0, |c| c.data.len() as u64);
    }
    let codec = parts.iter().find_map(Part::coded).map(|c| c.codec);
    let most = codec.map_or(0, |codec| (codec.most)(coded_len)).max(trusted.unwrap_or(0));
    let least_len = plain.saturating_mul(LEAST_BYTES).saturating_add(coded_len);
    if least_len > data_len as u64 || coded > most {
        return Err("more Gaussians than the file has data for");
    }
    Ok(())
}

/// The form of the file in words.
fn form(parts: &[Part<'_>]) -> String {
    match parts.iter().find_map(Part::coded) {
        Some(coded) => format!("glTF, {EXTENSION}, {}", coded.codec.extension),
        None => format!("glTF, {EXTENSION}"),
    }
}

/// All Gaussians, in order.
fn joined(mut scenes: Vec<Scene>) -> Scene {
    if scenes.len() == 1 {
        return scenes.swap_remove(0);
    }
    let sh_degree = scenes.iter().map(|scene| scene.sh_degree).max().unwrap_or(0);
    let mut all = Scene { sh_degree, ..Scene::default() };
    scenes.into_iter().for_each(|scene| all.append(&scene));
    all
}

/// Refuses what would change the splats and is not read.
fn check(file: &Path, root: &Root) -> Result<()> {
    let splats = || {
        root.meshes.iter().flat_map(|m| &m.primitives).filter_map(|p| p.extensions.splats.as_ref())
    };
    // What compresses a primitive is looked at there.
    let known = |n: &str| KNOWN.contains(&n) || splats().any(|s| s.extensions.contains_key(n));
    if let Some(name) = root.extensions_required.iter().find(|n| !known(n)) {
        return Err(malformed(file, "the file", format!("it requires {name}, which is not read")));
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
            let reason = "it has a transform, which is not read; apply it to the splats first";
            Err(malformed(file, &format!("node {i}"), reason))
        }
        None => Ok(()),
    }
}

/// What of a primitive (nothing for the whole of it), and what is wrong with it.
type Problem = (String, String);

/// A primitive.
enum Part<'a> {
    Plain(Attributes<'a>),
    Coded(Coded<'a>),
}

impl<'a> Part<'a> {
    fn of(
        root: &Root,
        data: &'a [u8],
        primitive: &Primitive,
        splats: &SplatExtension,
        codec: Option<&'static Codec>,
    ) -> Result<Self, Problem> {
        let whole = |reason: String| (String::new(), reason);
        if let Some(problem) = not_read(primitive, splats) {
            return Err(whole(problem));
        }
        match Coded::of(root, data, primitive, splats, codec).map_err(whole)? {
            Some(coded) => Ok(Self::Coded(coded)),
            None => Attributes::of(root, data, primitive).map(Self::Plain),
        }
    }

    fn coded(&self) -> Option<&Coded<'a>> {
        match self {
            Self::Coded(coded) => Some(coded),
            Self::Plain(_) => None,
        }
    }

    fn len(&self) -> usize {
        match self {
            Self::Coded(coded) => coded.count,
            Self::Plain(attributes) => attributes.means.count,
        }
    }

    fn scene(&self) -> Result<Scene, String> {
        match self {
            Self::Coded(coded) => coded.scene(),
            Self::Plain(attributes) => Ok(attributes.scene()),
        }
    }
}

/// The attributes of a primitive, all of one length.
struct Attributes<'a> {
    means: Numbers<'a>,
    rotations: Numbers<'a>,
    scales: Numbers<'a>,
    opacities: Numbers<'a>,
    sh: Vec<Numbers<'a>>,
}

impl<'a> Attributes<'a> {
    fn of(root: &Root, data: &'a [u8], primitive: &Primitive) -> Result<Self, Problem> {
        let numbers = |name: &str, kind: &str| {
            let bad = |reason: &str| (format!(", {name}"), reason.to_owned());
            let accessor = primitive.attributes.get(name).ok_or_else(|| bad("it is missing"))?;
            Numbers::of(root, data, *accessor, kind).map_err(bad)
        };
        let has = |k: usize| primitive.attributes.contains_key(&sh_attribute(k));
        // A degree is there if its first coefficient is; then all of it must be.
        let degree = (1..=3u8).take_while(|&d| has(sh_len(d - 1))).last().unwrap_or(0);
        let sh = (0..sh_len(degree)).map(|k| numbers(&sh_attribute(k), "VEC3"));
        let part = Self {
            means: numbers("POSITION", "VEC3")?,
            rotations: numbers(&attribute("ROTATION"), "VEC4")?,
            scales: numbers(&attribute("SCALE"), "VEC3")?,
            opacities: numbers(&attribute("OPACITY"), "SCALAR")?,
            sh: sh.collect::<Result<_, _>>()?,
        };
        let others = [&part.rotations, &part.scales, &part.opacities].into_iter().chain(&part.sh);
        if others.into_iter().any(|numbers| numbers.count != part.means.count) {
            return Err((String::new(), "its attributes have different lengths".into()));
        }
        Ok(part)
    }

    fn sh_degree(&self) -> u8 {
        (self.sh.len().isqrt() - 1) as u8
    }

    fn scene(&self) -> Scene {
        rows::scene_of(self.means.count, self.sh_degree(), |i| {
            let mean = ABOUT_Z.mean([0, 1, 2].map(|k| self.means.number(i, k)));
            // w is last in the file, first in a scene.
            let rotation = ABOUT_Z.rotation([3, 0, 1, 2].map(|k| self.rotations.number(i, k)));
            move |c| match c {
                0..3 => mean[c],
                3..7 => rotation[c - 3],
                7..10 => libm::log(f64::from(self.scales.number(i, c - 7))) as f32,
                10 => logit(self.opacities.number(i, 0), self.opacities.half_step()),
                _ => {
                    let (k, channel) = ((c - SH) / 3, (c - SH) % 3);
                    ABOUT_Z.sh(k, self.sh[k].number(i, channel))
                }
            }
        })
    }
}

/// What of a primitive is not read.
fn not_read(primitive: &Primitive, splats: &SplatExtension) -> Option<String> {
    if primitive.mode != POINTS {
        return Some("it is not of mode POINTS".into());
    }
    if splats.kernel != "ellipse" {
        return Some(format!("it has the kernel {:?}; \"ellipse\" is read", splats.kernel));
    }
    if splats.color_space != "srgb_rec709_display" {
        let space = &splats.color_space;
        return Some(format!("it has the colour space {space:?}; \"srgb_rec709_display\" is read"));
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

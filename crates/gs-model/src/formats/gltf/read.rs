//! Reads `.glb` and `.gltf` files.

use std::path::Path;

use super::accessor::Numbers;
use super::buffers::Buffers;
use super::coded::{CompressedPrimitive, Decoder};
use super::instances::{Instance, instances};
use super::json::{POINTS, Primitive, Root, SplatExtension};
use super::{EXTENSION, FORMAT, attribute, container, malformed, sh_attribute, spz};
use crate::axes::{ABOUT_X, ABOUT_Z};
use crate::codec::Codec;
use crate::error::{Error, Result, list};
use crate::report::{ReadOptions, Report};
use crate::rows::{self, SH};
use crate::scene::{Scene, sh_len};

/// Extensions that a file may require. The one of materials says nothing of splats.
const KNOWN: [&str; 4] =
    [EXTENSION, spz::EXTENSION, "KHR_mesh_quantization", "KHR_materials_unlit"];
/// Least bytes that a Gaussian takes that is not compressed: every one has a mean of its own.
const LEAST_BYTES: u64 = 3;
/// Most Gaussians of all nodes together, for each of the meshes: nodes may share a mesh.
const MOST_SHARING: u64 = 64;

/// Reads a file: the primitives with the extension of the scene's nodes, one after the other.
pub(super) fn read(file: &Path, bytes: &[u8], options: &ReadOptions) -> Result<(Scene, Report)> {
    let (json, data) = container::split(bytes).map_err(|e| malformed(file, "the file", e))?;
    let root: Root =
        serde_json::from_slice(json).map_err(|e| Error::json(file, "a glTF file", &e))?;
    check(file, &root)?;
    let instances =
        instances(&root).map_err(|(node, why)| malformed(file, &format!("node {node}"), why))?;
    let buffers = Buffers::new(file, &root, data);
    // Of each mesh in the scene, its primitives with Gaussians.
    let mut meshes: Vec<Option<Vec<Part<'_>>>> = root.meshes.iter().map(|_| None).collect();
    for Instance { mesh, .. } in &instances {
        if meshes[*mesh].is_none() {
            meshes[*mesh] = Some(parts(file, &root, &buffers, *mesh, options)?);
        }
    }
    let every: Vec<&Part<'_>> = meshes.iter().flatten().flatten().collect();
    if every.is_empty() {
        return Err(malformed(file, "the file", format!("no mesh has {EXTENSION}")));
    }
    bound(&every, buffers.len(), options.max_gaussians)
        .map_err(|why| malformed(file, "the meshes", why))?;
    let mut report = Report::of(FORMAT.name, form(&every));
    report.bytes_beside = buffers.beside();
    let once: u64 = every.iter().map(|part| part.len() as u64).sum();
    let mut all: Option<Scene> = None;
    let mut placed = 0u64;
    for Instance { mesh, node, placement } in &instances {
        for part in meshes[*mesh].iter().flatten() {
            let (mut scene, notes) = part.scene(file, options)?;
            placed += scene.len() as u64;
            if placed > MOST_SHARING.saturating_mul(once.max(scene.len() as u64)) {
                let why = "its nodes show the same meshes too often";
                return Err(malformed(file, "the scene", why));
            }
            if !placement.seen_from(part.axes()).scene(&mut scene) {
                let place = node.map_or("the file".into(), |node| format!("node {node}"));
                let why = "it, or a node above it, shears, scales its axes apart or has no finite extent, which \
                           no Gaussian follows; apply the scale to the splats in the tool that made the file";
                return Err(malformed(file, &place, why));
            }
            notes.into_iter().for_each(|note| say(&mut report, note));
            part.notes.iter().for_each(|note| say(&mut report, note.clone()));
            if all.as_ref().is_some_and(|before| before.antialiased != scene.antialiased) {
                let which = if scene.antialiased { "not antialiased" } else { "antialiased" };
                say(
                    &mut report,
                    format!(
                        "some meshes are antialiased and some are not; all are read as {which}, as the first is"
                    ),
                );
            }
            all = Some(match all {
                None => scene,
                Some(before) => joined(before, scene),
            });
        }
    }
    let unread = list((0..meshes.len()).filter(|&m| meshes[m].is_none()).map(|m| m.to_string()));
    if let Some(unread) = unread {
        say(
            &mut report,
            format!("meshes without Gaussians or outside the scene are not read: {unread}"),
        );
    }
    if !root.animations.is_empty() {
        say(&mut report, "animations are not read".into());
    }
    Ok((all.unwrap_or_default(), report))
}

/// Adds a note that is not there yet.
fn say(report: &mut Report, note: String) {
    if !report.notes.contains(&note) {
        report.notes.push(note);
    }
}

/// The primitives of a mesh that have the extension.
fn parts<'a>(
    file: &Path,
    root: &Root,
    buffers: &'a Buffers<'_>,
    mesh: usize,
    options: &ReadOptions,
) -> Result<Vec<Part<'a>>> {
    let mut parts = Vec::new();
    for (p, primitive) in root.meshes[mesh].primitives.iter().enumerate() {
        let Some(splats) = &primitive.extensions.splats else { continue };
        let place = format!("mesh {mesh}, primitive {p}");
        let bad = |(what, reason): Problem| malformed(file, &(place.clone() + &what), reason);
        let data = Data::of(root, buffers, primitive, splats, options.codec).map_err(bad)?;
        parts.push(Part { place, data, notes: notes(primitive, splats) });
    }
    Ok(parts)
}

/// Refuses what would claim any amount of memory or time: primitives that share their data.
fn bound(parts: &[&Part<'_>], data_len: u64, trusted: Option<u64>) -> Result<(), &'static str> {
    let (mut plain, mut coded, mut coded_len, mut most) = (0u64, 0u64, 0u64, 0u64);
    for part in parts {
        match &part.data {
            Data::Plain(attributes) => plain = plain.saturating_add(attributes.means.count as u64),
            Data::CompressedPrimitive(part) => {
                coded_len += part.data.len() as u64;
                // The reader of SPZ has its own bound.
                if let Decoder::Codec(codec) = part.decoder {
                    coded = coded.saturating_add(part.count.unwrap_or_default() as u64);
                    most = (codec.most)(coded_len);
                }
            }
        }
    }
    let least_len = plain.saturating_mul(LEAST_BYTES).saturating_add(coded_len);
    if least_len > data_len || coded > most.max(trusted.unwrap_or(0)) {
        return Err("more Gaussians than the file has data for");
    }
    Ok(())
}

/// The form of the file in words.
fn form(parts: &[&Part<'_>]) -> String {
    let coded = parts.iter().find_map(|part| match &part.data {
        Data::CompressedPrimitive(coded) => Some(coded.decoder.extension()),
        Data::Plain(_) => None,
    });
    match coded {
        Some(extension) => format!("glTF, {EXTENSION}, {extension}"),
        None => format!("glTF, {EXTENSION}"),
    }
}

/// The Gaussians of one scene, then of the other, at the higher SH degree of the two.
fn joined(mut first: Scene, second: Scene) -> Scene {
    if second.sh_degree > first.sh_degree {
        let mut all = first.emptied(second.sh_degree);
        all.append(&first);
        first = all;
    }
    first.append(&second);
    first
}

/// Refuses what would change the splats and is not read.
fn check(file: &Path, root: &Root) -> Result<()> {
    let splats = || {
        root.meshes.iter().flat_map(|m| &m.primitives).filter_map(|p| p.extensions.splats.as_ref())
    };
    // The extensions that compress a primitive are checked where it is read.
    let known = |n: &str| KNOWN.contains(&n) || splats().any(|s| s.extensions.contains_key(n));
    match root.extensions_required.iter().find(|n| !known(n)) {
        Some(name) => {
            Err(malformed(file, "the file", format!("it requires {name}, which is not read")))
        }
        None => Ok(()),
    }
}

/// What of a primitive (nothing for the whole of it), and what is wrong with it.
type Problem = (String, String);

/// A primitive with Gaussians.
struct Part<'a> {
    /// For messages.
    place: String,
    data: Data<'a>,
    /// What of it is not used, a sentence each.
    notes: Vec<String>,
}

impl Part<'_> {
    fn len(&self) -> usize {
        match &self.data {
            Data::CompressedPrimitive(coded) => coded.count.unwrap_or_default(),
            Data::Plain(attributes) => attributes.means.count,
        }
    }

    /// The half turn between the axes of its numbers and those of PLY files. CesiumJS takes the numbers of an SPZ as
    /// they are for those of glTF, and so do nodes.
    fn axes(&self) -> &'static crate::axes::Signs {
        match &self.data {
            Data::CompressedPrimitive(CompressedPrimitive { decoder: Decoder::Spz, .. }) => {
                &ABOUT_X
            }
            _ => &ABOUT_Z,
        }
    }

    fn scene(&self, file: &Path, options: &ReadOptions) -> Result<(Scene, Vec<String>)> {
        match &self.data {
            Data::CompressedPrimitive(coded) => {
                coded.scene(options).map_err(|why| malformed(file, &self.place, why))
            }
            Data::Plain(attributes) => Ok((attributes.scene(file)?, Vec::new())),
        }
    }
}

/// Where its numbers are.
enum Data<'a> {
    Plain(Attributes<'a>),
    CompressedPrimitive(CompressedPrimitive<'a>),
}

impl<'a> Data<'a> {
    fn of(
        root: &Root,
        buffers: &'a Buffers<'_>,
        primitive: &Primitive,
        splats: &SplatExtension,
        codec: Option<&'static Codec>,
    ) -> Result<Self, Problem> {
        let whole = |reason: String| (String::new(), reason);
        if let Some(problem) = not_read(primitive, splats) {
            return Err(whole(problem));
        }
        match CompressedPrimitive::of(root, buffers, primitive, splats, codec).map_err(whole)? {
            Some(coded) => Ok(Self::CompressedPrimitive(coded)),
            None => Attributes::of(root, buffers, primitive).map(Self::Plain),
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
    fn of(root: &Root, buffers: &'a Buffers<'_>, primitive: &Primitive) -> Result<Self, Problem> {
        let numbers = |name: &str, kind: &str| {
            let bad = |reason: String| (format!(", {name}"), reason);
            let accessor = primitive.attributes.get(name);
            let accessor = accessor.ok_or_else(|| bad("it is missing".into()))?;
            Numbers::of(root, buffers, *accessor, kind).map_err(bad)
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

    fn scene(&self, file: &Path) -> Result<Scene> {
        rows::scene_of(file, self.means.count, self.sh_degree(), |i| {
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
    match splats.projection.as_deref() {
        None | Some("perspective") => None,
        Some(other) => Some(format!("it has the projection {other:?}; \"perspective\" is read")),
    }
}

/// What of a primitive is not used, a sentence each.
fn notes(primitive: &Primitive, splats: &SplatExtension) -> Vec<String> {
    let names = ["ROTATION", "SCALE", "OPACITY"].map(attribute);
    let coefficients: Vec<String> = (0..sh_len(3)).map(sh_attribute).collect();
    let known = |name: &str| {
        let has = |known: &[String]| known.iter().any(|k| k == name);
        ["POSITION", "COLOR_0"].contains(&name) || has(&names) || has(&coefficients)
    };
    let others = primitive.attributes.keys().filter(|name| !known(name));
    let others = list(others.cloned());
    let others = others
        .map(|names| format!("attributes that are not part of a model are not kept: {names}"));
    let order = splats.sorting_method.as_deref().filter(|&by| by != "cameraDistance");
    let order = order.map(|by| format!("the sortingMethod {by:?} is not kept"));
    [others, order].into_iter().flatten().collect()
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

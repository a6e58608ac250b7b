//! Writes `.glb` files.

use std::collections::BTreeMap;
use std::io::{self, Write};
use std::path::Path;

use serde_json::{Value, json};

use super::axes::{SH_SIGNS, turned, turned_rotation};
use super::json::{
    self, Accessor, Buffer, BufferView, Extensions, Mesh, Node, Primitive, Root, Splats,
};
use super::{EXTENSION, attribute, container, malformed, sh_attribute};
use crate::error::{Error, Result};
use crate::fs;
use crate::scene::{SH_C0, Scene};

/// Writes a scene as a `.glb` file with one primitive of points.
///
/// Means and SH coefficients are kept bit for bit. Rotations become unit quaternions, scales and
/// opacities linear, all as `f32`: log-scales come back to within 2^-22 of their size or of 1, opacities
/// to within 2^-24. The file appears whole or not at all.
///
/// # Errors
/// [`Error::SceneShape`] or [`Error::SceneDegree`] if the arrays do not fit together;
/// [`Error::Malformed`] for an empty scene, which glTF cannot hold, and for one of more than 4 GiB;
/// [`Error::Io`].
pub fn write(path: impl AsRef<Path>, scene: &Scene) -> Result<()> {
    let path = path.as_ref();
    let head = head(path, scene)?;
    fs::write_atomically(path, |out| write_all(out, &head, scene))
}

/// Writes a scene as [`write()`] does, to anything that takes bytes.
///
/// # Errors
/// As [`write()`]; the file in the errors is `<writer>`.
pub fn write_to(mut out: impl Write, scene: &Scene) -> Result<()> {
    let name = Path::new("<writer>");
    let head = head(name, scene)?;
    write_all(&mut out, &head, scene).map_err(|e| Error::io(name, "write", e))
}

/// Appends the bytes of the Gaussian at an index.
type WriteRow<'a> = Box<dyn Fn(usize, &mut Vec<u8>) + 'a>;

/// An attribute: its name, its accessor's component and type, its bytes per Gaussian.
struct Attribute<'a> {
    name: String,
    component: u32,
    kind: &'static str,
    size: usize,
    row: WriteRow<'a>,
}

/// The attributes of a scene, in file order. Each takes a multiple of 4 bytes per Gaussian.
fn attributes(scene: &Scene) -> Vec<Attribute<'_>> {
    fn floats<'a, const N: usize>(
        name: String,
        kind: &'static str,
        get: impl Fn(usize) -> [f32; N] + 'a,
    ) -> Attribute<'a> {
        let row = move |i: usize, out: &mut Vec<u8>| {
            get(i).iter().for_each(|v| out.extend(v.to_le_bytes()));
        };
        Attribute { name, component: json::F32, kind, size: 4 * N, row: Box::new(row) }
    }
    let colour = move |i: usize, out: &mut Vec<u8>| {
        colour(scene, i).iter().for_each(|v| out.extend(v.to_le_bytes()));
    };
    let mut all = vec![
        floats("POSITION".into(), "VEC3", |i| turned(scene.means[i])),
        Attribute {
            name: "COLOR_0".into(),
            component: json::U16,
            kind: "VEC4",
            size: 8,
            row: Box::new(colour),
        },
        floats(attribute("ROTATION"), "VEC4", |i| unit_xyzw(scene.rotations[i])),
        floats(attribute("SCALE"), "VEC3", |i| scene.log_scales[i].map(scale)),
        floats(attribute("OPACITY"), "SCALAR", |i| [opacity(scene.opacity_logits[i]) as f32]),
    ];
    all.extend((0..scene.sh_len()).map(|k| {
        let sh = move |i: usize| scene.sh_of(i)[k].map(|v| SH_SIGNS[k] * v);
        floats(sh_attribute(k), "VEC3", sh)
    }));
    all
}

/// A standard deviation. One that is 0 or infinite as a float could not be read back.
fn scale(log_scale: f32) -> f32 {
    let scale = libm::exp(f64::from(log_scale));
    (scale as f32).clamp(f32::MIN_POSITIVE, f32::MAX)
}

fn opacity(logit: f32) -> f64 {
    1.0 / (1.0 + libm::exp(-f64::from(logit)))
}

/// A quaternion `[w, x, y, z]` of any norm, turned, as a unit quaternion x, y, z, w; the identity for one
/// without direction.
fn unit_xyzw(q: [f32; 4]) -> [f32; 4] {
    let [w, x, y, z] = turned_rotation(q).map(f64::from);
    let norm = (w * w + x * x + y * y + z * z).sqrt();
    if norm > 0.0 && norm.is_finite() {
        [x, y, z, w].map(|v| (v / norm) as f32)
    } else {
        [0.0, 0.0, 0.0, 1.0]
    }
}

/// `COLOR_0`: the colour without view dependence, in linear light as glTF has it, and the opacity.
fn colour(scene: &Scene, i: usize) -> [u16; 4] {
    let word = |v: f64| libm::round(65535.0 * v) as u16;
    let [r, g, b] = scene.sh_of(i)[0].map(|v| {
        let srgb = f64::from(0.5 + SH_C0 * v).clamp(0.0, 1.0);
        let linear =
            if srgb <= 0.04045 { srgb / 12.92 } else { libm::pow((srgb + 0.055) / 1.055, 2.4) };
        word(linear)
    });
    [r, g, b, word(opacity(scene.opacity_logits[i]))]
}

fn write_all(out: &mut dyn Write, head: &[u8], scene: &Scene) -> io::Result<()> {
    out.write_all(head)?;
    attributes(scene)
        .iter()
        .try_for_each(|attribute| container::write_rows(out, scene.len(), &attribute.row))
}

/// Everything before the data.
fn head(file: &Path, scene: &Scene) -> Result<Vec<u8>> {
    scene.check_shape()?;
    if scene.is_empty() {
        return Err(malformed(
            file,
            "an empty model",
            "cannot be written: glTF has no empty meshes",
        ));
    }
    let attributes = attributes(scene);
    let data_len: u64 = attributes.iter().map(|a| (a.size * scene.len()) as u64).sum();
    let root = root(scene, &attributes, data_len);
    let json = serde_json::to_vec(&root)
        .map_err(|e| malformed(file, "the JSON", &format!("cannot be written: {e}")))?;
    container::head(&json, data_len).ok_or_else(|| {
        malformed(file, "a model of more than 4 GiB", "cannot be written; lower its SH degree")
    })
}

fn root(scene: &Scene, attributes: &[Attribute], data_len: u64) -> Root {
    let (low, high) = bounds(scene);
    let (mut accessors, mut views, mut names) = (Vec::new(), Vec::new(), BTreeMap::new());
    let mut byte_offset = 0;
    for (at, attribute) in attributes.iter().enumerate() {
        let byte_length = attribute.size * scene.len();
        let position = at == 0;
        names.insert(attribute.name.clone(), at);
        accessors.push(Accessor {
            buffer_view: Some(at),
            byte_offset: 0,
            component_type: attribute.component,
            normalized: attribute.component != json::F32,
            count: scene.len(),
            kind: attribute.kind.into(),
            min: position.then(|| low.to_vec()),
            max: position.then(|| high.to_vec()),
            sparse: None,
        });
        let target = Some(json::ARRAY_BUFFER);
        views.push(BufferView { buffer: 0, byte_offset, byte_length, byte_stride: None, target });
        byte_offset += byte_length;
    }
    let splats = Splats {
        kernel: "ellipse".into(),
        color_space: "srgb_rec709_display".into(),
        extensions: BTreeMap::new(),
    };
    let extensions = Extensions { splats: Some(splats) };
    let primitive = Primitive { attributes: names, mode: json::POINTS, extensions };
    let object = |key: &str, value: Value| BTreeMap::from([(key.to_owned(), value)]);
    let mut asset = object("version", json!("2.0"));
    asset.extend(object("generator", json!("gsvx")));
    Root {
        asset,
        extensions_used: vec![EXTENSION.into()],
        extensions_required: Vec::new(),
        scene: Some(0),
        scenes: vec![object("nodes", json!([0]))],
        nodes: vec![Node { mesh: Some(0), ..Node::default() }],
        meshes: vec![Mesh { primitives: vec![primitive] }],
        accessors,
        buffer_views: views,
        buffers: vec![Buffer { byte_length: data_len, uri: None }],
    }
}

/// Least and greatest coordinates of the turned means.
fn bounds(scene: &Scene) -> ([f64; 3], [f64; 3]) {
    let (mut low, mut high) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
    for &mean in &scene.means {
        for (k, v) in turned(mean).into_iter().map(f64::from).enumerate() {
            low[k] = low[k].min(v);
            high[k] = high[k].max(v);
        }
    }
    (low, high)
}

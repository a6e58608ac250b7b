//! Writes `.glb` files.

use std::io::Write;
use std::path::Path;

use super::compressed::empty;
use super::document::{Document, bound};
use super::json;
use super::{attribute, container, sh_attribute};
use crate::axes::ABOUT_Z;
use crate::error::{Error, Result};
use crate::math::unit;
use crate::scene::{SH_C0, Scene};

/// Gaussians whose numbers are buffered.
const ROWS: usize = 4096;

/// Writes a `.glb` file with one primitive of points.
pub(super) fn write(file: &Path, out: &mut dyn Write, scene: &Scene) -> Result<()> {
    let head = head(file, scene)?;
    let mut put = |bytes: &[u8]| out.write_all(bytes).map_err(|e| Error::io(file, "write", e));
    put(&head)?;
    let mut buffer = Vec::new();
    for attribute in attributes(scene) {
        for first in (0..scene.len()).step_by(ROWS) {
            buffer.clear();
            (first..scene.len().min(first + ROWS)).for_each(|i| (attribute.row)(i, &mut buffer));
            put(&buffer)?;
        }
    }
    Ok(())
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
        floats("POSITION".into(), "VEC3", |i| ABOUT_Z.mean(scene.means[i])),
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
        let sh = move |i: usize| scene.sh_of(i)[k].map(|v| ABOUT_Z.sh(k, v));
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
    let [w, x, y, z] = unit(ABOUT_Z.rotation(q));
    [x, y, z, w].map(|v| v as f32)
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

/// Everything before the data.
fn head(file: &Path, scene: &Scene) -> Result<Vec<u8>> {
    if scene.is_empty() {
        return Err(empty(file));
    }
    let mut document = Document::new(scene.len());
    for (at, attribute) in attributes(scene).into_iter().enumerate() {
        let length = (attribute.size * scene.len()) as u64;
        let view = document.view(length, Some(json::ARRAY_BUFFER));
        let Attribute { name, component, kind, .. } = attribute;
        let accessor = document.attribute(name, component, kind, Some(view));
        if at == 0 {
            bound(accessor, scene.bounds(), &ABOUT_Z);
        }
    }
    let length = document.length();
    let large = "it takes more than 4 GiB, which glTF cannot hold; lower its SH degree";
    container::head(&document.json(None, ABOUT_Z.place(scene.origin)), length)
        .ok_or_else(|| Error::unwritable(file, large))
}

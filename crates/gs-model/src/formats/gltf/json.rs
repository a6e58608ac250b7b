//! The JSON of a glTF file, as far as splats need it.
//!
//! The crates `gltf` and `gltf-json` drop attributes whose names they do not know, and so those of the
//! extension.

use std::collections::BTreeMap;

use serde::Deserialize;
use serde::de::IgnoredAny;
use serde_json::Value;

use crate::axes::Placement;
use crate::math::scaled_rotation;

/// `componentType` of accessors.
pub(super) const I8: u32 = 5120;
pub(super) const U8: u32 = 5121;
pub(super) const I16: u32 = 5122;
pub(super) const U16: u32 = 5123;
pub(super) const F32: u32 = 5126;
/// `mode` of primitives whose vertices are points.
pub(super) const POINTS: u32 = 0;
/// `mode` where a primitive has none.
const TRIANGLES: u32 = 4;
/// `target` of buffer views that hold attributes.
pub(super) const ARRAY_BUFFER: u32 = 34962;

#[derive(Default, Deserialize)]
#[serde(rename_all = "camelCase", default)]
pub(super) struct Root {
    pub(super) extensions_required: Vec<String>,
    pub(super) scene: usize,
    pub(super) scenes: Vec<SceneNodes>,
    pub(super) animations: Vec<IgnoredAny>,
    pub(super) nodes: Vec<Node>,
    pub(super) meshes: Vec<Mesh>,
    pub(super) accessors: Vec<Accessor>,
    pub(super) buffer_views: Vec<BufferView>,
    pub(super) buffers: Vec<Buffer>,
}

impl Root {
    /// True for a mesh with Gaussians.
    pub(super) fn has_splats(&self, mesh: usize) -> bool {
        let mesh = self.meshes.get(mesh);
        mesh.is_some_and(|mesh| mesh.primitives.iter().any(|p| p.extensions.splats.is_some()))
    }
}

/// The roots of a scene.
#[derive(Deserialize)]
pub(super) struct SceneNodes {
    #[serde(default)]
    pub(super) nodes: Vec<usize>,
}

#[derive(Default, Deserialize)]
#[serde(default)]
pub(super) struct Node {
    pub(super) mesh: Option<usize>,
    pub(super) children: Vec<usize>,
    matrix: Option<[f64; 16]>,
    translation: Option<[f64; 3]>,
    /// x, y, z, w.
    rotation: Option<[f64; 4]>,
    scale: Option<[f64; 3]>,
    pub(super) extensions: BTreeMap<String, IgnoredAny>,
}

impl Node {
    /// Where the node puts what is below it; `None` for a matrix that does more than place.
    pub(super) fn placement(&self) -> Option<Placement> {
        if let Some(m) = self.matrix {
            // Columns.
            if [m[3], m[7], m[11], m[15]] != [0.0, 0.0, 0.0, 1.0] {
                return None;
            }
            let matrix = std::array::from_fn(|i| std::array::from_fn(|j| m[4 * j + i]));
            return Some(Placement { matrix, shift: [m[12], m[13], m[14]] });
        }
        let [x, y, z, w] = self.rotation.unwrap_or([0.0, 0.0, 0.0, 1.0]);
        let square = x * x + y * y + z * z + w * w;
        let twice = if square > 0.0 { 2.0 / square } else { 0.0 };
        let scale = self.scale.unwrap_or([1.0; 3]);
        let turn = scaled_rotation([w, x, y, z], twice);
        let matrix = turn.map(|row| std::array::from_fn(|j| row[j] * scale[j]));
        Some(Placement { matrix, shift: self.translation.unwrap_or_default() })
    }
}

#[derive(Deserialize)]
pub(super) struct Mesh {
    pub(super) primitives: Vec<Primitive>,
}

#[derive(Deserialize)]
pub(super) struct Primitive {
    pub(super) attributes: BTreeMap<String, usize>,
    #[serde(default = "triangles")]
    pub(super) mode: u32,
    #[serde(default)]
    pub(super) extensions: Extensions,
}

fn triangles() -> u32 {
    TRIANGLES
}

#[derive(Default, Deserialize)]
pub(super) struct Extensions {
    #[serde(rename = "KHR_gaussian_splatting")]
    pub(super) splats: Option<SplatExtension>,
}

/// The extension of a primitive.
#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct SplatExtension {
    /// Drafts of the extension have neither of the first two.
    #[serde(default = "ellipse")]
    pub(super) kernel: String,
    #[serde(default = "srgb")]
    pub(super) color_space: String,
    pub(super) projection: Option<String>,
    pub(super) sorting_method: Option<String>,
    /// Extensions of the extension: compression.
    #[serde(default)]
    pub(super) extensions: BTreeMap<String, Value>,
}

fn ellipse() -> String {
    "ellipse".into()
}

fn srgb() -> String {
    "srgb_rec709_display".into()
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Accessor {
    pub(super) buffer_view: Option<usize>,
    #[serde(default)]
    pub(super) byte_offset: usize,
    pub(super) component_type: u32,
    #[serde(default)]
    pub(super) normalized: bool,
    pub(super) count: usize,
    #[serde(rename = "type")]
    pub(super) kind: String,
    pub(super) sparse: Option<Value>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct BufferView {
    pub(super) buffer: usize,
    #[serde(default)]
    pub(super) byte_offset: usize,
    pub(super) byte_length: usize,
    pub(super) byte_stride: Option<usize>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Buffer {
    pub(super) uri: Option<String>,
    pub(super) byte_length: usize,
}

//! The JSON of a glTF file, as far as splats need it.
//!
//! The crates `gltf` and `gltf-json` drop attributes whose names they do not know, and so those of the
//! extension.

use std::collections::BTreeMap;

use serde::Deserialize;
use serde_json::Value;

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
    pub(super) nodes: Vec<Node>,
    pub(super) meshes: Vec<Mesh>,
    pub(super) accessors: Vec<Accessor>,
    pub(super) buffer_views: Vec<BufferView>,
    pub(super) buffers: Vec<Buffer>,
}

#[derive(Default, Deserialize)]
#[serde(default)]
pub(super) struct Node {
    pub(super) mesh: Option<usize>,
    pub(super) children: Vec<usize>,
    matrix: Option<[f32; 16]>,
    translation: Option<[f32; 3]>,
    rotation: Option<[f32; 4]>,
    scale: Option<[f32; 3]>,
}

impl Node {
    /// True if the node moves what is below it.
    pub(super) fn has_transform(&self) -> bool {
        let identity: [f32; 16] = std::array::from_fn(|k| if k % 5 == 0 { 1.0 } else { 0.0 });
        self.matrix.is_some_and(|m| m != identity)
            || self.translation.is_some_and(|t| t != [0.0; 3])
            || self.rotation.is_some_and(|q| q[..3] != [0.0; 3])
            || self.scale.is_some_and(|s| s != [1.0; 3])
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
    pub(super) kernel: String,
    pub(super) color_space: String,
    /// Extensions of the extension: compression.
    #[serde(default)]
    pub(super) extensions: BTreeMap<String, Value>,
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
pub(super) struct Buffer {
    pub(super) uri: Option<Value>,
}

//! The JSON of a file with one primitive of Gaussians.

use std::collections::BTreeMap;

use serde_json::{Value, json};

use super::EXTENSION;
use super::json::{F32, POINTS};
use crate::axes::Signs;

/// A file with one primitive, all of whose attributes have the same length.
pub(super) struct Document {
    count: usize,
    attributes: BTreeMap<String, usize>,
    accessors: Vec<Value>,
    views: Vec<Value>,
    length: u64,
}

impl Document {
    pub(super) fn new(count: usize) -> Self {
        let (attributes, accessors, views) = Default::default();
        Self { count, attributes, accessors, views, length: 0 }
    }

    /// Adds an attribute, whose data are in a view if there is one.
    pub(super) fn attribute(
        &mut self,
        name: String,
        component: u32,
        kind: &str,
        view: Option<usize>,
    ) -> &mut Value {
        let at = self.accessors.len();
        let mut accessor = json!({ "componentType": component, "count": self.count, "type": kind });
        if component != F32 {
            accessor["normalized"] = json!(true);
        }
        if let Some(view) = view {
            accessor["bufferView"] = json!(view);
        }
        self.attributes.insert(name, at);
        self.accessors.push(accessor);
        &mut self.accessors[at]
    }

    /// Adds a view of the next bytes of the data, which then go on at a multiple of 4.
    pub(super) fn view(&mut self, length: u64, target: Option<u32>) -> usize {
        let mut view = json!({ "buffer": 0, "byteOffset": self.length, "byteLength": length });
        if let Some(target) = target {
            view["target"] = json!(target);
        }
        self.views.push(view);
        self.length = (self.length + length).next_multiple_of(4);
        self.views.len() - 1
    }

    /// Bytes of the data.
    pub(super) fn length(&self) -> u64 {
        self.length
    }

    /// The JSON of a model that a node moves. `compression` is the extension that compresses the primitive, and what it says.
    pub(super) fn json(self, compression: Option<(&str, Value)>, shift: [f64; 3]) -> Vec<u8> {
        let mut splats = json!({ "kernel": "ellipse", "colorSpace": "srgb_rec709_display" });
        let mut used = vec![EXTENSION];
        if let Some((name, said)) = &compression {
            splats["extensions"] = json!({ *name: said });
            used.push(name);
        }
        let primitive = json!({ "attributes": self.attributes, "mode": POINTS,
            "extensions": { EXTENSION: splats } });
        let mut root = json!({
            "asset": { "version": "2.0", "generator": "gsvx" },
            "extensionsUsed": used,
            "scene": 0,
            "scenes": [{ "nodes": [0] }],
            "nodes": [{ "mesh": 0 }],
            "meshes": [{ "primitives": [primitive] }],
            "accessors": self.accessors,
            "bufferViews": self.views,
            "buffers": [{ "byteLength": self.length }],
        });
        if shift != [0.0; 3] {
            root["nodes"][0]["translation"] = json!(shift);
        }
        if compression.is_some() {
            root["extensionsRequired"] = json!(used);
        }
        root.to_string().into_bytes()
    }
}

/// Gives the accessor of the means their least and greatest values, of a model that the file has turned.
pub(super) fn bound(accessor: &mut Value, bounds: [[f32; 3]; 2], turn: &Signs) {
    let [a, b] = bounds.map(|corner| turn.mean(corner).map(f64::from));
    let corner = |pick: fn(f64, f64) -> f64| json!([0, 1, 2].map(|k| pick(a[k], b[k])));
    (accessor["min"], accessor["max"]) = (corner(f64::min), corner(f64::max));
}

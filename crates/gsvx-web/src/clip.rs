//! A sequence of frames, for JavaScript: one group is decoded, and of each frame only what moves is handed over.

use crate::error::{self, set};
use crate::layout;
use gs_model::Scene;
use gsvx::Error;
use gsvx::sequence::{Frames, Sequence};
use js_sys::{Array, Object, Uint32Array};
use wasm_bindgen::prelude::*;

/// A sequence, and the group of it that was decoded last.
#[wasm_bindgen]
#[derive(Debug)]
pub struct Clip {
    sequence: Sequence,
    /// Without motion, and what moves alone.
    group: Option<(Scene, Frames)>,
}

fn thrown(error: &Error) -> JsValue {
    error::of(error, None)
}

#[wasm_bindgen]
impl Clip {
    /// Reads the head; `bytes` may go on behind it.
    ///
    /// # Errors
    /// An object with `message`, `code` and `offset`.
    #[wasm_bindgen(constructor)]
    pub fn new(bytes: &[u8]) -> Result<Self, JsValue> {
        Ok(Self { sequence: Sequence::parse(bytes).map_err(|e| thrown(&e))?, group: None })
    }

    /// `{ fps, frames, length, groups }`; a group is `{ start, end, offset, length }`: its frames and its bytes.
    #[must_use]
    pub fn head(&self) -> Object {
        let object = |fields: &[(&str, f64)]| {
            let object = Object::new();
            fields.iter().for_each(|(name, value)| set(&object, name, &(*value).into()));
            object
        };
        let groups = self.sequence.groups.iter().map(|group| {
            let offset = group.stream.start as f64;
            object(&[
                ("start", group.frames.start as f64),
                ("end", group.frames.end as f64),
                ("offset", offset),
                ("length", group.motion.end as f64 - offset),
            ])
        });
        let groups: Array = groups.collect();
        let frames = self.sequence.frames() as f64;
        let (fps, length) = (self.sequence.fps.into(), self.sequence.stream_len() as f64);
        let head = object(&[("fps", fps), ("frames", frames), ("length", length)]);
        set(&head, "groups", &groups);
        head
    }

    /// Decodes the group of these bytes in place of the one before: `{ count, shDegree, antialiased, moving }`. `moving`
    /// are the numbers of the Gaussians that are not alike in all frames. `most` is the greatest number of Gaussians.
    ///
    /// # Errors
    /// As [`Clip::new`].
    pub fn decode(
        &mut self,
        number: usize,
        bytes: &[u8],
        most: Option<f64>,
    ) -> Result<Object, JsValue> {
        self.group = None;
        let mut own = self.sequence.clone();
        let group = own.groups.get_mut(number);
        let group = group.ok_or_else(|| error::object("there is no such group", "option"))?;
        let start = group.stream.start;
        group.stream = 0..group.stream.end - start;
        group.motion = group.stream.end..group.motion.end - start;
        let decoded = own.group(bytes, number, most.map(|n| n as u64)).map_err(|e| thrown(&e))?;
        let (scene, moving, frames) = decoded.parted();
        let moving: Vec<u32> = moving.into_iter().map(|i| i as u32).collect();
        let object = Object::new();
        set(&object, "count", &(scene.len() as f64).into());
        set(&object, "shDegree", &scene.sh_degree.into());
        set(&object, "antialiased", &scene.antialiased.into());
        set(&object, "moving", &Uint32Array::from(&moving[..]));
        self.group = Some((scene, frames));
        Ok(object)
    }

    /// Puts the group without motion into arrays, as `Stream.take` does.
    ///
    /// # Errors
    /// An object with `message` and `code` for an unknown layout, or if no group is decoded.
    pub fn still(
        &self,
        arrays: &Object,
        capacity: usize,
        layout: &str,
        sh_degree: u8,
    ) -> Result<(), JsValue> {
        let (scene, _) = self.group()?;
        let capacity = capacity.max(scene.len());
        let sh_degree = sh_degree.min(scene.sh_degree);
        #[cfg(feature = "page")]
        crate::outlook::see(scene, scene.len().div_ceil(crate::outlook::ENOUGH));
        layout::fill(scene, 0..scene.len(), arrays, capacity, layout, sh_degree)
    }

    /// Puts what moves into arrays of its own, as it is in a frame of the group. Gaussians that are not there are
    /// transparent.
    ///
    /// # Errors
    /// As [`Clip::still`], or if there is no such frame.
    pub fn moved(
        &self,
        frame: usize,
        arrays: &Object,
        layout: &str,
        sh_degree: u8,
    ) -> Result<(), JsValue> {
        let (_, frames) = self.group()?;
        if frame >= frames.len() {
            return Err(error::object("there is no such frame", "option").into());
        }
        let (mut scene, there) = frames.all(frame);
        let absent = scene.opacity_logits.iter_mut().zip(there).filter(|(_, there)| !there);
        absent.for_each(|(logit, _)| *logit = f32::NEG_INFINITY);
        let sh_degree = sh_degree.min(scene.sh_degree);
        layout::fill(&scene, 0..scene.len(), arrays, scene.len(), layout, sh_degree)
    }

    fn group(&self) -> Result<&(Scene, Frames), JsValue> {
        let none = || error::object("no group is decoded", "option").into();
        self.group.as_ref().ok_or_else(none)
    }
}

//! Where the viewer page first looks at a scene from: the rule of `gsvx render --orbit`, in less time.

use crate::error::set;
use finetune::framing::{Constraints, find};
use gs_model::Scene;
use js_sys::{Array, Object};
use std::cell::RefCell;
use wasm_bindgen::prelude::*;

/// Gaussians that are enough to find a camera for in a tenth of a second.
pub(crate) const ENOUGH: usize = 1 << 13;
/// What is not looked for, to save time: which way is up, as in COLMAP's scenes, and the height, degrees.
const UP: [f64; 3] = [0.0, -1.0, 0.0];
const ELEVATION: f64 = 20.0;

thread_local! {
    /// Some of the Gaussians that were handed out, without view dependence. A worker loads one scene.
    static SEEN: RefCell<Scene> = RefCell::default();
}

/// Remembers one in `every` Gaussians, larger by as much as they are fewer.
pub(crate) fn see(block: &Scene, every: usize) {
    let larger = 0.5 * libm::log(every as f64) as f32;
    SEEN.with_borrow_mut(|seen| {
        for i in (0..block.len()).step_by(every.max(1)) {
            if seen.len() >= ENOUGH {
                return;
            }
            seen.means.push(block.means[i]);
            seen.rotations.push(block.rotations[i]);
            seen.log_scales.push(block.log_scales[i].map(|s| s + larger));
            seen.opacity_logits.push(block.opacity_logits[i]);
            seen.sh.push(block.sh_of(i)[0]);
        }
    });
}

/// `{ eye, target, up, angle }` of a camera for what was handed out so far; the angle is that of the shorter edge, in
/// degrees. Nothing if there is nothing to look at.
#[wasm_bindgen]
#[must_use]
pub fn outlook() -> Option<Object> {
    let constraints =
        Constraints { up: Some(UP), elevation: Some(ELEVATION), ..Constraints::default() };
    let found = SEEN.with_borrow(|seen| find(seen, &constraints))?;
    let camera = found.first();
    let out = Object::new();
    let three = |at: [f64; 3]| at.into_iter().map(JsValue::from_f64).collect::<Array>().into();
    set(&out, "eye", &three(camera.position().into()));
    set(&out, "target", &three(found.ring.centre.into()));
    set(&out, "up", &three(found.ring.up.into()));
    set(&out, "angle", &camera.narrow_angle().into());
    Some(out)
}

//! Why two models look different: the axes of one, or its origin.

use finetune::metrics::psnr;
use finetune::{RenderOptions, render};
use glam::{DMat3, DVec3};
use gs_model::{Camera, Scene};

/// Models that look this different may be one, turned, dB; and how much more alike it must be then.
const UNLIKE: f64 = 25.0;
const CLEARLY: f64 = 6.0;
/// Pixels of the picture that is compared.
const PIXELS: u32 = 40_000;

/// A sentence, if `b` is clearly more like `a` when its axes change places and signs, or with means that are `unmoved` to the
/// origin of `a`. `found` is the PSNR of the comparison.
pub(super) fn hint(
    a: &Scene,
    mut b: Scene,
    unmoved: Option<Vec<[f32; 3]>>,
    cameras: &[Camera],
    found: f64,
) -> Option<String> {
    if found.is_nan() || found > UNLIKE {
        return None;
    }
    let camera = cameras.first()?.within(PIXELS);
    let picture = render(a, &camera, &RenderOptions::default());
    let of =
        |b: &Scene, camera: &Camera| psnr(&render(b, camera, &RenderOptions::default()), &picture);
    let least = of(&b, &camera) + CLEARLY;
    if let Some(means) = unmoved {
        b.means = means;
        let ([x, y, z], alike) = (a.origin, of(&b, &camera));
        if alike > least {
            return Some(format!(
                "they are alike ({alike:.0} dB in the first view) if the positions of the second are relative to the \
                 origin of the first, ({x}, {y}, {z}), too: a format without a place for it has lost it"
            ));
        }
    }
    // A point p of b is at turn p in a.
    let turned =
        |turn: DMat3| of(&b, &Camera { rotation: camera.rotation * turn, ..camera.clone() });
    let all = turns().into_iter().map(|turn| (turn, turned(turn)));
    let (turn, alike) = all.max_by(|x, y| x.1.total_cmp(&y.1)).filter(|best| best.1 > least)?;
    let name = |k: usize| {
        let row = turn.row(k);
        let axis = (0..3).find(|&i| row[i] != 0.0).unwrap_or(k);
        format!("{}{}", if row[axis] < 0.0 { "-" } else { "" }, ["x", "y", "z"][axis])
    };
    Some(format!(
        "they are alike ({alike:.0} dB in the first view) if (x, y, z) of the second is ({}, {}, {}) of the first: one \
         was turned; --axes keep reads the numbers of a file as they are",
        name(0),
        name(1),
        name(2)
    ))
}

/// The rotations that change places and signs of axes, but for the one that changes nothing.
fn turns() -> Vec<DMat3> {
    let orders = [[0, 1, 2], [1, 2, 0], [2, 0, 1], [0, 2, 1], [2, 1, 0], [1, 0, 2]];
    let signed = |order: [usize; 3]| {
        (0..8u8).map(move |signs| {
            let axis = |k: usize| {
                let sign = if signs >> k & 1 == 0 { 1.0 } else { -1.0 };
                sign * DVec3::AXES[order[k]]
            };
            DMat3::from_cols(axis(0), axis(1), axis(2))
        })
    };
    let all = orders.into_iter().flat_map(signed);
    all.filter(|turn| turn.determinant() > 0.0 && *turn != DMat3::IDENTITY).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn there_are_23_turns() {
        assert_eq!(turns().len(), 23);
    }
}

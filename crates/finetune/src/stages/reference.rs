//! The scalar reference of `blend` and `blend_adjoint`: pixel by pixel and splat by splat, without
//! vectors or threads. Tests compare the Rust executor with it.

use super::blend::{LANES, TilePixels};
use super::blend_adjoint::{FROZEN, TileGradient};
use super::project::{RenderView, Splat};
use super::tiles::TileLists;
use super::{T_STOP, TILE, gate, replay};

/// A pixel: its tile, its coordinates within the tile, its centre and row in the image.
struct Pixel {
    tile: usize,
    x: usize,
    y: usize,
    centre: (f32, f32),
    row: u32,
}

fn pixels_of(view: &RenderView) -> impl Iterator<Item = Pixel> {
    let (w, h, tiles_x) = (view.width, view.height, view.tiles_x);
    (0..h).flat_map(move |row| {
        (0..w).map(move |column| Pixel {
            tile: ((row / TILE) * tiles_x + column / TILE) as usize,
            x: (column % TILE) as usize,
            y: (row % TILE) as usize,
            centre: (column as f32 + 0.5, row as f32 + 0.5),
            row,
        })
    })
}

/// e0 and e1 of a splat at a pixel, and its cut there.
fn offsets(s: &Splat, p: &Pixel) -> (f32, f32, f32) {
    let (dx, dy) = (s.x - p.centre.0, s.y - p.centre.1);
    let within = p.row >= s.row0 && p.row < s.row1;
    (s.p * dx + s.q * dy, s.r * dy, if within { s.cut } else { -1.0 })
}

pub(crate) fn blend(view: &RenderView, splats: &[Splat], lists: &TileLists) -> Vec<TilePixels> {
    let mut tiles = vec![TilePixels::CLEAR; view.tiles()];
    for tile in &mut tiles {
        // Pixels beyond the image's edge begin as stopped.
        tile.t = [[-1.0; LANES]; LANES];
    }
    for p in pixels_of(view) {
        let tile = &mut tiles[p.tile];
        let mut t = 1.0;
        for &i in lists.of(p.tile) {
            let s = &splats[i as usize];
            let (e0, e1, cut) = offsets(s, &p);
            let step = gate(e0, e1, cut, s.opacity, T_STOP, t);
            tile.red[p.y][p.x] += step.w * s.red;
            tile.green[p.y][p.x] += step.w * s.green;
            tile.blue[p.y][p.x] += step.w * s.blue;
            t = step.t;
            if t < 0.0 {
                break;
            }
        }
        tile.t[p.y][p.x] = t;
    }
    tiles
}

pub(crate) fn blend_adjoint(
    view: &RenderView,
    splats: &[Splat],
    lists: &TileLists,
    pixels: &[TilePixels],
    gradients: &[TileGradient],
) -> Vec<[f32; FROZEN]> {
    let mut records = vec![[0.0; FROZEN]; lists.ids.len()];
    for p in pixels_of(view) {
        let (tile, g) = (&pixels[p.tile], &gradients[p.tile]);
        let at = |plane: &[[f32; LANES]; LANES]| plane[p.y][p.x];
        let g = [at(&g.red), at(&g.green), at(&g.blue)];
        let through = at(&tile.t).abs();
        let b = view.background;
        let mut rg = (at(&tile.red) + through * b[0]) * g[0]
            + (at(&tile.green) + through * b[1]) * g[1]
            + (at(&tile.blue) + through * b[2]) * g[2];
        let mut t = 1.0;
        let first = lists.offsets[p.tile] as usize;
        for (k, &i) in lists.of(p.tile).iter().enumerate() {
            let s = &splats[i as usize];
            let (e0, e1, cut) = offsets(s, &p);
            let cg = s.red * g[0] + s.green * g[1] + s.blue * g[2];
            let step = replay(e0, e1, cut, s.opacity, T_STOP, t, rg, cg);
            let v = step.v_sigma;
            let add = [
                step.w * g[0],
                step.w * g[1],
                step.w * g[2],
                v,
                v * e0 * e0,
                v * e0 * e1,
                v * e1 * e1,
            ];
            for (r, a) in records[first + k].iter_mut().zip(add) {
                *r += a;
            }
            (t, rg) = (step.t, step.rg);
            if t < 0.0 {
                break;
            }
        }
    }
    records
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::backward::{Backward, planes_of};
    use crate::image::Image;
    use crate::options::{Loss, RenderOptions};
    use gs_model::{Camera, Scene};

    #[test]
    fn the_executor_agrees_with_the_scalar_reference() {
        let mut rng = testing::Rng::seeded(4);
        let mut r = |low: f64, high: f64| rng.range_f32(low, high);
        let mut scene = Scene { sh_degree: 0, ..Scene::default() };
        for _ in 0..800 {
            scene.means.push([r(-1.0, 1.0), r(-1.0, 1.0), r(1.0, 4.0)]);
            scene.rotations.push([r(-1.0, 1.0), r(-1.0, 1.0), r(-1.0, 1.0), r(-1.0, 1.0)]);
            scene.log_scales.push([r(-4.0, -0.5), r(-4.0, -0.5), r(-4.0, -0.5)]);
            scene.opacity_logits.push(r(-4.0, 5.0));
            scene.sh.push([r(-1.5, 1.5), r(-1.5, 1.5), r(-1.5, 1.5)]);
        }
        let camera = Camera {
            name: String::new(),
            width: 75,
            height: 53,
            fx: 60.0,
            fy: 60.0,
            cx: 37.0,
            cy: 26.0,
            rotation: glam::DMat3::IDENTITY,
            translation: glam::DVec3::ZERO,
            lens: None,
            near: gs_model::NEAR,
        };
        let options = RenderOptions { background: [0.4, 0.1, 0.8], ..Default::default() };
        let view = RenderView::new(&camera, &options);
        let mut photo = Image::new(75, 53);
        photo.rgb.iter_mut().for_each(|v| *v = r(0.0, 1.0));
        let mut pass = Backward::<FROZEN>::default();
        pass.run(&scene, &view, &planes_of(&photo.rgb), Loss::L1_SSIM);
        let f = &pass.forward;
        let tiles = blend(&view, &f.projected.seen.splats, &f.lists);
        let bits = |v: &[TilePixels]| bytemuck::cast_slice::<_, u32>(v).to_vec();
        assert!(tiles.iter().any(|t| t.t[2][2] < 0.0), "no pixel stops early");
        assert_eq!(bits(&tiles), bits(&f.tiles), "blend differs");
        let records = blend_adjoint(&view, &f.projected.seen.splats, &f.lists, &tiles, &pass.tiles);
        // The executor sums lanes first: another order, so not the same bits.
        let mut scale = [0.0f32; FROZEN];
        for r in &records {
            for (s, v) in scale.iter_mut().zip(r) {
                *s = s.max(v.abs());
            }
        }
        for (a, b) in records.iter().zip(&pass.records) {
            for ((a, b), s) in a.iter().zip(b).zip(&scale) {
                assert!((a - b).abs() <= 1e-5 * s, "{a} {b}, largest {s}");
            }
        }
    }
}

//! The forward pass of the Rust executor.

use gs_model::{Camera, Scene};

use crate::image::Image;
use crate::options::RenderOptions;
use crate::stages::blend::{LANES, TilePixels, blend};
use crate::stages::project::{ProjectedSplat, RenderView, Splats, project};
use crate::stages::sort_depth::sort_depth;
use crate::stages::tiles::{TileLists, tile_lists};

/// Buffers of the forward pass, reused from one render to the next.
#[derive(Default)]
pub(crate) struct Forward {
    pub(crate) projected: ProjectedSplat,
    pub(crate) order: Vec<u32>,
    pub(crate) lists: TileLists,
    pub(crate) tiles: Vec<TilePixels>,
    pub(crate) last: Vec<u32>,
}

impl Forward {
    /// Runs project .. blend.
    pub(crate) fn run(&mut self, scene: &Scene, view: &RenderView) {
        self.lists(scene, view);
        blend(view, &self.projected.seen.splats, &self.lists, &mut self.tiles, &mut self.last);
    }

    /// Runs project .. ranges.
    pub(crate) fn lists(&mut self, scene: &Scene, view: &RenderView) {
        project(view, scene, &mut self.projected);
        let Splats { splats, boxes, keys } = &self.projected.seen;
        sort_depth(keys, &mut self.order);
        tile_lists(view, splats, boxes, &self.order, &mut self.lists);
    }

    /// The blended tiles as an image, over the background.
    pub(crate) fn image(&self, view: &RenderView) -> Image {
        image_of(&self.tiles, view)
    }
}

/// Blended tiles as an image, over the background.
pub(crate) fn image_of(tiles: &[TilePixels], view: &RenderView) -> Image {
    let mut image = Image::new(view.width, view.height);
    let width = view.width as usize;
    for (y, row) in image.rgb.chunks_exact_mut(3 * width.max(1)).enumerate() {
        let tiles = &tiles[y / LANES * view.tiles_x as usize..];
        let ly = y % LANES;
        for (x, rgb) in row.chunks_exact_mut(3).enumerate() {
            let (tile, lx) = (&tiles[x / LANES], x % LANES);
            let t = tile.t[ly][lx].abs();
            rgb[0] = tile.red[ly][lx] + t * view.background[0];
            rgb[1] = tile.green[ly][lx] + t * view.background[1];
            rgb[2] = tile.blue[ly][lx] + t * view.background[2];
        }
    }
    image
}

/// Renders `scene` as `camera` sees it. Values are not clamped above 1.
///
/// Runs on all threads of the current rayon pool; the result does not depend on their number.
/// A scene whose arrays have inconsistent lengths is drawn as empty. A camera whose image is too large
/// ([`Camera::image_fits`]) gives an image of no pixels.
#[must_use]
pub fn render(scene: &Scene, camera: &Camera, options: &RenderOptions) -> Image {
    if !camera.image_fits() {
        return Image::default();
    }
    let view = RenderView::new(camera, options);
    let mut forward = Forward::default();
    forward.run(scene, &view);
    forward.image(&view)
}

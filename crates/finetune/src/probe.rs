//! Single stages and variants for benchmarks. Not part of the API: it may
//! change without notice.

use gs_model::{Camera, Scene};

use crate::forward::Forward;
use crate::gradients::{Backward, planes_of};
use crate::image::Image;
use crate::optimiser::SceneOptimiser;
use crate::options::{Loss, RenderOptions};
use crate::stages::blend::blend;
use crate::stages::blend_adjoint::{FROZEN, blend_adjoint};
use crate::stages::project::View;
use crate::stages::reference;
use crate::{LearningRates, TrainView, ViewGradients};

/// A scene and a view, run once, whose stages can be repeated.
#[derive(Debug)]
pub struct Probe {
    view: View,
    pass: Backward<FROZEN>,
}

impl std::fmt::Debug for Backward<FROZEN> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Backward").finish_non_exhaustive()
    }
}

impl Probe {
    /// Runs everything once.
    #[must_use]
    pub fn new(scene: &Scene, camera: &Camera, photo: &Image) -> Self {
        let view = View::new(camera, &RenderOptions::default());
        let mut pass = Backward::default();
        pass.run(scene, &view, &planes_of(photo), Loss::default());
        Self { view, pass }
    }

    /// (Splat, pixel) pairs that a kernel without any skipping evaluates: per tile, the splats
    /// up to the last that some pixel needs, times 256.
    #[must_use]
    pub fn pairs(&self) -> u64 {
        self.pass.forward.last.iter().map(|&l| u64::from(l) * 256).sum()
    }

    /// The pairs of [`Probe::pairs`] in rows that the splat reaches. The Rust executor's `blend`
    /// evaluates these, except those in rows that have stopped.
    #[must_use]
    pub fn visited(&self) -> u64 {
        use crate::stages::TILE;
        let f = &self.pass.forward;
        let rows_of = |tile: usize| -> u64 {
            let y0 = self.view.tile_at(tile).1 * TILE;
            let needed = f.lists.of(tile).iter().take(f.last[tile] as usize);
            let rows = needed.map(|&i| {
                let s = &f.projected.splats[i as usize];
                u64::from(s.row1.min(y0 + TILE).saturating_sub(s.row0.max(y0)))
            });
            rows.sum()
        };
        (0..self.view.tiles()).map(rows_of).sum::<u64>() * u64::from(TILE)
    }

    /// The stage `blend` of the Rust executor.
    pub fn blend(&mut self) {
        let Forward { projected, lists, tiles, last, .. } = &mut self.pass.forward;
        blend(&self.view, &projected.splats, lists, tiles, last);
    }

    /// The stage `blend_adjoint` of the Rust executor.
    pub fn blend_adjoint(&mut self) {
        let f = &self.pass.forward;
        let (splats, gradients) = (&f.projected.splats, &self.pass.tiles);
        let records = &mut self.pass.records;
        blend_adjoint(&self.view, splats, &f.lists, &f.tiles, &f.last, gradients, records);
    }

    /// Both stages of the scalar reference.
    pub fn scalar(&self) {
        let f = &self.pass.forward;
        let splats = &f.projected.splats;
        let tiles = reference::blend(&self.view, splats, &f.lists);
        let records =
            reference::blend_adjoint(&self.view, splats, &f.lists, &tiles, &self.pass.tiles);
        std::hint::black_box(records);
    }

    /// The same stages of the WGSL executor on a software adapter (or any, if there is none):
    /// `None` without an adapter.
    #[cfg(feature = "gpu")]
    #[must_use]
    pub fn on_device(&self) -> Option<DeviceProbe> {
        use crate::gpu::{Context, Sizes, StepUniform, Workspace};
        let f = &self.pass.forward;
        let sizes = Sizes {
            count: f.projected.splats.len(),
            sh_len: 1,
            capacity: f.lists.ids.len(),
            tiles: self.view.tiles(),
            pixels: (self.view.width * self.view.height) as usize,
        };
        let gpu = Workspace::new(Context::software().ok()?, sizes, None).ok()?;
        gpu.write("gradient", &self.pass.tiles);
        let mut u = StepUniform::of_view(&self.view);
        (u.count, u.capacity) = (sizes.count as u32, sizes.capacity as u32);
        gpu.upload_lists(f, &u);
        Some(DeviceProbe { gpu, u })
    }
}

/// [`Probe`] on a device.
#[cfg(feature = "gpu")]
pub struct DeviceProbe {
    gpu: crate::gpu::Workspace,
    u: crate::gpu::StepUniform,
}

#[cfg(feature = "gpu")]
impl DeviceProbe {
    /// Both stages; waits for the device.
    pub fn run(&self) {
        use crate::gpu::Stage;
        self.gpu.run(&[Stage::Blend, Stage::BlendAdjoint], &self.u, None);
        std::hint::black_box(self.gpu.read::<u32>("last", 1).is_ok());
    }
}

pub use crate::stages::project::TileTest;

/// Approximations that trade accuracy for time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Variant {
    /// Which tiles a splat is listed in.
    pub tile_test: TileTest,
    /// Blending stops before the transmittance would fall below this.
    pub t_stop: f32,
    /// Colours rounded to half precision.
    pub half_colour: bool,
}

impl Default for Variant {
    fn default() -> Self {
        let t_stop = crate::stages::T_STOP;
        Self { tile_test: TileTest::Ellipse, t_stop, half_colour: false }
    }
}

/// Passes of the Rust executor in a variant, for timing.
pub struct VariantPass {
    view: View,
    photo: Vec<f32>,
    pass: Backward<FROZEN>,
}

impl VariantPass {
    /// For one camera and photo of the same size.
    #[must_use]
    pub fn new(camera: &Camera, photo: &Image, variant: Variant) -> Self {
        let mut view = View::new(camera, &RenderOptions::default());
        view.tile_test = variant.tile_test;
        view.t_stop = variant.t_stop;
        view.half_colour = variant.half_colour;
        Self { view, photo: planes_of(photo), pass: Backward::default() }
    }

    /// project .. blend.
    pub fn forward(&mut self, scene: &Scene) {
        self.pass.forward.run(scene, &self.view);
    }

    /// project .. gather, with the default loss.
    pub fn step(&mut self, scene: &Scene) {
        self.pass.run(scene, &self.view, &self.photo, Loss::default());
    }

    /// What the last pass rendered, over black.
    #[must_use]
    pub fn image(&self) -> Image {
        self.pass.forward.image(&self.view)
    }

    /// Slots (splat and tile) of the last pass.
    #[must_use]
    pub fn slots(&self) -> usize {
        self.pass.forward.lists.ids.len()
    }
}

/// A fine-tune of `scene` on the software adapter, and after `warm` steps of it.
#[cfg(feature = "gpu")]
fn on_software(
    scene: &Scene,
    views: Vec<TrainView>,
    warm: u64,
) -> crate::Result<crate::DeviceOptimiser> {
    let views = ViewGradients::new(views, Loss::default(), &RenderOptions::default())?;
    let from = SceneOptimiser::new(scene.clone(), LearningRates::default(), 0.0);
    let mut gpu = views.scene_on_device(crate::Adapter::Software, &from)?;
    for step in 1..=warm {
        gpu.step(0, step, 1.0)?;
        gpu.losses()?;
    }
    Ok(gpu)
}

/// The stages of a step on the software adapter, one at a time, after a whole step has been run.
#[cfg(feature = "gpu")]
pub struct DeviceStages(crate::DeviceOptimiser);

#[cfg(feature = "gpu")]
impl DeviceStages {
    /// Uploads everything and runs two whole steps.
    ///
    /// # Errors
    /// [`crate::Error::NoAdapter`] without an adapter, [`crate::Error::Gpu`].
    pub fn new(scene: &Scene, view: TrainView) -> crate::Result<Self> {
        Ok(Self(on_software(scene, vec![view], 2)?))
    }

    /// Names of the stages, in order.
    #[must_use]
    pub fn names(&self) -> Vec<String> {
        crate::gpu::STEP.iter().map(|s| format!("{s:?}")).collect()
    }

    /// Repeats stage number `k`; waits for the device.
    pub fn run(&self, k: usize) {
        self.0.repeat(&crate::gpu::STEP[k..=k]);
    }
}

/// The stages of a step of the Rust executor, one at a time, after a whole step has been run.
pub struct Stages {
    scene: Scene,
    photo: Vec<f32>,
    probe: Probe,
    views: ViewGradients,
    optimiser: SceneOptimiser,
}

impl Stages {
    /// Runs everything once.
    ///
    /// # Errors
    /// Those of [`ViewGradients::new`].
    pub fn new(scene: &Scene, camera: &Camera, photo: &Image) -> crate::Result<Self> {
        let view = TrainView { camera: camera.clone(), photo: photo.clone() };
        let options = RenderOptions::default();
        let mut views = ViewGradients::new(vec![view], Loss::default(), &options)?;
        views.run(scene, 0);
        Ok(Self {
            scene: scene.clone(),
            photo: planes_of(photo),
            probe: Probe::new(scene, camera, photo),
            views,
            optimiser: SceneOptimiser::new(scene.clone(), LearningRates::default(), 0.0),
        })
    }

    /// Names of the stages, in order.
    pub const NAMES: [&str; 8] = [
        "project",
        "sort_depth",
        "emit, sort_tile, ranges",
        "blend",
        "loss",
        "blend_adjoint",
        "gather",
        "project_adjoint + adam",
    ];

    /// Repeats stage number `k`.
    pub fn run(&mut self, k: usize) {
        use crate::stages::gather::gather_gradients;
        use crate::stages::project::project;
        use crate::stages::sort_depth::sort_depth;
        use crate::stages::tiles::tile_lists;
        let view = self.probe.view;
        let pass = &mut self.probe.pass;
        let f = &mut pass.forward;
        match k {
            0 => project(&view, &self.scene, &mut f.projected),
            1 => sort_depth(&f.projected.keys, &mut f.order),
            2 => {
                let p = &f.projected;
                tile_lists(&view, &p.splats, &p.boxes, &f.order, &mut f.lists);
            }
            3 => self.probe.blend(),
            4 => {
                pass.loss(&view, &self.photo, Loss::default());
            }
            5 => self.probe.blend_adjoint(),
            6 => {
                let splats = &f.projected.splats;
                gather_gradients(&f.lists, &pass.records, splats, &mut pass.sums);
            }
            _ => self.optimiser.descend(&self.views, 1000, 1e-6),
        }
    }
}

/// Whole steps of a fine-tune on the software adapter, for timing lavapipe.
///
/// # Errors
/// Those of [`ViewGradients::scene_on_device`].
#[cfg(feature = "gpu")]
pub fn software_steps(
    scene: &Scene,
    views: Vec<TrainView>,
    steps: u64,
) -> crate::Result<std::time::Duration> {
    let count = views.len();
    // The first step compiles the kernels and finds room for the slots.
    let mut gpu = on_software(scene, views, 1)?;
    let started = std::time::Instant::now();
    for step in 2..=steps + 1 {
        gpu.step(step as usize % count, step, 1.0)?;
    }
    gpu.losses()?;
    Ok(started.elapsed())
}

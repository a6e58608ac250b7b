//! Renders, and how alike two models look.

use crate::arrays::SplatArrays;
use crate::background::{pool, run};
use crate::cameras::CameraArrays;
use finetune::metrics::Scores;
use finetune::{Image, RenderOptions};
use numpy::{PyArray1, PyArray3, PyArrayMethods};
use pyo3::prelude::*;

/// Draws a model: an array (height, width, 3) per camera.
#[pyfunction]
pub(crate) fn render<'py>(
    py: Python<'py>,
    splats: SplatArrays<'py>,
    cameras: CameraArrays<'py>,
    background: [f32; 3],
    progress: Option<Bound<'py, PyAny>>,
) -> PyResult<Vec<Bound<'py, PyArray3<f32>>>> {
    let (pool, scene) = splats.take()?;
    let cameras = cameras.cameras()?.drawable()?;
    let images = run(py, pool, progress.as_ref(), move |line| {
        let options = RenderOptions { background, ..Default::default() };
        let mut images: Vec<Image> = Vec::with_capacity(cameras.len());
        for camera in &cameras {
            images.push(finetune::render(&scene, camera, &options));
            line.step("render", images.len(), cameras.len())?;
        }
        Ok(images)
    })?;
    let array = |image: Image| {
        let size = [image.height as usize, image.width as usize, 3];
        PyArray1::from_vec(py, image.rgb).reshape(size)
    };
    images.into_iter().map(array).collect()
}

/// PSNR and SSIM of the second model's renders against those of the first, for each camera.
#[pyfunction]
pub(crate) fn compare<'py>(
    py: Python<'py>,
    reference: SplatArrays<'py>,
    model: SplatArrays<'py>,
    cameras: CameraArrays<'py>,
    progress: Option<Bound<'py, PyAny>>,
) -> PyResult<Vec<(f64, f64, f64)>> {
    let pool = pool()?;
    let (a, b) = (reference.scene(&pool)?, model.scene(&pool)?);
    drop((reference, model));
    let cameras = cameras.cameras()?.drawable()?;
    run(py, pool, progress.as_ref(), move |line| {
        let mut scores = Vec::with_capacity(cameras.len());
        for camera in &cameras {
            let draw = |scene| finetune::render(scene, camera, &RenderOptions::default());
            let (reference, image) = (draw(&a), draw(&b));
            let Scores { psnr, ssim, ssimulacra2 } = Scores::of(&image, &reference);
            scores.push((psnr, ssim, ssimulacra2));
            line.step("compare", scores.len(), cameras.len())?;
        }
        Ok(scores)
    })
}

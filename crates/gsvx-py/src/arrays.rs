//! SplatArrays as gsplat has them, six arrays, into a scene and back.

use crate::background::pool;
use crate::error::Fault;
use gs_model::Scene;
use numpy::ndarray::{ArrayView2, ArrayView3};
use numpy::{
    PyArray1, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArray3,
    PyUntypedArrayMethods,
};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use rayon::ThreadPool;
use rayon::prelude::*;
use std::array;

/// The arrays of a dict of splats: aligned float32 of the right shapes, in any memory order.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct SplatArrays<'py> {
    means: PyReadonlyArray2<'py, f32>,
    scales: PyReadonlyArray2<'py, f32>,
    quats: PyReadonlyArray2<'py, f32>,
    opacities: PyReadonlyArray1<'py, f32>,
    sh0: PyReadonlyArray3<'py, f32>,
    #[pyo3(item("shN"))]
    rest: PyReadonlyArray3<'py, f32>,
    antialiased: bool,
}

impl SplatArrays<'_> {
    /// Threads for a call, and the scene. The arrays are released.
    pub(crate) fn take(self) -> PyResult<(ThreadPool, Scene)> {
        let pool = pool()?;
        let scene = self.scene(&pool)?;
        Ok((pool, scene))
    }

    /// The scene: the one copy of the numbers that is made.
    pub(crate) fn scene(&self, pool: &ThreadPool) -> PyResult<Scene> {
        let (n, k) = (self.means.shape()[0], self.rest.shape()[1]);
        for (name, found, expected) in [
            ("means", self.means.shape(), &[n, 3][..]),
            ("scales", self.scales.shape(), &[n, 3]),
            ("quats", self.quats.shape(), &[n, 4]),
            ("opacities", self.opacities.shape(), &[n]),
            ("sh0", self.sh0.shape(), &[n, 1, 3]),
            ("shN", self.rest.shape(), &[n, k, 3]),
        ] {
            if found != expected {
                let message = format!("{name}: shape {expected:?} expected, not {found:?}");
                return Err(Fault::Usage(message).into());
            }
        }
        let Some(sh_degree) = (0..4).find(|&degree| usize::from(degree * (degree + 2)) == k) else {
            return Err(Fault::Usage(format!("shN: K of 0, 3, 8 or 15 expected, not {k}")).into());
        };
        let antialiased = self.antialiased;
        let (dc, rest) = (self.sh0.as_array(), self.rest.as_array());
        let (means, scales) = (self.means.as_array(), self.scales.as_array());
        let (quats, opacities) = (self.quats.as_array(), self.opacities.as_array());
        Ok(pool.install(|| Scene {
            means: rows(&means),
            rotations: rows(&quats),
            log_scales: rows(&scales),
            opacity_logits: match opacities.as_slice() {
                Some(all) => all.to_vec(),
                None => opacities.iter().copied().collect(),
            },
            sh_degree,
            sh: coefficients(&dc, &rest),
            antialiased,
            ..Scene::default()
        }))
    }
}

fn rows<const W: usize>(array: &ArrayView2<'_, f32>) -> Vec<[f32; W]> {
    match array.as_slice() {
        Some(all) => all.as_chunks().0.to_vec(),
        None => array.outer_iter().map(|row| array::from_fn(|k| row[k])).collect(),
    }
}

/// Coefficient-major SH from those of degree 0 and the others.
fn coefficients(dc: &ArrayView3<'_, f32>, rest: &ArrayView3<'_, f32>) -> Vec<[f32; 3]> {
    let k = 1 + rest.shape()[1];
    let mut sh = vec![[0.0; 3]; k * dc.shape()[0]];
    sh.par_chunks_mut(k).with_min_len(1024).enumerate().for_each(|(i, out)| {
        out[0] = array::from_fn(|c| dc[[i, 0, c]]);
        let row = rest.index_axis(numpy::ndarray::Axis(0), i);
        match row.as_slice() {
            Some(row) => out[1..].as_flattened_mut().copy_from_slice(row),
            None => {
                for (j, out) in out[1..].iter_mut().enumerate() {
                    *out = array::from_fn(|c| row[[j, c]]);
                }
            }
        }
    });
    sh
}

/// A dict of arrays over the scene's own memory. `sh` holds all coefficients, (N, K + 1, 3).
pub(crate) fn dict(py: Python<'_>, scene: Scene) -> PyResult<Bound<'_, PyDict>> {
    let (n, k) = (scene.len(), scene.sh_len());
    let flat = |values: Vec<f32>| PyArray1::from_vec(py, values);
    let out = PyDict::new(py);
    out.set_item("means", flat(scene.means.into_flattened()).reshape([n, 3])?)?;
    out.set_item("scales", flat(scene.log_scales.into_flattened()).reshape([n, 3])?)?;
    out.set_item("quats", flat(scene.rotations.into_flattened()).reshape([n, 4])?)?;
    out.set_item("opacities", flat(scene.opacity_logits))?;
    out.set_item("sh", flat(scene.sh.into_flattened()).reshape([n, k, 3])?)?;
    out.set_item("antialiased", scene.antialiased)?;
    Ok(out)
}

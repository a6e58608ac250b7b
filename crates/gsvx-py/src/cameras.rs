//! Cameras as arrays, as gsplat has them: from files, or around a model.

use crate::arrays::SplatArrays;
use crate::background::run;
use crate::error::{Fault, Result};
use finetune::MAX_EDGE;
use finetune::framing::{self, Constraints};
use glam::{DMat3, DVec3};
use gs_model::dataset::open_cameras;
use gs_model::lens::Lens;
use gs_model::{Camera, CameraSet, View, pinholes, refuse_wide};
use numpy::{PyArray1, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArray3};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::path::{Path, PathBuf};

/// Cameras as Python has checked them.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct CameraArrays<'py> {
    /// What a person calls them: the path that they are from.
    name: String,
    names: Vec<String>,
    /// World to camera, (C, 4, 4).
    viewmats: PyReadonlyArray3<'py, f64>,
    /// Intrinsics in pixels, (C, 3, 3).
    #[pyo3(item("Ks"))]
    intrinsics: PyReadonlyArray3<'py, f64>,
    /// Width and height, (C, 2).
    sizes: PyReadonlyArray2<'py, i64>,
    /// Lens models with their coefficients.
    lenses: Vec<Option<(String, Vec<f64>)>>,
    /// Near planes, (C,).
    near: PyReadonlyArray1<'py, f64>,
    /// Files, or none if they are not known.
    photos: Vec<PathBuf>,
}

/// Cameras, and what a person calls them.
#[derive(Clone, Debug)]
pub(crate) struct Cameras {
    pub(crate) name: String,
    pub(crate) list: Vec<Camera>,
    /// Files, or none if they are not known.
    pub(crate) photos: Vec<PathBuf>,
}

impl Cameras {
    /// The cameras with the files of their photos.
    pub(crate) fn views(&self) -> Vec<View> {
        let both = self.list.iter().cloned().zip(self.photos.iter().cloned());
        both.map(|(camera, image_path)| View { camera, image_path }).collect()
    }

    /// Pinhole cameras that show what the photos of these show.
    pub(crate) fn pinholes(&self) -> Result<Vec<Camera>> {
        Ok(pinholes(Path::new(&self.name), &self.list)?)
    }

    /// The cameras, if a picture without distortion can stand for what each shows.
    pub(crate) fn drawable(self) -> Result<Vec<Camera>> {
        self.list.iter().try_for_each(|camera| refuse_wide(Path::new(&self.name), camera))?;
        Ok(self.list)
    }
}

impl CameraArrays<'_> {
    pub(crate) fn cameras(&self) -> Result<Cameras> {
        let (poses, intrinsics) = (self.viewmats.as_array(), self.intrinsics.as_array());
        let (sizes, near) = (self.sizes.as_array(), self.near.as_array());
        let mut list = Vec::with_capacity(self.names.len());
        for (i, name) in self.names.iter().enumerate() {
            let [width, height] = [0, 1].map(|k| u32::try_from(sizes[[i, k]]).unwrap_or(0));
            let column = |k: usize| DVec3::from([0, 1, 2].map(|j| poses[[i, j, k]]));
            let camera = Camera {
                name: name.clone(),
                width,
                height,
                fx: intrinsics[[i, 0, 0]],
                fy: intrinsics[[i, 1, 1]],
                cx: intrinsics[[i, 0, 2]],
                cy: intrinsics[[i, 1, 2]],
                rotation: DMat3::from_cols(column(0), column(1), column(2)),
                translation: column(3),
                lens: self
                    .lenses
                    .get(i)
                    .cloned()
                    .flatten()
                    .map(|(model, coefficients)| Lens { model, coefficients }),
                near: near[i],
            };
            list.push(camera.checked(Path::new(&self.name))?);
            if width.max(height) > MAX_EDGE {
                return Err(Fault::Failed(format!(
                    "camera {name:?}: {width}x{height} pixels, more than {MAX_EDGE} along an edge"
                )));
            }
        }
        if list.is_empty() {
            return Err(Fault::Failed(format!("{}: no cameras", self.name)));
        }
        Ok(Cameras { name: self.name.clone(), list, photos: self.photos.clone() })
    }
}

/// The views of a folder or of a camera file, sorted by name, as a dict of arrays; with notes on what is unusual.
#[pyfunction]
pub(crate) fn read_cameras(py: Python<'_>, path: PathBuf) -> PyResult<Bound<'_, PyDict>> {
    let CameraSet { views, notes, .. } = open_cameras(&path).map_err(Fault::from)?;
    let cameras: Vec<&Camera> = views.iter().map(|v| &v.camera).collect();
    let out = as_arrays(py, &cameras)?;
    let photos: Vec<&Path> = views.iter().map(|v| v.image_path.as_path()).collect();
    out.set_item("photos", photos)?;
    out.set_item("notes", notes)?;
    Ok(out)
}

/// Cameras around a model, as Python asks for them. What is `None` is found.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct OrbitOptions {
    count: u32,
    size: [u32; 2],
    field_of_view: f64,
    up: Option<[f64; 3]>,
    radius: Option<f64>,
    elevation: Option<f64>,
    full_circle: bool,
}

/// Cameras on a circle, or on an arc of it, around what matters in a model; as [`read_cameras`].
#[pyfunction]
pub(crate) fn orbit<'py>(
    py: Python<'py>,
    splats: SplatArrays<'py>,
    orbit: OrbitOptions,
) -> PyResult<Bound<'py, PyDict>> {
    let OrbitOptions { count, size, field_of_view, up, radius, elevation, full_circle } = orbit;
    let (pool, scene) = splats.take()?;
    let cameras = run(py, pool, None, move |_| {
        let tangent = libm::tan(0.5 * field_of_view.to_radians());
        let tangents = [tangent, tangent * f64::from(size[1]) / f64::from(size[0])];
        let up = up.map(framing::unit);
        let constraints = Constraints { up, radius, elevation, tangents };
        let Some(mut found) = framing::find(&scene, &constraints) else {
            return Err(Fault::Failed("the model holds no Gaussian to look at".into()));
        };
        if full_circle {
            found.arc = None;
        }
        Ok(found.cameras(count, "orbit", size, 0.5 * f64::from(size[0]) / tangent))
    })?;
    as_arrays(py, &cameras.iter().collect::<Vec<_>>())
}

/// Cameras as a dict of arrays.
fn as_arrays<'py>(py: Python<'py>, cameras: &[&Camera]) -> PyResult<Bound<'py, PyDict>> {
    let (mut poses, mut intrinsics, mut sizes) = (Vec::new(), Vec::new(), Vec::new());
    for c in cameras {
        for k in 0..3 {
            let row = c.rotation.row(k);
            poses.extend([row.x, row.y, row.z, c.translation[k]]);
        }
        poses.extend([0.0, 0.0, 0.0, 1.0]);
        intrinsics.extend([c.fx, 0.0, c.cx, 0.0, c.fy, c.cy, 0.0, 0.0, 1.0]);
        sizes.extend([i64::from(c.width), i64::from(c.height)]);
    }
    let n = cameras.len();
    let out = PyDict::new(py);
    out.set_item("viewmats", PyArray1::from_vec(py, poses).reshape([n, 4, 4])?)?;
    out.set_item("Ks", PyArray1::from_vec(py, intrinsics).reshape([n, 3, 3])?)?;
    out.set_item("sizes", PyArray1::from_vec(py, sizes).reshape([n, 2])?)?;
    let names: Vec<&str> = cameras.iter().map(|c| &c.name[..]).collect();
    out.set_item("names", names)?;
    let lens = |l: &Lens| (l.model.clone(), l.coefficients.clone());
    let lenses: Vec<_> = cameras.iter().map(|c| c.lens.as_ref().map(lens)).collect();
    out.set_item("lenses", lenses)?;
    let near: Vec<f64> = cameras.iter().map(|c| c.near).collect();
    out.set_item("near", PyArray1::from_vec(py, near))?;
    Ok(out)
}

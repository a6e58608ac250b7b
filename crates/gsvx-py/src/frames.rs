//! Sequences of frames to arrays, frame by frame.

use crate::arrays;
use crate::background::{pool, run};
use crate::error::Fault;
use gsvx::sequence::{Frames, Sequence};
use pyo3::exceptions::PyIndexError;
use pyo3::prelude::*;
use pyo3::pybacked::PyBackedBytes;
use pyo3::types::PyDict;
use std::sync::Arc;

/// A sequence in memory, and the group of it that was decoded last.
#[pyclass(module = "gsvx._gsvx")]
pub(crate) struct FrameReader {
    data: Arc<PyBackedBytes>,
    sequence: Arc<Sequence>,
    name: String,
    max_gaussians: Option<u64>,
    group: Option<(usize, Arc<Frames>)>,
}

#[pymethods]
impl FrameReader {
    #[new]
    fn new(data: PyBackedBytes, name: String, max_gaussians: Option<u64>) -> PyResult<Self> {
        let sequence = Sequence::parse(&data).map_err(|e| Fault::from(e).named(&name))?;
        let (data, sequence) = (Arc::new(data), Arc::new(sequence));
        Ok(Self { data, sequence, name, max_gaussians, group: None })
    }

    /// Frames per second.
    #[getter]
    fn fps(&self) -> f32 {
        self.sequence.fps
    }

    /// First frame of each group, and the one behind its last.
    #[getter]
    fn groups(&self) -> Vec<(u64, u64)> {
        self.sequence.groups.iter().map(|group| (group.frames.start, group.frames.end)).collect()
    }

    /// Decodes a frame, counted from the end if the number is negative: a dict of arrays.
    fn frame<'py>(&mut self, py: Python<'py>, number: i64) -> PyResult<Bound<'py, PyDict>> {
        let count = self.sequence.frames();
        let at = if number < 0 { number.saturating_add_unsigned(count) } else { number };
        let found = u64::try_from(at).ok().and_then(|at| Some((at, self.sequence.group_of(at)?)));
        let Some((at, wanted)) = found else {
            return Err(PyIndexError::new_err(format!("no frame {number} of {count}")));
        };
        let held = self.group.as_ref().filter(|group| group.0 == wanted);
        let held = held.map(|group| Arc::clone(&group.1));
        let (data, sequence) = (Arc::clone(&self.data), Arc::clone(&self.sequence));
        let (name, most) = (self.name.clone(), self.max_gaussians);
        let within = (at - sequence.groups[wanted].frames.start) as usize;
        let (group, scene) = run(py, pool()?, None, move |_| {
            let decoded =
                held.map_or_else(|| sequence.group(&data, wanted, most).map(Arc::new), Ok);
            let group = decoded.map_err(|e| Fault::from(e).named(&name))?;
            let scene = group.frame(within);
            Ok((group, scene))
        })?;
        self.group = Some((wanted, group));
        arrays::dict(py, scene)
    }
}

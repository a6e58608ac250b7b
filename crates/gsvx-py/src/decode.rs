//! Streams to arrays: whole ones, and those that arrive in parts.

use crate::arrays;
use crate::background::{pool, run};
use crate::error::Fault;
use gsvx::{Chunk, DecodeOptions, Index, Kind};
use pyo3::prelude::*;
use pyo3::pybacked::PyBackedBytes;
use pyo3::types::{IntoPyDict, PyDict};

/// What of a stream is decoded, as Python has it.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct DecodeRequest {
    max_sh_degree: u8,
    lod: u8,
    salvage: bool,
    max_gaussians: Option<u64>,
}

/// Decodes a whole stream. Returns a dict of arrays and what was left out, in words.
#[pyfunction]
pub(crate) fn decompress<'py>(
    py: Python<'py>,
    stream: PyBackedBytes,
    name: String,
    wanted: DecodeRequest,
) -> PyResult<(Bound<'py, PyDict>, Vec<String>)> {
    let mut options = DecodeOptions::default();
    options.max_sh_degree = wanted.max_sh_degree;
    options.lod = wanted.lod;
    options.salvage = wanted.salvage;
    options.max_gaussians = wanted.max_gaussians;
    let decoded = run(py, pool()?, None, move |_| {
        gsvx::decode_with(&stream, &options).map_err(|e| Fault::from(e).named(&name))
    })?;
    Ok((arrays::dict(py, decoded.scene)?, decoded.skipped))
}

/// A stream that arrives in parts; it does no I/O.
#[pyclass(module = "gsvx._gsvx", name = "Reader")]
#[derive(Default)]
pub(crate) struct StreamReader {
    reader: gsvx::Reader,
    name: String,
}

#[pymethods]
impl StreamReader {
    #[new]
    fn new(name: String, max_gaussians: Option<u64>) -> Self {
        let new = gsvx::Reader::with_max_gaussians;
        Self { reader: max_gaussians.map_or_else(gsvx::Reader::new, new), name }
    }

    /// First and last byte, exclusive, that are needed before the head is known; None when it is.
    fn head_needs(&self) -> Option<(u64, u64)> {
        self.reader.head_needs().map(|range| (range.start, range.end))
    }

    /// Takes bytes of the stream that begin at an offset.
    fn give(&mut self, offset: u64, data: &[u8]) -> PyResult<()> {
        let given = self.reader.give(offset, data);
        Ok(given.map_err(|e| Fault::from(e).named(&self.name))?)
    }

    /// The byte ranges that are missing for the first layers of a chunk.
    fn needs(&self, chunk: usize, layers: usize) -> Vec<(u64, u64)> {
        self.reader.needs(chunk, layers).into_iter().map(|range| (range.start, range.end)).collect()
    }

    /// Forgets the bytes of a chunk.
    fn forget(&mut self, chunk: usize) {
        self.reader.forget(chunk);
    }

    /// Decodes the first layers of a chunk: a dict of arrays.
    fn decode<'py>(
        &mut self,
        py: Python<'py>,
        chunk: usize,
        layers: usize,
    ) -> PyResult<Bound<'py, PyDict>> {
        let (pool, reader) = (pool()?, &mut self.reader);
        let decoded = py.detach(|| pool.install(|| reader.decode(chunk, layers)));
        let scene = decoded.map_err(|e| Fault::from(e).named(&self.name))?;
        arrays::dict(py, scene)
    }

    /// Header and index, once they have arrived.
    fn head<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyDict>>> {
        self.reader.index().map(|index| head(py, index)).transpose()
    }
}

fn head<'py>(py: Python<'py>, index: &Index) -> PyResult<Bound<'py, PyDict>> {
    let out = PyDict::new(py);
    let header = &index.header;
    out.set_item("gaussians", header.count)?;
    out.set_item("sh_degree", header.sh_degree)?;
    out.set_item("antialiased", header.antialiased)?;
    out.set_item("octree_depth", header.j_high)?;
    out.set_item("cube_origin", header.cube.origin)?;
    out.set_item("cube_side", header.cube.side)?;
    out.set_item("lods", 1 + index.coarsest_lod())?;
    out.set_item("bytes", index.stream_len())?;
    out.set_item("parts", index.parts().into_py_dict(py)?)?;
    let chunks = index.chunks.iter().enumerate().map(|(number, c)| chunk(py, index, number, c));
    out.set_item("chunks", chunks.collect::<PyResult<Vec<_>>>()?)?;
    Ok(out)
}

fn chunk<'py>(
    py: Python<'py>,
    index: &Index,
    number: usize,
    chunk: &Chunk,
) -> PyResult<Bound<'py, PyDict>> {
    let out = PyDict::new(py);
    out.set_item("number", number)?;
    out.set_item("exact", chunk.kind == Kind::Exact)?;
    out.set_item("lod", chunk.lod)?;
    out.set_item("gaussians", chunk.count)?;
    out.set_item("bounds", chunk.bounds)?;
    out.set_item("offset", chunk.layers.first().map_or(0, |layer| layer.offset))?;
    out.set_item("layers", chunk.layers.iter().map(|layer| layer.len).collect::<Vec<_>>())?;
    out.set_item("finer", index.finer(number).collect::<Vec<_>>())?;
    Ok(out)
}

//! The Python package `gsvx`, compiled part: `gsvx._gsvx`.
//!
//! Python code in `python/gsvx` checks arguments and documents them; this crate turns arrays into scenes,
//! calls the library crates, and turns results into arrays. *Invariant:* nothing here computes what a
//! library crate could. Work runs on threads of its own with the GIL released, and no such thread touches
//! a Python object.

mod arrays;
mod background;
mod cameras;
mod decode;
mod encode;
mod error;
mod files;
mod frames;
mod render;
mod tuning;

use pyo3::prelude::*;
use pyo3::types::IntoPyDict;

#[pymodule]
fn _gsvx(m: &Bound<'_, PyModule>) -> PyResult<()> {
    m.add("__version__", env!("CARGO_PKG_VERSION"))?;
    m.add("DEFAULT_QUALITY", gsvx::DEFAULT_QUALITY)?;
    let presets = gsvx::Preset::ALL.map(|preset| (preset.name, preset.quality));
    m.add("PRESETS", presets.into_py_dict(m.py())?)?;
    m.add("Error", m.py().get_type::<error::Error>())?;
    m.add_class::<decode::StreamReader>()?;
    m.add_class::<frames::FrameReader>()?;
    m.add_function(wrap_pyfunction!(background::set_threads, m)?)?;
    m.add_function(wrap_pyfunction!(cameras::read_cameras, m)?)?;
    m.add_function(wrap_pyfunction!(cameras::orbit, m)?)?;
    m.add_function(wrap_pyfunction!(decode::decompress, m)?)?;
    m.add_function(wrap_pyfunction!(encode::compress, m)?)?;
    m.add_function(wrap_pyfunction!(files::read_model, m)?)?;
    m.add_function(wrap_pyfunction!(files::write_model, m)?)?;
    m.add_function(wrap_pyfunction!(render::compare, m)?)?;
    m.add_function(wrap_pyfunction!(render::render, m)?)?;
    m.add_function(wrap_pyfunction!(tuning::tune, m)?)?;
    Ok(())
}

//! Checks of WGSL.

use naga::back;
use naga::valid::{Capabilities, ValidationFlags, Validator};

/// Panics unless a shader has these entry points, is valid without optional capabilities, and translates to every
/// language that a backend of wgpu reads. Needs no adapter.
pub fn check(name: &str, source: &str, entries: &[&str]) {
    let module = naga::front::wgsl::parse_str(source)
        .unwrap_or_else(|e| panic!("{name}: {}", e.emit_to_string(source)));
    let found: Vec<_> = module.entry_points.iter().map(|e| e.name.as_str()).collect();
    assert_eq!(found, entries, "{name}");
    let info = Validator::new(ValidationFlags::all(), Capabilities::empty())
        .validate(&module)
        .unwrap_or_else(|e| panic!("{name}: {}", e.emit_to_string(source)));

    let words = back::spv::write_vec(&module, &info, &back::spv::Options::default(), None).unwrap();
    assert!(words.len() > 100);

    let options = back::msl::Options { fake_missing_bindings: true, ..Default::default() };
    let pipeline = back::msl::PipelineOptions::default();
    let (msl, _) = back::msl::write_string(&module, &info, &options, &pipeline).unwrap();

    let options = back::hlsl::Options {
        shader_model: back::hlsl::ShaderModel::V6_0,
        fake_missing_bindings: true,
        ..Default::default()
    };
    let mut hlsl = String::new();
    let pipeline = back::hlsl::PipelineOptions::default();
    back::hlsl::Writer::new(&mut hlsl, &options, &pipeline).write(&module, &info, None).unwrap();
    for entry in entries {
        assert!(msl.contains(entry) && hlsl.contains(entry), "{name}");
    }
}

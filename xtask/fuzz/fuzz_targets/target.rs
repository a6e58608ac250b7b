//! The target that has the name of this program: the programs of all targets are this file.
#![no_main]

libfuzzer_sys::fuzz_target!(init: gsvx_fuzz::init(), |data: &[u8]| {
    gsvx_fuzz::seeds::run(env!("CARGO_BIN_NAME"), data);
});

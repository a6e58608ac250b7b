#![no_main]

libfuzzer_sys::fuzz_target!(init: gsvx_fuzz::init(), |data: &[u8]| {
    gsvx_fuzz::ksplat(data);
});

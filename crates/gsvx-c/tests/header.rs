//! The header is what cbindgen makes of the source.
#![allow(missing_docs, reason = "a test")]

use std::path::Path;

/// With `BLESS` in the environment the header is written.
#[test]
fn the_header_is_that_of_the_source() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let config = cbindgen::Config::from_file(root.join("cbindgen.toml")).expect("cbindgen.toml");
    let mut sources = cbindgen::Builder::new().with_config(config);
    for source in ["plain.rs", "stream.rs", "border/mod.rs"] {
        sources = sources.with_src(root.join("src").join(source));
    }
    let mut made = Vec::new();
    sources.generate().expect("the source is one that cbindgen reads").write(&mut made);
    let (made, path) = (String::from_utf8(made).expect("text"), root.join("include/gsvx.h"));
    if std::env::var_os("BLESS").is_some() {
        std::fs::write(&path, &made).expect("the header can be written");
    }
    let header = std::fs::read_to_string(&path).unwrap_or_default();
    assert!(header == made, "include/gsvx.h is old: BLESS=1 cargo test -p gsvx-c --test header");
}

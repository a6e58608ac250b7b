//! Streams written once must decode to the same floats on every machine.
//!
//! `cargo run --release -p gsvx --example bless` rewrites `fixtures/streams` after a deliberate
//! change of the format (and of its version).

#[cfg(feature = "encode")]
mod common;

#[cfg(feature = "encode")]
use common::golden;
use gsvx::decode;
use std::path::PathBuf;

fn folder() -> PathBuf {
    testing::fixture("streams")
}

#[test]
fn golden_streams_decode_to_the_recorded_floats() {
    let list = std::fs::read_to_string(folder().join("hashes.txt")).expect("hashes.txt is there");
    let mut checked = 0;
    for line in list.lines().filter(|l| !l.starts_with('#')) {
        let mut columns = line.split("  ");
        let (hash, name) = (columns.next().expect("a hash"), columns.next().expect("a name"));
        let bytes = std::fs::read(folder().join(name)).expect(name);
        let decoded = decode(&bytes).expect(name);
        assert_eq!(testing::sha256(&decoded), hash, "{name}");
        assert_eq!(testing::marks(&decoded), columns.next().unwrap_or_default(), "{name}");
        checked += 1;
    }
    assert!(checked > 0);
    #[cfg(feature = "encode")]
    assert_eq!(checked, golden::streams().len());
}

/// The encoder still writes these very bytes: the same for any machine and thread count.
#[cfg(feature = "encode")]
#[test]
fn the_encoder_writes_the_golden_streams() {
    for (name, bytes) in golden::streams() {
        let golden = std::fs::read(folder().join(&name)).expect(&name);
        assert!(golden == bytes, "{name} differs from what this build encodes");
    }
}

/// The second decoder writes and checks the whole trace; its leaves are those of this decoder.
#[test]
fn the_trace_has_the_leaves_of_the_default_stream() {
    let trace = std::fs::read_to_string(folder().join("default.trace")).expect("default.trace");
    let bytes = std::fs::read(folder().join("default.gsvx")).expect("default.gsvx");
    let (octree, classes) = gsvx::decode_leaves(&bytes).expect("a golden stream");
    let line = |(i, (leaf, class)): (usize, (&gpcc_lite::Leaf, &u8))| {
        format!("leaf {i}: code {}, depth {}, class {class}", leaf.morton, leaf.depth)
    };
    let want: Vec<String> = octree.leaves().iter().zip(&classes).enumerate().map(line).collect();
    let found: Vec<&str> = trace.lines().filter(|l| l.starts_with("leaf ")).collect();
    assert_eq!(found, want);
}

#[cfg(feature = "encode")]
#[test]
fn golden_sequences_are_written_and_decode_to_the_recorded_floats() {
    let folder = testing::fixture("sequences");
    let list = std::fs::read_to_string(folder.join("hashes.txt")).expect("hashes.txt is there");
    let lines: Vec<&str> = list.lines().filter(|l| !l.starts_with('#')).collect();
    let sequences = golden::sequences();
    assert_eq!(lines.len(), sequences.len());
    for (line, (name, bytes)) in lines.iter().zip(sequences) {
        let golden = std::fs::read(folder.join(&name)).expect(&name);
        assert!(golden == bytes, "{name} differs from what this build encodes");
        assert_eq!(*line, format!("{}  {name}", testing::sha256(&golden::decoded(&golden))));
    }
}

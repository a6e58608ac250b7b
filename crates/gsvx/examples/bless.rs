//! Rewrites the golden streams in `fixtures/streams`, and the sequences.

#[path = "../tests/common/mod.rs"]
mod common;

use common::golden;

fn main() -> std::io::Result<()> {
    bless("streams", golden::streams())?;
    bless("sequences", golden::sequences())
}

fn bless(folder: &str, streams: Vec<(String, Vec<u8>)>) -> std::io::Result<()> {
    let folder = testing::fixture(folder);
    std::fs::create_dir_all(&folder)?;
    let mut list = String::from(
        "# SHA-256 of the decoded floats, name, what else the head says of the scene. The floats are f32, little-endian: all means, all rotations, all \
         log-scales, all opacity logits, all SH coefficients; of a sequence those of all its frames. Written by: cargo run --release -p gsvx --example bless\n",
    );
    for (name, bytes) in streams {
        let scene = golden::decoded(&bytes);
        let line = format!("{}  {name}  {}", testing::sha256(&scene), testing::marks(&scene));
        list += &format!("{}\n", line.trim_end());
        println!("{name}: {} bytes, {} Gaussians", bytes.len(), scene.len());
        std::fs::write(folder.join(&name), bytes)?;
    }
    std::fs::write(folder.join("hashes.txt"), list)
}

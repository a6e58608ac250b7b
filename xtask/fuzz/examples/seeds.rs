//! Writes the seeds of all targets: `cargo run --release --example seeds FOLDER` makes FOLDER/TARGET/N.

use std::path::PathBuf;

fn main() -> std::io::Result<()> {
    let Some(folder) = std::env::args_os().nth(1).map(PathBuf::from) else {
        return Err(std::io::Error::other("seeds: give the folder to write to"));
    };
    for (target, _, max_len) in gsvx_fuzz::seeds::TARGETS {
        let dir = folder.join(target);
        std::fs::create_dir_all(&dir)?;
        let seeds = gsvx_fuzz::seeds::of(target);
        for (i, seed) in seeds.iter().enumerate() {
            std::fs::write(dir.join(i.to_string()), seed)?;
        }
        println!("{target} {max_len} {}", seeds.len());
    }
    Ok(())
}

//! Writes the seeds of all targets: `cargo run --release --example seeds FOLDER` makes FOLDER/TARGET/N.

use std::path::PathBuf;

fn main() -> std::io::Result<()> {
    let Some(folder) = std::env::args_os().nth(1).map(PathBuf::from) else {
        return Err(std::io::Error::other("seeds: give the folder to write to"));
    };
    for (target, run, max_len) in gsvx_fuzz::seeds::TARGETS {
        let dir = folder.join(target);
        std::fs::create_dir_all(&dir)?;
        let seeds = gsvx_fuzz::seeds::of(target);
        for (i, seed) in seeds.iter().enumerate() {
            std::fs::write(dir.join(i.to_string()), seed)?;
            // A seed that its target refuses starts nothing: the target or the seed is out of date.
            if !run(seed) {
                return Err(std::io::Error::other(format!("seeds: {target} refuses its seed {i}")));
            }
        }
        println!("{target} {max_len} {}", seeds.len());
    }
    Ok(())
}

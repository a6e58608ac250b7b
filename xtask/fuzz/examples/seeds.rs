//! Writes the seeds of all targets: `cargo run --release --example seeds FOLDER` makes FOLDER/TARGET/N.

use std::path::PathBuf;

fn main() -> std::io::Result<()> {
    let Some(folder) = std::env::args_os().nth(1).map(PathBuf::from) else {
        return Err(std::io::Error::other("seeds: give the folder to write to"));
    };
    for target in gsvx_fuzz::seeds::TARGETS {
        let name = target.name;
        let dir = folder.join(name);
        std::fs::create_dir_all(&dir)?;
        let seeds = (target.seeds)();
        for (i, seed) in seeds.iter().enumerate() {
            std::fs::write(dir.join(i.to_string()), seed)?;
            // A seed that its target refuses starts nothing: the target or the seed is out of date.
            if !(target.run)(seed) {
                return Err(std::io::Error::other(format!("seeds: {name} refuses its seed {i}")));
            }
        }
        println!("{name} {} {}", target.max_len, seeds.len());
    }
    Ok(())
}

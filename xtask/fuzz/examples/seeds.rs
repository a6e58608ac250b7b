//! Writes the seeds of all targets: `cargo run --release --example seeds FOLDER [N]` makes FOLDER/TARGET/SEED, and runs N
//! mutations of each. What it prints is the same on all machines.

use std::path::PathBuf;

use gsvx_fuzz::seeds::{Rng, mutated};

fn main() -> std::io::Result<()> {
    let Some(folder) = std::env::args_os().nth(1).map(PathBuf::from) else {
        return Err(std::io::Error::other("seeds: give the folder to write to"));
    };
    let mutations = std::env::args().nth(2).and_then(|n| n.parse().ok()).unwrap_or(0);
    for target in gsvx_fuzz::seeds::TARGETS {
        let name = target.name;
        let dir = folder.join(name);
        std::fs::create_dir_all(&dir)?;
        let seeds = (target.seeds)();
        let (mut rng, mut accepted) = (Rng::seeded(1), 0);
        for (i, seed) in seeds.iter().enumerate() {
            std::fs::write(dir.join(i.to_string()), seed)?;
            // A seed that its target refuses starts nothing: the target or the seed is out of date.
            if !(target.run)(seed) {
                return Err(std::io::Error::other(format!("seeds: {name} refuses its seed {i}")));
            }
            let runs = (0..mutations).filter(|_| (target.run)(&mutated(seed, &mut rng)));
            accepted += runs.count();
        }
        println!("{name} {} {} {accepted}", target.max_len, seeds.len());
    }
    Ok(())
}

//! Golden streams: recorded ones, which every later version must decode to the same floats.

use std::fs;
use std::path::PathBuf;

use anyhow::{Context, Result, bail, ensure};
use testing::{marks, sha256};

use super::{Tally, Verdict};

fn folder() -> PathBuf {
    eval::scenes::root().join("fixtures/streams")
}

/// Name and bytes of a golden stream, and the recorded hash of its floats with what else its head says.
pub(super) struct Golden {
    pub(super) name: String,
    pub(super) bytes: Vec<u8>,
    recorded: String,
}

pub(super) fn streams() -> Result<Vec<Golden>> {
    let list = folder().join("hashes.txt");
    let text = fs::read_to_string(&list).with_context(|| format!("read {}", list.display()))?;
    let mut out = Vec::new();
    for line in text.lines().filter(|l| !l.starts_with('#') && !l.is_empty()) {
        let columns: Vec<&str> = line.split("  ").collect();
        let [hash, name, ref marks @ ..] = columns[..] else {
            bail!("{}: {line:?}", list.display());
        };
        let path = folder().join(name);
        let bytes = fs::read(&path).with_context(|| format!("read {}", path.display()))?;
        let recorded = format!("{hash} {}", marks.concat());
        out.push(Golden { name: name.to_owned(), bytes, recorded });
    }
    ensure!(!out.is_empty(), "{} lists no stream", list.display());
    Ok(out)
}

pub(super) fn checks(tally: &mut Tally) {
    let all = match streams() {
        Ok(all) => all,
        Err(why) => return tally.check("golden streams", || Err(why)),
    };
    for Golden { name, bytes, recorded } in all {
        tally.check(&format!("golden stream {name}"), || {
            let scene = gsvx::decode(&bytes)?;
            let got = format!("{} {}", sha256(&scene), marks(&scene));
            ensure!(got == recorded, "decodes to {got}, recorded is {recorded}");
            Ok(Verdict::Holds(format!(
                "{} Gaussians of {} bytes, the recorded floats",
                scene.len(),
                bytes.len()
            )))
        });
    }
}

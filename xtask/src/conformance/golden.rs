//! Golden streams: recorded ones, which every later version must decode to the same floats.

use std::fs;
use std::path::PathBuf;

use anyhow::{Context, Result, ensure};
use testing::sha256;

use super::{Tally, Verdict};

fn folder() -> PathBuf {
    eval::scenes::root().join("fixtures/streams")
}

/// Name, bytes and recorded hash of every golden stream.
pub(super) fn streams() -> Result<Vec<(String, Vec<u8>, String)>> {
    let list = folder().join("hashes.txt");
    let text = fs::read_to_string(&list).with_context(|| format!("read {}", list.display()))?;
    let mut out = Vec::new();
    for line in text.lines().filter(|l| !l.starts_with('#') && !l.is_empty()) {
        let (hash, name) =
            line.split_once("  ").with_context(|| format!("{}: {line:?}", list.display()))?;
        let path = folder().join(name);
        let bytes = fs::read(&path).with_context(|| format!("read {}", path.display()))?;
        out.push((name.to_owned(), bytes, hash.to_owned()));
    }
    ensure!(!out.is_empty(), "{} lists no stream", list.display());
    Ok(out)
}

pub(super) fn checks(tally: &mut Tally) {
    let all = match streams() {
        Ok(all) => all,
        Err(why) => return tally.check("golden streams", || Err(why)),
    };
    for (name, bytes, want) in all {
        tally.check(&format!("golden stream {name}"), || {
            let scene = gsvx::decode(&bytes)?;
            let got = sha256(&scene);
            ensure!(got == want, "decodes to {got}, recorded is {want}");
            Ok(Verdict::Holds(format!(
                "{} Gaussians of {} bytes, the recorded floats",
                scene.len(),
                bytes.len()
            )))
        });
    }
}

//! The code path of each peer, with stand-ins for the tools: a script that copies.
#![cfg(unix)]

use std::fs;
use std::os::unix::fs::PermissionsExt as _;

use super::*;
use crate::measure;

/// An executable shell script.
fn script(dir: &Path, name: &str, body: &str) -> PathBuf {
    let path = dir.join(name);
    fs::write(&path, format!("#!/bin/sh\n{body}\n")).unwrap();
    fs::set_permissions(&path, fs::Permissions::from_mode(0o755)).unwrap();
    path
}

/// The last two arguments are files: the second becomes the first.
const COPY: &str = r#"while [ $# -gt 2 ]; do shift; done; cp "$1" "$2""#;

/// tmc3 as the code sees it: encoding keeps the cloud as it is, decoding gives it back.
const TMC3: &str = r#"
for a in "$@"; do case $a in
  --mode=1) decode=1;;
  --uncompressedDataPath=*) in=${a#*=};;
  --compressedStreamPath=*) bin=${a#*=};;
  --reconstructedDataPath=*) out=${a#*=};;
esac; done
if [ -n "$decode" ]; then cp "$bin" "$out"; else
  cp "$in" "$bin"
  echo "positions bitstream size 100 B (1 bpp)"
  echo "colors bitstream size 20 B (1 bpp)"
  echo "reflectances bitstream size 3 B (1 bpp)"
fi"#;

/// A folder for tools and finished stages, and the room with one held-out view.
struct Setup {
    dir: tempfile::TempDir,
    scene: TestScene,
}

impl Setup {
    fn new() -> Self {
        let scene = TestScene::open(crate::scenes::DEFAULT, 1).unwrap();
        Self { dir: tempfile::tempdir().unwrap(), scene }
    }

    fn run(&self, options: &PeerOptions) -> Vec<ToolOutcome> {
        let cache = Cache::open(&self.dir.path().join("stages"), &"x", false).unwrap();
        run(options, &cache, &self.scene, 12).unwrap()
    }

    fn original_db(&self) -> f64 {
        measure::psnr_db(&self.scene.model, &self.scene.held_out)
    }
}

fn measured(all: &[ToolOutcome], peer: &str) -> Vec<CodedPoint> {
    let of = |o: &ToolOutcome| match &o.fate {
        Fate::Measured(m) if o.peer == peer => Some(m.clone()),
        _ => None,
    };
    all.iter().filter_map(of).collect()
}

#[test]
fn every_peer_is_run_decoded_and_scored() {
    let setup = Setup::new();
    let tools = setup.dir.path().join("tools");
    fs::create_dir(&tools).unwrap();
    script(&tools, "ply_to_spz", COPY);
    script(&tools, "spz_to_ply", COPY);
    let options = PeerOptions {
        tmc3: Some(script(&tools, "tmc3", TMC3)),
        spz: Some(tools.clone()),
        splat_transform: Some(script(&tools, "splat-transform", COPY)),
        peer_seconds: 60,
        ..PeerOptions::default()
    };
    let all = setup.run(&options);
    let original = setup.original_db();
    let file = fs::metadata(&setup.scene.files.dataset.model_path).unwrap().len();
    for peer in ["SPZ", "splat-transform"] {
        for point in measured(&all, peer) {
            assert!(
                (point.score.psnr_db - original).abs() < 1e-9 && point.bytes == file,
                "{point:?}"
            );
            assert_eq!(point.gaussians, setup.scene.model.len());
        }
    }
    assert_eq!(measured(&all, "splat-transform").len(), 2);
    let chain = measured(&all, "tmc3");
    assert_eq!(chain.len(), 3);
    // Positions once, 16 colours, 8 scalars; what is lost is the voxels and the authors' integers.
    assert_eq!(chain[0].bytes, 100 + 16 * 20 + 8 * 3);
    assert!(chain[0].score.psnr_db > original - 3.0, "{} of {original}", chain[0].score.psnr_db);
    assert_eq!(table(&all).rows.len(), 6);
    assert_eq!(curves(&all).len(), 4);
    let again = setup.run(&options);
    assert_eq!(measured(&again, "SPZ")[0].encode_seconds, measured(&all, "SPZ")[0].encode_seconds);
}

#[test]
fn absent_and_failing_tools_are_lines_not_errors() {
    let setup = Setup::new();
    let tools = setup.dir.path().join("tools");
    fs::create_dir(&tools).unwrap();
    // Success without a file; a failure with a message; a tool that hangs.
    script(&tools, "ply_to_spz", "exit 0");
    script(&tools, "spz_to_ply", "exit 0");
    let options = PeerOptions {
        tmc3: Some(tools.join("no such file")),
        spz: Some(tools.clone()),
        splat_transform: Some(script(
            &tools,
            "splat-transform",
            "echo first >&2; echo 'no memory' >&2; exit 3",
        )),
        peer_seconds: 60,
        ..PeerOptions::default()
    };
    let lines: Vec<String> = setup.run(&options).iter().filter_map(ToolOutcome::absence).collect();
    let says = |part: &str| assert!(lines.iter().any(|l| l.contains(part)), "{part}: {lines:?}");
    says("wrote no model.spz");
    says("no memory");
    says("no such file is not a file");
    assert!(lines.iter().all(|l| !l.contains('\n')), "{lines:?}");
    let options = PeerOptions {
        splat_transform: Some(script(&tools, "slow", "exec sleep 60")),
        spz: Some(tools.join("nowhere")),
        tmc3: Some(tools.join("nowhere")),
        peer_seconds: 1,
        ..PeerOptions::default()
    };
    let lines: Vec<String> = setup.run(&options).iter().filter_map(ToolOutcome::absence).collect();
    assert!(lines.iter().any(|l| l.contains("stopped after 1 s")), "{lines:?}");
    assert!(setup.run(&PeerOptions { no_peers: true, ..options }).is_empty());
}

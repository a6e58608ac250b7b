//! `cargo xtask bench-sequences`: frames coded as a sequence, beside frames on their own and open formats of sequences.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, Result};
use gs_model::{Format, Scene, ply};
use serde_json::Value;

use crate::bd::{self, Point};
use crate::page::{Page, Table, number, signed};
use crate::process::{self, GsvxCommand, NO_LIMIT};
use crate::{manifest, scenes};

/// Flags of `cargo xtask bench-sequences`.
#[derive(Clone, Debug, clap::Args)]
pub struct SequenceBenchOptions {
    /// The program that writes PLY frames; needs python3 with numpy
    #[arg(long, default_value = "../shared/sequences/head/frames.py")]
    frames: PathBuf,
    /// Folder of python3, splat4d and fourdgs: the bin of an environment with splats4d and fourdgs of PyPI
    #[arg(long)]
    peers: Option<PathBuf>,
    /// Where the page goes
    #[arg(long, default_value = "docs/results/sequences.md")]
    out: PathBuf,
}

/// Names of sequences, the words of the program that make them, and how much less than frames on their own they may take.
const SEQUENCES: [[&str; 3]; 5] = [
    ["plain", "", "-70 %"],
    ["turn", "--turn", "-70 %"],
    ["noise", "--noise=0.02", "-"],
    ["births", "--births=0.02", "-50 %"],
    ["shuffle", "--shuffle", "+1 %"],
];
const FRAMES: usize = 60;
/// Five frames that are compared, evenly spaced, and the one after each.
const SHOWN: [usize; 10] = [0, 1, 14, 15, 29, 30, 43, 44, 58, 59];
const COMPARED: &str = "--frames=0,2,4,6,8";
const VIEWS: [&str; 2] = ["--orbit=4", "--size=480x360"];
/// The curve of sequences; frames on their own are coded at the default quality.
const QUALITIES: [u8; 4] = [20, 50, 80, 100];
const BY_FRAME: &str = "gsvx, frame by frame";
/// What a sequence is compared with, in the order of the table.
const OTHERS: [&str; 5] =
    [BY_FRAME, ".splat4d, 2 mm", ".splat4d, 0.1 mm", ".4dgs", "SPZ v4, frame by frame"];

/// Frames on disk, and where their coded forms go.
struct Work<'a> {
    gsvx: &'a GsvxCommand,
    peers: Option<&'a Path>,
    /// PLY frames.
    input: PathBuf,
    dir: &'a Path,
}

/// What coding made of a sequence: bytes, seconds of the processor, and the frames that are compared.
struct SequenceRow {
    bytes: u64,
    seconds: f64,
    shown: Vec<Scene>,
}

/// Measures and writes the page.
///
/// # Errors
/// If a program is not there or fails.
pub fn run(options: &SequenceBenchOptions) -> Result<()> {
    let gsvx = GsvxCommand::find()?;
    let peers = options.peers.as_deref();
    if peers.is_none() {
        eprintln!("SKIPPED: .splat4d and .4dgs; pass the folder of their programs as --peers");
    }
    let python = peers.map_or("python3".into(), |dir| dir.join("python3"));
    let mut all = Table::new(
        "sequence | coded as | kB per frame | PSNR dB | flicker dB | CPU s | a sequence at this PSNR kB per frame",
    );
    let mut summary = Table::new(format!("sequence | bar | {}", OTHERS.join(" | ")));
    let mut plain = Table::new("coded as | kB per frame | PSNR dB | flicker, dB | encode, CPU s");
    for [name, words, bar] in SEQUENCES {
        let dir = tempfile::tempdir().context("make a temporary folder")?;
        let input = dir.path().join("frames");
        let mut make = Command::new(&python);
        make.arg(scenes::root().join(&options.frames))
            .arg(&input)
            .arg(format!("--frames={FRAMES}"));
        process::run(make.args(words.split_whitespace()), NO_LIMIT)?;
        let work = Work { gsvx: &gsvx, peers, input, dir: dir.path() };
        let reference = work.frames().map(|path| scenes::read_model(&path));
        let reference = shown(reference.collect::<Result<_>>()?);
        let (mut curve, mut cells) = (Vec::new(), BTreeMap::new());
        for (codec, coded) in work.coded()? {
            let SequenceRow { bytes, seconds, shown } = coded;
            let (db, flicker) = work.compared(&reference, &shown)?;
            let kb = bytes as f64 / 1e3 / FRAMES as f64;
            let mut same = None;
            if codec.starts_with("gsvx, a sequence") {
                curve.push(Point { rate: kb, score: db });
            } else {
                same = at_equal(&curve, db);
                let change = same.map(|same| 100.0 * (same / kb - 1.0));
                cells.insert(codec.clone(), signed(change, 1, " %"));
            }
            let row = format!("{codec} | {kb:.2} | {db:.2} | {flicker:.2} | {seconds:.1}");
            if name == "plain" {
                plain.row(&row);
            }
            all.told(format!("{name} | {row} | {}", number(same, 2)));
        }
        let cell = |other: &&str| cells.get(*other).cloned().unwrap_or("-".into());
        summary.told(format!("{name} | {bar} | {}", OTHERS.each_ref().map(cell).join(" | ")));
    }
    let mut page = Page::new(&options.out, "What does a sequence save?");
    page.text(format!(
        "`cargo xtask bench-sequences --peers FOLDER`: bytes of a sequence, less those of other codings at their PSNR. \
         \"Bar\": the most that was wanted against frame by frame; against `.splat4d`, -50 %. \"-\": no sequence has that PSNR. {}.",
        manifest::machine()
    ));
    page.table(&summary);
    page.text(
        "**One avatar, made-up changes**: no real recording could be had. A head of 20,018 Gaussians of SH degree 0 moves by a captured track of expressions, 60 frames. It also turns (turn), its colours, opacities and scales jitter by 2 % of their deviations (noise), 2 % of the rows are replaced in each frame (births), or the order of rows is another in each frame (shuffle).",
    );
    page.text(
        "Codings are compared at equal PSNR: between the measured qualities of sequences, linearly. Where the other PSNR is below that of the lowest quality, that quality counts. PSNR and flicker (`gsvx compare`: of the changes between frames) are against renders of the input, five frames in four views. `.splat4d` (splats4d 0.1.0) takes `.splat`, which has 8-bit colours and rotations, at its default of 2 mm and at 0.1 mm; `.4dgs` is what `fourdgs convert` makes.",
    );
    page.text("Plain:");
    page.table(&plain);
    page.data("All:", all);
    page.write()
}

/// Those of all frames that are compared.
fn shown(all: Vec<Scene>) -> Vec<Scene> {
    let wanted = |(i, scene)| SHOWN.contains(&i).then_some(scene);
    all.into_iter().enumerate().filter_map(wanted).collect()
}

/// The rate of a curve at a score, at least that of its lowest point; `None` above its highest.
fn at_equal(curve: &[Point], score: f64) -> Option<f64> {
    let lowest = curve.iter().min_by(|a, b| a.score.total_cmp(&b.score))?;
    if score <= lowest.score { Some(lowest.rate) } else { bd::rate_at(curve, score) }
}

impl Work<'_> {
    fn frames(&self) -> impl Iterator<Item = PathBuf> {
        (0..FRAMES).map(|i| self.input.join(format!("frame_{i:04}.ply")))
    }

    /// Every coding, sequences of gsvx first.
    fn coded(&self) -> Result<Vec<(String, SequenceRow)>> {
        let mut all = Vec::new();
        for quality in QUALITIES {
            all.push((format!("gsvx, a sequence, -q {quality}"), self.sequence(quality)?));
        }
        let mut add = |name: usize, coded| all.push((OTHERS[name].to_owned(), coded));
        add(0, self.by_frame("encode --no-estimate -o", "gsvx")?);
        if let Some(peers) = self.peers {
            add(1, self.splat4d(peers, "2")?);
            add(2, self.splat4d(peers, "0.1")?);
            add(3, self.fourdgs(peers)?);
        }
        add(4, self.by_frame("convert --force", "spz")?);
        Ok(all)
    }

    fn sequence(&self, quality: u8) -> Result<SequenceRow> {
        let clip = self.dir.join("clip.gsvx");
        let mut command = self.gsvx.words(["encode", "--fps=30", "--no-estimate"]);
        command.arg(format!("--quality={quality}")).arg(&self.input);
        let seconds = self.gsvx.make(&mut command, &clip)?.usage.user;
        let bytes = fs::read(&clip)?;
        let sequence = gsvx::sequence::Sequence::parse(&bytes)?;
        let mut all = Vec::new();
        for (number, group) in sequence.groups.iter().enumerate() {
            let decoded = sequence.group(&bytes, number, None)?;
            let frames = group.frames.end - group.frames.start;
            all.extend((0..frames).map(|i| decoded.frame(i as usize)));
        }
        Ok(SequenceRow { bytes: bytes.len() as u64, seconds, shown: shown(all) })
    }

    /// Every frame by words of the command, which come before the input, but for `-o`.
    fn by_frame(&self, words: &str, extension: &str) -> Result<SequenceRow> {
        let (mut bytes, mut seconds, mut all) = (0, 0.0, Vec::new());
        let out = self.dir.join("frame").with_extension(extension);
        let (words, flag) = words.strip_suffix(" -o").map_or((words, None), |w| (w, Some("-o")));
        for frame in self.frames() {
            let _ = fs::remove_file(&out);
            let mut command = self.gsvx.words(words.split(' '));
            command.arg(frame).args(flag).arg(&out);
            seconds += process::run(&mut command, NO_LIMIT)?.usage.user;
            bytes += fs::metadata(&out)?.len();
            all.push(scenes::read_model(&out)?);
        }
        Ok(SequenceRow { bytes, seconds, shown: shown(all) })
    }

    fn splat4d(&self, peers: &Path, millimetres: &str) -> Result<SequenceRow> {
        let (folder, clip) = (self.dir.join("splats"), self.dir.join("clip.splat4d"));
        fs::create_dir_all(&folder)?;
        for frame in self.frames() {
            let out = folder.join(frame.file_name().unwrap_or_default()).with_extension("splat");
            let format = Format::of_name(&out).context("gs-model writes no .splat")?;
            let mut bytes = Vec::new();
            format.write_to("frame.splat", &mut bytes, &scenes::read_model(&frame)?)?;
            fs::write(out, bytes)?;
        }
        let mut command = Command::new(peers.join("splat4d"));
        command.args(["encode", "--fps=30", "--no-verify", "--pos-mm", millimetres, "-i"]);
        let usage = process::run(command.arg(&folder).arg("-o").arg(&clip), NO_LIMIT)?.usage;
        let mut shown = Vec::new();
        for frame in SHOWN {
            let out = self.dir.join("frame.splat");
            let mut command = Command::new(peers.join("splat4d"));
            command.arg("decode").arg(&clip).arg(format!("--frame={frame}")).arg("-o").arg(&out);
            process::run(&mut command, NO_LIMIT)?;
            shown.push(scenes::read_model(&out)?);
        }
        Ok(SequenceRow { bytes: fs::metadata(&clip)?.len(), seconds: usage.user, shown })
    }

    fn fourdgs(&self, peers: &Path) -> Result<SequenceRow> {
        let clip = self.dir.join("clip.4dgs");
        let mut command = Command::new(peers.join("fourdgs"));
        command.arg("convert").arg(&self.input).arg("-o").arg(&clip).arg("--fps=30");
        let seconds = process::run(&mut command, NO_LIMIT)?.usage.user;
        let mut shown = Vec::new();
        for frame in SHOWN {
            let out = self.dir.join("frame.glb");
            // A Gaussian is as opaque as its frame has it in the middle of the frame's time.
            let time = (frame as f64 + 0.5) / 30.0;
            let mut command = Command::new(peers.join("fourdgs"));
            command.arg("to-gltf").arg(&clip).arg("-o").arg(&out).arg(format!("--time={time}"));
            command.args([
                "--coordinate-system=y-up-right-handed",
                "--color-space=srgb-rec709-display",
            ]);
            process::run(&mut command, NO_LIMIT)?;
            shown.push(turned(scenes::read_model(&out)?));
        }
        Ok(SequenceRow { bytes: fs::metadata(&clip)?.len(), seconds, shown })
    }

    /// PSNR and flicker, dB.
    fn compared(&self, reference: &[Scene], shown: &[Scene]) -> Result<(f64, f64)> {
        let folders = ["reference", "shown"].map(|name| self.dir.join(name));
        for (folder, scenes) in folders.iter().zip([reference, shown]) {
            fs::create_dir_all(folder)?;
            for (i, scene) in scenes.iter().enumerate() {
                ply::write(folder.join(format!("frame_{i}.ply")), scene)?;
            }
        }
        let mut command = self.gsvx.words(["compare", COMPARED]);
        let said = process::run(command.args(VIEWS).args(&folders), NO_LIMIT)?.json::<Value>()?;
        let of = |what: &str| said[what].as_f64().unwrap_or(f64::NAN);
        Ok((of("psnr"), of("flicker")))
    }
}

/// Half a turn about z: glTF has y up, and the frames have it down. For SH degree 0.
fn turned(mut scene: Scene) -> Scene {
    scene.means.iter_mut().for_each(|[x, y, _]| (*x, *y) = (-*x, -*y));
    scene.rotations.iter_mut().for_each(|q| *q = [-q[3], -q[2], q[1], q[0]]);
    scene
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn below_the_curve_its_lowest_point_counts() {
        let curve = [(1.0, 40.0), (2.0, 50.0)].map(|(rate, score)| Point { rate, score });
        let at = |score| at_equal(&curve, score);
        assert_eq!([at(30.0), at(45.0), at(51.0)], [Some(1.0), Some(1.5), None]);
    }

    #[test]
    fn the_frames_that_are_compared_have_successors() {
        assert!(SHOWN.chunks(2).all(|pair| pair[1] == pair[0] + 1 && pair[1] < FRAMES));
    }
}

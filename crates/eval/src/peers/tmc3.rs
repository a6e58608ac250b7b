//! The paper's own chain around MPEG's tmc3: uniform voxelization, the authors' merging, their
//! integer channels and options, lossless covariance.
//!
//! A stream here is a header followed by one tmc3 stream per attribute. The header has what the
//! authors' decoder is given on the side (cube, depth, ranges of the channels); as in the paper, it
//! does not count.

mod channels;

use std::path::{Path, PathBuf};
use std::time::Duration;

use anyhow::{Context, Result, ensure};
use gpcc_lite::{Leaf, morton};
use gs_model::Scene;
use serde::{Deserialize, Serialize};
use voxel::{Cube, Merge, Strategy};

use super::tool;
use crate::cloud::{self, Channels};
use crate::codec::Codec;
use crate::rd_curve::plan::{Coding, PAPER_CODING};
use crate::scenes::TestScene;
use channels::Part;

/// Qualities whose QPs are on the hull of the authors' published curves, greatest rate last.
pub(super) const QUALITIES: [f32; 3] = [34.0, 62.0, 90.0];

const COMMON: &str = "--mode=0 --geomTreeType=0 --partitionMethod=3 --transformType=0 --rahtExtension=0 \
     --rahtPredictionEnabled=0 --bitdepth=8 --attrOffset=0 --attrInterPredSearchRange=-1";
const COLOUR: &str = "--convertPlyColourspace=0 --colourMatrix=0 --attrScale=1 --attribute=color";
const OPACITY: &str =
    "--convertPlyColourspace=1 --colourMatrix=2 --attrScale=257 --attribute=reflectance";
const COVARIANCE: &str = "--mode=0 --mergeDuplicatedPoints=0 --positionQuantizationScale=1 --trisoupNodeSizeLog2=0 \
     --neighbourAvailBoundaryLog2=8 --intra_pred_max_node_size_log2=6 --inferredDirectCodingMode=1 \
     --maxNumQtBtBeforeOt=4 --minQtbtSizeLog2=0 --planarEnabled=1 --planarModeIdcmUse=0 \
     --convertPlyColourspace=0 --transformType=1 --numberOfNearestNeighborsInPrediction=3 \
     --intraLodPredictionSkipLayers=0 --interComponentPredictionEnabled=0 \
     --adaptivePredictionThreshold=64 --bitdepth=16 --attrOffset=0 --attrScale=1 --attribute=reflectance";

/// The paper's chain. The quality chooses the QPs, as for the paper's coding of `rd_curve`.
pub(super) struct Tmc3 {
    program: PathBuf,
    depth: u8,
    limit: Duration,
}

/// What the decoder is given on the side.
#[derive(Serialize, Deserialize)]
struct Header {
    /// Bytes that count: payloads of attributes, and of positions once.
    counted: u64,
    depth: u8,
    sh_degree: u8,
    /// Origin and side of the cube, as bits: JSON rounds floats.
    cube: [u64; 4],
    /// For each attribute, the length of its tmc3 stream and the bits of its channels' ranges.
    parts: Vec<(usize, Vec<[u64; 2]>)>,
}

impl Tmc3 {
    /// The program `given`, or the one on the PATH; or what is missing. `depth` is that of the uniform octree,
    /// `limit` the longest run of the program.
    pub(super) fn find(given: Option<&Path>, depth: u8, limit: Duration) -> Result<Self, String> {
        Ok(Self { program: tool::find(given, "tmc3")?, depth, limit })
    }

    pub(super) fn program(&self) -> &Path {
        &self.program
    }

    /// The settings at a quality, in words.
    pub(super) fn settings(&self, quality: f32) -> String {
        let paper::Qp { ac, dc, opacity } = Self::qps(quality);
        format!("paper's chain, J = {}, QP {ac}/{dc}/{opacity}, lossless covariance", self.depth)
    }

    fn qps(quality: f32) -> paper::Qp {
        let least = paper::Qp { ac: 4, dc: 4, opacity: 4 };
        Coding::of(PAPER_CODING, quality).paper().map_or(least, |options| options.qp)
    }

    /// Codes one attribute. Returns its stream and the bytes of positions and attribute in it.
    fn code(
        &self,
        positions: &[[u32; 3]],
        channels: &Channels,
        options: &str,
        qp: u8,
    ) -> Result<(Vec<u8>, [u64; 2])> {
        let dir = tempfile::tempdir().context("make a folder for a tool")?;
        let (input, stream) = (dir.path().join("in.ply"), dir.path().join("stream.bin"));
        cloud::write(&input, positions, channels)?;
        let mut args: Vec<String> = options.split_whitespace().map(str::to_owned).collect();
        // tmc3 ignores it at this setting, but the authors give it.
        if options.contains("--partitionMethod") {
            args.push(format!("--partitionOctreeDepth={}", self.depth));
        }
        args.push(format!("--qp={qp}"));
        args.push(format!("--uncompressedDataPath={}", input.display()));
        args.push(format!("--compressedStreamPath={}", stream.display()));
        let printed = tool::run(&self.program, &args, dir.path(), self.limit)?;
        let kind = if channels.is_colour() { "colors" } else { "reflectances" };
        let bytes = [payload(&printed, "positions")?, payload(&printed, kind)?];
        Ok((tool::contents(&stream)?, bytes))
    }

    /// Decodes one attribute.
    fn decode_part(&self, stream: &[u8]) -> Result<(Vec<[u32; 3]>, Channels)> {
        let dir = tempfile::tempdir().context("make a folder for a tool")?;
        let (input, back) = (dir.path().join("stream.bin"), dir.path().join("out.ply"));
        std::fs::write(&input, stream).with_context(|| format!("write {}", input.display()))?;
        let args = [
            "--mode=1".to_owned(),
            "--outputBinaryPly=1".to_owned(),
            format!("--compressedStreamPath={}", input.display()),
            format!("--reconstructedDataPath={}", back.display()),
        ];
        tool::run(&self.program, &args, dir.path(), self.limit)?;
        cloud::read(&back)
    }
}

impl Codec for Tmc3 {
    fn name(&self) -> String {
        "tmc3, the paper's chain".into()
    }

    fn encode(&self, scene: &TestScene, quality: f32) -> Result<Vec<u8>> {
        let qps = Self::qps(quality);
        let cube = voxel::cube_of(&scene.model.means)?;
        let strategy = Strategy::Uniform { depth: self.depth };
        let voxels = voxel::voxelize(&scene.model, &cube, &strategy)?;
        let merged = voxel::merge(&scene.model, &voxels, Merge::Paper)?;
        let positions: Vec<[u32; 3]> =
            voxels.octree().leaves().iter().map(|l| morton::decode(l.morton)).collect();
        let [x, y, z] = cube.origin.map(f64::to_bits);
        let mut header = Header {
            counted: 0,
            depth: self.depth,
            sh_degree: merged.sh_degree,
            cube: [x, y, z, cube.side.to_bits()],
            parts: Vec::new(),
        };
        let mut streams = Vec::new();
        for (index, part) in channels::parts(merged.sh_degree).into_iter().enumerate() {
            let (options, qp) = match part {
                Part::Dc => (format!("{COMMON} {COLOUR}"), qps.dc),
                Part::Ac(_) => (format!("{COMMON} {COLOUR}"), qps.ac),
                Part::Opacity => (format!("{COMMON} {OPACITY}"), qps.opacity),
                Part::Scale(_) | Part::Rotation(_) => (COVARIANCE.to_owned(), 4),
            };
            let (integers, ranges) = part.take(&merged);
            let (stream, [geometry, attribute]) = self.code(&positions, &integers, &options, qp)?;
            // The authors count positions once, in the first (DC) stream.
            header.counted += attribute + if index == 0 { geometry } else { 0 };
            let bits = ranges.iter().map(|range| range.map(f64::to_bits));
            header.parts.push((stream.len(), bits.collect()));
            streams.extend(stream);
        }
        let mut out = serde_json::to_vec(&header).context("header")?;
        out.push(b'\n');
        out.extend(streams);
        Ok(out)
    }

    fn decode(&self, stream: &[u8]) -> Result<Scene> {
        let (header, mut rest) = split(stream)?;
        let parts = channels::parts(header.sh_degree);
        ensure!(parts.len() == header.parts.len(), "{} attributes", header.parts.len());
        let [x, y, z, side] = header.cube.map(f64::from_bits);
        let cube = Cube { origin: [x, y, z], side };
        let mut scene = Scene::default();
        let mut first: Option<Vec<[u32; 3]>> = None;
        for (part, (len, bits)) in parts.into_iter().zip(&header.parts) {
            let (own, behind) = rest.split_at_checked(*len).context("an attribute is cut off")?;
            rest = behind;
            let (positions, channels) = self.decode_part(own)?;
            if first.is_none() {
                scene = blank(&positions, &cube, &header);
            }
            let same = *first.get_or_insert_with(|| positions.clone()) == positions;
            ensure!(same, "tmc3 decoded other positions for {part:?} than for DC");
            let ranges = bits.iter().map(|range| range.map(f64::from_bits));
            part.put(&mut scene, &channels, &ranges.collect());
        }
        Ok(scene)
    }

    fn counted_bytes(&self, stream: &[u8]) -> Result<u64> {
        Ok(split(stream)?.0.counted)
    }
}

/// Header and tmc3 streams.
fn split(stream: &[u8]) -> Result<(Header, &[u8])> {
    let end = stream.iter().position(|&b| b == b'\n').context("no header")?;
    let header = serde_json::from_slice(&stream[..end]).context("the header")?;
    Ok((header, &stream[end + 1..]))
}

/// Gaussians at the centres of their leaves, with all attributes still to be filled in.
fn blank(positions: &[[u32; 3]], cube: &Cube, header: &Header) -> Scene {
    let leaf = |p: &[u32; 3]| Leaf { morton: morton::encode(*p), depth: header.depth };
    let n = positions.len();
    let bases = (usize::from(header.sh_degree) + 1).pow(2);
    Scene {
        means: positions.iter().map(|p| cube.leaf_centre(leaf(p), header.depth)).collect(),
        rotations: vec![[0.0; 4]; n],
        log_scales: vec![[0.0; 3]; n],
        opacity_logits: vec![0.0; n],
        sh_degree: header.sh_degree,
        sh: vec![[0.0; 3]; n * bases],
    }
}

/// Bytes of a payload by tmc3's own log, summed over slices: "colors bitstream size 123 B ...".
fn payload(log: &str, kind: &str) -> Result<u64> {
    let mut found = None;
    for line in log.lines() {
        let Some((_, rest)) = line.split_once(&format!("{kind} bitstream size ")) else { continue };
        let digits: String = rest.chars().take_while(char::is_ascii_digit).collect();
        let bytes: u64 = digits.parse().with_context(|| format!("tmc3's line {line:?}"))?;
        *found.get_or_insert(0) += bytes;
    }
    found.with_context(|| format!("tmc3 printed no \"{kind} bitstream size\""))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn payloads_are_summed_over_slices() {
        let log = "positions bitstream size 10 B (1 bpp)\ncolors bitstream size 7 B (2 bpp)\n\
                   positions bitstream size 5 B (1 bpp)\n";
        assert_eq!(payload(log, "positions").unwrap(), 15);
        assert_eq!(payload(log, "colors").unwrap(), 7);
        assert!(payload(log, "reflectances").is_err());
    }
}

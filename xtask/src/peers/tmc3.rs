//! The paper's own chain around MPEG's tmc3: uniform voxelization, the authors' merging, their
//! integer channels and options, lossless covariance.

mod channels;
mod ply;

use std::path::Path;
use std::time::Duration;

use anyhow::{Context, Result, ensure};
use gpcc_lite::morton;
use voxel::{Cube, Merge, Strategy};

use super::{Coded, Outcome, Task, tool};
use channels::Channels;

/// (AC, DC, opacity) QPs on the hull of the authors' published curves.
const QPS: [(u8, u8, u8); 3] = [(38, 16, 28), (31, 4, 16), (16, 4, 4)];

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

/// What all runs on one voxelization share.
struct Chain<'a> {
    program: &'a Path,
    depth: u8,
    limit: Duration,
    /// Integer positions, in Morton order.
    at: Vec<[u32; 3]>,
}

/// One attribute, coded and decoded.
struct Coding {
    geometry_bytes: u64,
    attribute_bytes: u64,
    decoded: Channels,
    encode_seconds: f64,
    decode_seconds: f64,
}

/// Codes and measures at each QP triple.
pub(super) fn run(task: &Task<'_>, program: &Path, limit: Duration) -> Result<Vec<Outcome>> {
    let cube = Cube::of(&task.scene.means)?;
    let depth = task.depth;
    let voxels = voxel::voxelize(task.scene, &cube, &Strategy::Uniform { depth })?;
    let merged = voxel::merge(task.scene, &voxels, Merge::Paper)?;
    let at = voxels.leaves.iter().map(|l| morton::decode(l.morton)).collect();
    let chain = Chain { program, depth, limit, at };
    let mut out = Vec::new();
    for (ac, dc, opacity) in QPS {
        let settings =
            format!("paper's chain, J = {depth}, QP {ac}/{dc}/{opacity}, lossless covariance");
        out.push(task.measure("tmc3", &settings, program, |dir| {
            let mut scene = merged.clone();
            let mut sum = Coded {
                bytes: 0,
                scene: gs_model::Scene::default(),
                encode_seconds: 0.0,
                decode_seconds: 0.0,
            };
            for (index, part) in channels::parts(&scene).into_iter().enumerate() {
                let (options, qp) = match part {
                    channels::Part::Dc => (format!("{COMMON} {COLOUR}"), dc),
                    channels::Part::Ac(_) => (format!("{COMMON} {COLOUR}"), ac),
                    channels::Part::Opacity => (format!("{COMMON} {OPACITY}"), opacity),
                    channels::Part::Scale(_) | channels::Part::Rotation(_) => {
                        (COVARIANCE.to_owned(), 4)
                    }
                };
                let (integers, ranges) = part.take(&scene);
                let coding = chain.code(&integers, &options, qp, dir)?;
                // The authors count positions once, in the first (DC) stream.
                sum.bytes +=
                    coding.attribute_bytes + if index == 0 { coding.geometry_bytes } else { 0 };
                sum.encode_seconds += coding.encode_seconds;
                sum.decode_seconds += coding.decode_seconds;
                part.put(&mut scene, &coding.decoded, &ranges);
            }
            sum.scene = scene;
            Ok(sum)
        })?);
    }
    Ok(out)
}

impl Chain<'_> {
    fn code(&self, channels: &Channels, options: &str, qp: u8, dir: &Path) -> Result<Coding> {
        let path = |name: &str| dir.join(name);
        let (input, stream, back) = (path("in.ply"), path("stream.bin"), path("out.ply"));
        ply::write(&input, &self.at, channels)?;
        let mut args: Vec<String> = options.split_whitespace().map(str::to_owned).collect();
        // Ignored by tmc3 at this setting, but it is what the authors give.
        if options.contains("--partitionMethod") {
            args.push(format!("--partitionOctreeDepth={}", self.depth));
        }
        args.push(format!("--qp={qp}"));
        args.push(format!("--uncompressedDataPath={}", input.display()));
        args.push(format!("--compressedStreamPath={}", stream.display()));
        let encode = tool::run(self.program, &args, dir, self.limit)?;
        tool::size(&stream)?;
        let kind = if channels.is_colour() { "colors" } else { "reflectances" };
        let (geometry_bytes, attribute_bytes) =
            (payload(&encode.stdout, "positions")?, payload(&encode.stdout, kind)?);
        let args = [
            "--mode=1".to_owned(),
            "--outputBinaryPly=1".to_owned(),
            format!("--compressedStreamPath={}", stream.display()),
            format!("--reconstructedDataPath={}", back.display()),
        ];
        let decode = tool::run(self.program, &args, dir, self.limit)?;
        let (at, values) = ply::read(&back, channels.is_colour())?;
        ensure!(at.len() == self.at.len(), "tmc3 decoded {} of {} points", at.len(), self.at.len());
        // Its order is its own; positions are unique.
        let mut order: Vec<usize> = (0..at.len()).collect();
        order.sort_unstable_by_key(|&i| morton::encode(at[i]));
        let same = order.iter().zip(&self.at).all(|(&i, want)| at[i] == *want);
        ensure!(same, "tmc3 decoded other positions than it was given");
        Ok(Coding {
            geometry_bytes,
            attribute_bytes,
            decoded: values.reordered(&order),
            encode_seconds: encode.seconds,
            decode_seconds: decode.seconds,
        })
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

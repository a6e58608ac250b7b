//! `gsvx convert --compress`: a gsvx stream inside a `.glb`.

use crate::exit::{note, usage};
use crate::input::{self, LoadedModel, OpenedInput, ReadingAny};
use crate::output::{Output, Written};
use anyhow::{Context, Result};
use gs_model::gltf::CompressedGltf;
use gsvx::{Aim, DEFAULT_QUALITY, DecodeOptions, Decoder, Encoder, Index};
use std::path::Path;

/// The stream of an input, as it is, or that of a model at a quality. `notes` gets what the file of a model held.
pub(crate) fn stream(
    reading: &ReadingAny,
    path: &Path,
    quality: Option<f32>,
    notes: &mut Vec<String>,
) -> Result<Vec<u8>> {
    let name = input::name(path);
    let LoadedModel { scene, report, .. } = match (reading.open(path)?, quality) {
        (OpenedInput::Model(loaded), _) => *loaded,
        (OpenedInput::Stream(_), Some(_)) => {
            return Err(usage(format!(
                "{name}: is a stream, which goes in as it is; leave out --quality"
            )));
        }
        (OpenedInput::Stream(bytes), None) => return whole(bytes, reading, &name),
    };
    *notes = report.sentences();
    let mut encoder = Encoder::new(Aim::Quality(quality.unwrap_or(DEFAULT_QUALITY)));
    let made = encoder.encode(&scene, None).with_context(|| name.clone())?;
    made.warnings.iter().for_each(|warning| note(format_args!("warning: {name}: {warning}")));
    Ok(made.encoded.bytes)
}

/// A stream without what follows it; one that is cut or damaged is refused.
fn whole(mut bytes: Vec<u8>, reading: &ReadingAny, name: &str) -> Result<Vec<u8>> {
    let mut options = DecodeOptions::default();
    options.max_gaussians = reading.limit.max_gaussians;
    Decoder::new(&bytes, &options).with_context(|| name.to_owned())?;
    let length = Index::parse(&bytes)?.stream_len();
    bytes.truncate(usize::try_from(length)?);
    Ok(bytes)
}

/// Writes the file. Returns the number of Gaussians in it, and their SH degree, too.
pub(crate) fn write(output: Output, stream: &[u8]) -> Result<(Written, usize, u8)> {
    let index = Index::parse(stream)?;
    let (count, sh_degree) = (usize::try_from(index.header.count)?, index.header.sh_degree);
    let extension = gsvx::gltf::CODEC.extension;
    let bounds = bounds(&index);
    let name = output.name();
    let file = CompressedGltf { extension, data: stream, count, sh_degree, bounds };
    Ok((output.write(|out| Ok(file.write_to(&name, out)?))?, count, sh_degree))
}

/// Least and greatest coordinates of the means.
fn bounds(index: &Index) -> [[f32; 3]; 2] {
    let mut all = [[f32::INFINITY; 3], [f32::NEG_INFINITY; 3]];
    for [low, high] in index.chunks_of_lod(0).map(|chunk| index.chunks[chunk].bounds) {
        for k in 0..3 {
            all[0][k] = all[0][k].min(low[k]);
            all[1][k] = all[1][k].max(high[k]);
        }
    }
    all
}

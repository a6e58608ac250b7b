//! What coarse levels of detail cost, and what they show.

use anyhow::Result;
use gsvx::{DecodeOptions, EncodeOptions};

use crate::measure;
use crate::progress::Bar;
use crate::scenes::TestScene;

/// Encodes each scene with and without coarse levels, with cameras and at the default quality, and
/// prints a table.
pub(super) fn run(names: &[String]) -> Result<()> {
    println!(
        "| scene | Gaussians | of them in the coarsest level | bytes without levels | with levels | more | head and coarsest level | share | PSNR of the coarsest level, dB | of all, dB |\n\
         |---|---:|---:|---:|---:|---:|---:|---:|---:|---:|"
    );
    for name in names {
        let TestScene { model, training, held_out, .. } = TestScene::open(name, usize::MAX)?;
        let mut options = EncodeOptions::default();
        options.importance = Some(finetune::saliency_per_view(&model, &training).squared);
        options.drop_unseen = true;
        let plain = gsvx::encode(&model, &options)?.bytes.len() as f64;
        options.lod = true;
        let encoded = gsvx::encode(&model, &options)?;
        let (index, bytes) = (&encoded.index, encoded.bytes.len() as f64);
        let coarsest = index.coarsest_lod();
        let chunks = || index.chunks_of_lod(coarsest).map(|i| &index.chunks[i]);
        let layers = || chunks().flat_map(|c| &c.layers);
        let coarse = (index.head_len + layers().map(|l| l.len).sum::<u64>()) as f64;
        let shown = |lod| -> Result<f64> {
            let mut options = DecodeOptions::default();
            options.lod = lod;
            let scene = gsvx::decode_with(&encoded.bytes, &options)?.scene;
            Ok(measure::score(&scene, &held_out, &Bar::hidden()).0.psnr_db)
        };
        println!(
            "| {name} | {} | {} | {plain} | {bytes} | {:+.2} % | {coarse} | {:.2} % | {:.2} | {:.2} |",
            index.header.count,
            chunks().map(|c| c.count).sum::<u64>(),
            100.0 * (bytes / plain - 1.0),
            100.0 * coarse / bytes,
            shown(coarsest)?,
            shown(0)?,
        );
    }
    Ok(())
}

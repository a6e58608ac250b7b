//! A scene whose values an optimiser moves while the codec is in the loop.
//!
//! The values are those that the codec transforms: ln(alpha), Y Co Cg of each SH coefficient, and six
//! log-Euclidean coordinates for each leaf. [`Latents::reconstruct`] does with them what the encoder does
//! (weighted RAHT, quantisation, inverse), and returns the scene that a decoder would return, with the
//! number of bytes, those of coarser levels of detail among them. [`Latents::gradient`] takes the derivatives of a
//! loss back to the values, as if quantisation were the identity. [`Latents::encode`] writes the stream.
//!
//! *Invariant:* the stream of [`Latents::encode`] decodes to the last scene of [`Latents::reconstruct`],
//! bit for bit, if values, steps and fit are the same. Only SH degrees that are zero everywhere are missing:
//! a stream leaves them out.
//!
//! Leaves, importance classes and weights are fixed when the latents are made; steps may change.

use super::assemble::{EncodedChunk, assemble, leaves_chunk, with_outliers, without_zero_degrees};
use super::check::{check_centres, check_length, check_lengths, check_steps, used_degree};
use super::coarse::Coarse;
use super::encoded::EncodedStream;
use super::lod;
use super::options::CodeOptions;
use crate::attributes::opacity;
use crate::chunk::{self, ChunkEncoder, CodingSettings, LAMBDA_MOVED, Values, coded};
pub use crate::chunk::{
    Attribute, GROUPS, GaussianGradient, Group, PredictFrom, Transform, TransformPrediction,
};
pub use crate::covariance::EQUAL_AXES;
use crate::error::Result;
use crate::head::{Header, Index, Layer, Steps};
use crate::importance;
use gpcc_lite::Octree;
use gs_model::{Scene, SceneMut};
use rayon::prelude::*;
use std::ops::Range;
use voxel::Voxelization;

/// Opacity logits are moved into this range.
pub const LOGIT_RANGE: [f32; 2] = opacity::LOGIT_RANGE;
/// Gaussians rebuilt at a time.
const BLOCK: usize = 512;

/// See the [module](self).
pub struct Latents {
    header: Header,
    chunks: Vec<(Range<usize>, ChunkEncoder)>,
    channels: usize,
    values: Vec<f32>,
    coarse: Coarse,
}

impl Latents {
    /// Starts from a voxelized scene, as [`crate::encode_voxels`] takes it. Covariances go through the
    /// transform.
    ///
    /// # Errors
    /// Those of [`crate::encode_voxels`].
    pub fn new(
        scene: &Scene,
        octree: &Octree,
        importance: &[f32],
        steps: Steps,
        options: &CodeOptions,
    ) -> Result<Self> {
        check_lengths(scene)?;
        check_centres(scene, octree)?;
        chunk::check(scene, 0)?;
        let sh_degree = used_degree(scene, options.max_sh_degree);
        let channels = channels(sh_degree);
        let mut values = vec![0.0; channels * scene.len()];
        let rows = values.par_chunks_mut(channels).enumerate();
        rows.for_each(|(i, row)| {
            for group in coded(sh_degree) {
                group.values(scene, i, &mut row[group.among(channels)]);
            }
        });
        Self::with_values(octree, importance, steps, options, &scene.emptied(sh_degree), values)
    }

    /// Goes on with the values of other latents on the same leaves, with the same importance of each. `empty` is their
    /// [`Latents::empty_scene`].
    ///
    /// # Errors
    /// As [`Latents::new`].
    pub fn with_values(
        octree: &Octree,
        importance: &[f32],
        steps: Steps,
        options: &CodeOptions,
        empty: &Scene,
        values: Vec<f32>,
    ) -> Result<Self> {
        check_steps(&steps)?;
        let &Scene { sh_degree, antialiased, origin, .. } = empty;
        let channels = channels(sh_degree);
        check_length("importances", importance.len(), octree.len())?;
        check_length("values", values.len(), channels * octree.len())?;
        let classes = importance::log_classes(importance, steps.covariance);
        let voxels = Voxelization::one_each(octree.clone());
        let mut levels = lod::levels(&voxels, options, lod::LodTiles::ONE)?;
        let cuts = levels.remove(0).cuts;
        let coarse = Coarse::new(voxels, levels, importance.to_vec());
        let chunk = |cut: &[usize]| {
            let range = cut[0]..cut[1];
            let chunk = ChunkEncoder::new(octree.part(range.clone()), &classes[range.clone()])?;
            Ok((range, chunk))
        };
        let chunks = cuts.par_windows(2).map(chunk).collect::<Vec<Result<_>>>();
        let header = Header {
            count: octree.len() as u64,
            sh_degree,
            j_high: octree.depth(),
            cube: octree.cube(),
            steps,
            antialiased,
            origin,
        };
        let chunks = chunks.into_iter().collect::<Result<_>>()?;
        Ok(Self { header, chunks, channels, values, coarse })
    }

    /// Values per leaf.
    #[must_use]
    pub fn channels(&self) -> usize {
        self.channels
    }

    /// The SH degree that is coded.
    #[must_use]
    pub fn sh_degree(&self) -> u8 {
        self.header.sh_degree
    }

    /// A scene without Gaussians, of the SH degree that is coded.
    #[must_use]
    pub fn empty_scene(&self) -> Scene {
        self.header.empty_scene(self.sh_degree())
    }

    /// Number of leaves.
    #[must_use]
    pub fn len(&self) -> usize {
        self.values.len() / self.channels
    }

    /// True if there is no leaf.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.values.is_empty()
    }

    /// The values, leaf after leaf: ln(alpha), Y Co Cg of each SH coefficient, six coordinates.
    #[must_use]
    pub fn values(&self) -> &[f32] {
        &self.values
    }

    /// The values, to be moved. They must stay finite.
    #[must_use]
    pub fn values_mut(&mut self) -> &mut Vec<f32> {
        &mut self.values
    }

    /// The quantisation steps.
    #[must_use]
    pub fn steps(&self) -> Steps {
        self.header.steps
    }

    /// The Lagrangian multiplier of the quantiser, in `step^2` per bit.
    #[must_use]
    pub fn lambda(&self) -> f32 {
        LAMBDA_MOVED
    }

    /// The first of [`GROUPS`]: those of the SH degree that is coded.
    #[must_use]
    pub fn groups(&self) -> &'static [Group] {
        coded(self.sh_degree())
    }

    /// The step of a group for a leaf of weight 1.
    #[must_use]
    pub fn step_of_unit_weight(&self, group: &Group) -> f32 {
        chunk::step_of_unit_weight(group.step(&self.header.steps))
    }

    /// The transform of each chunk, with the predictions of the last fit.
    pub fn transforms(&self) -> impl Iterator<Item = Transform<'_>> {
        self.chunks.iter().map(|(_, chunk)| chunk.transform())
    }

    /// Other quantisation steps from now on.
    ///
    /// # Errors
    /// [`crate::Error::Option`] for a step that no stream may have.
    pub fn set_steps(&mut self, steps: Steps) -> Result<()> {
        check_steps(&steps)?;
        self.header.steps = steps;
        Ok(())
    }

    /// Puts the scene that a decoder would return into `scene`; Gaussians behind the leaves stay as they
    /// are, and must have the SH degree of the latents.
    ///
    /// With `fit`, the predictions (of opacity and size from depth and class, of an SH degree from the
    /// one below) are fitted to the values first, and the bytes of the stream are returned, counted
    /// with the coder's own models but not written. Otherwise the predictions are those of the last fit,
    /// and nothing is counted, which saves time. The first call has to fit. `prices` take the derivatives of the number of bits by the values.
    ///
    /// # Errors
    /// [`crate::Error::Coding`].
    pub fn reconstruct(
        &mut self,
        fit: bool,
        prices: Option<&mut [f32]>,
        scene: &mut Scene,
    ) -> Result<Option<u64>> {
        let Self { header, chunks, channels, values, .. } = self;
        let channels = *channels;
        let how = how(header, fit);
        let mut rest = prices;
        let mut jobs = Vec::with_capacity(chunks.len());
        for (range, chunk) in chunks.iter_mut() {
            let flat = &values[range.start * channels..range.end * channels];
            let prices = rest.take().map(|all| {
                let (here, after) = all.split_at_mut(flat.len());
                rest = Some(after);
                here
            });
            jobs.push((chunk, Values { flat, channels }, prices));
        }
        let sizes: Vec<Result<u64>> = jobs
            .into_par_iter()
            .with_max_len(1)
            .map(|(chunk, values, prices)| chunk.code(&how, values, prices))
            .collect();
        let layers = sizes.into_iter().sum::<Result<u64>>()?;
        self.rebuild(scene)?;
        if !fit {
            return Ok(None);
        }
        let coarse = self.coarse_chunks()?;
        let bytes = coarse.iter().flat_map(|(_, layers)| layers).map(|l| l.len() as u64);
        Ok(Some(layers + bytes.sum::<u64>() + self.head_bytes(coarse)))
    }

    /// The coarse levels of what was coded last.
    fn coarse_chunks(&self) -> Result<Vec<EncodedChunk>> {
        if self.coarse.is_empty() {
            return Ok(Vec::new());
        }
        let mut finest = Scene::default();
        self.rebuild(&mut finest)?;
        self.coarse.encode(&finest, &self.header)
    }

    /// The Gaussians of what was coded last.
    fn rebuild(&self, scene: &mut Scene) -> Result<()> {
        let Header { sh_degree, antialiased, origin, .. } = self.header;
        (scene.sh_degree, scene.antialiased, scene.origin) = (sh_degree, antialiased, origin);
        let n = scene.len().max(self.len());
        chunk::resize(scene, n)?;
        let mut rest = SceneMut::of(scene);
        let mut jobs = Vec::new();
        for (range, chunk) in &self.chunks {
            for first in (0..range.len()).step_by(BLOCK) {
                let (out, others) = rest.split_at(BLOCK.min(range.len() - first));
                rest = others;
                jobs.push((chunk.decoded(), first, out));
            }
        }
        jobs.into_par_iter().for_each(|(chunk, first, mut out)| chunk.fill(first, &mut out));
        Ok(())
    }

    /// Bytes of the head of a stream without outliers.
    fn head_bytes(&self, coarse: Vec<EncodedChunk>) -> u64 {
        let layer = |len: usize| Layer { offset: 0, len: len as u64, crc: 0 };
        let coarse = coarse.into_iter().map(|(mut entry, layers)| {
            entry.layers = layers.iter().map(|bytes| layer(bytes.len())).collect();
            entry
        });
        let layers = 1 + usize::from(self.header.sh_degree);
        let finest = self.chunks.iter().map(|(range, chunk)| {
            let mut entry = leaves_chunk(0, chunk.decoded().octree());
            entry.layers = vec![layer(range.len() * self.channels / 8); layers];
            entry
        });
        let chunks: Vec<_> = coarse.chain(finest).collect();
        Index::to_bytes(&self.header, &chunks).len() as u64
    }

    /// Takes the derivatives of a loss by the arrays of Gaussian `i` of the last scene of
    /// [`Latents::reconstruct`] to its values.
    pub fn gradient(&self, scene: &Scene, i: usize, given: &GaussianGradient<'_>, out: &mut [f32]) {
        for group in coded(self.header.sh_degree) {
            group.gradient(scene, i, given, &mut out[group.among(self.channels)]);
        }
    }

    /// The stream. `outliers` are coded bit for bit behind the leaves.
    ///
    /// # Errors
    /// As [`crate::encode_voxels`].
    pub fn encode(&mut self, outliers: Option<&Scene>) -> Result<EncodedStream> {
        let Self { header, chunks, channels, values, .. } = self;
        let (channels, header) = (*channels, &*header);
        let encode = |(range, chunk): &mut (Range<usize>, ChunkEncoder)| {
            let flat = &values[range.start * channels..range.end * channels];
            let values = Values { flat, channels };
            let layers = chunk.layers(&how(header, false), values)?;
            Ok((leaves_chunk(0, chunk.decoded().octree()), layers))
        };
        let finest: Vec<Result<_>> = chunks.par_iter_mut().with_max_len(1).map(encode).collect();
        let finest = finest.into_iter().collect::<Result<Vec<_>>>()?;
        let least = outliers.map_or(0, |o| o.sh_degree);
        let mut chunks = self.coarse_chunks()?;
        chunks.extend(finest);
        let chunks = without_zero_degrees(chunks, least);
        with_outliers(&self.header, chunks, outliers)
            .and_then(|(header, chunks)| assemble(header, chunks))
    }
}

/// Values per leaf.
fn channels(sh_degree: u8) -> usize {
    coded(sh_degree).iter().map(|group| group.channels).sum()
}

/// Values that an optimiser moves are coded with a dead zone of their own.
fn how(header: &Header, fit: bool) -> CodingSettings<'_> {
    let Header { steps, sh_degree, .. } = header;
    CodingSettings { steps, sh_degree: *sh_degree, fit, lambda: Some(LAMBDA_MOVED) }
}

//! Fine-tuning with a transform codec in the loop, on a graphics adapter.
//!
//! The parameters are the values that the codec transforms, not those of the scene. A step renders what a
//! decoder would return, and takes the gradient back to the values as if quantisation were the identity.
//! Every few steps the codec runs: transform, quantisation, reconstruction, and the derivatives of the
//! bits. All of it stays on the device; only losses are read back.
//!
//! This crate does not know a codec. [`Codec`] describes one: weighted RAHT in single precision on up to
//! six groups of channels, with a dead zone that depends on the magnitudes of the levels above. The kernels
//! are `stages/codec/*.wgsl`; their Rust twins are the codec itself (the crates gpcc-lite and gsvx).

pub use crate::gpu::latents::LatentExecutor;
use crate::shaders::CHUNK_WORDS;

/// Groups of channels: opacity, DC, SH degrees 1 to 3, covariance.
pub const GROUPS: usize = 6;

/// A merge of the transform, numbered over all chunks from coarse to fine.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Merge {
    /// First leaf of the left child.
    pub left: u32,
    /// First leaf of the right child.
    pub right: u32,
    /// Number of the merge above, plus one; 0 for the root of a chunk.
    pub parent: u32,
    /// Weight of the right child over that of the node.
    pub share: f32,
    /// What takes a coefficient to the difference of the children's means.
    pub scale: f32,
    /// Standard deviation of the coefficient if the values of the leaves were independent.
    pub noise_gain: f32,
}

/// A leaf: a Gaussian that is coded.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Leaf {
    /// Depth in the octree.
    pub depth: u8,
    /// Importance class.
    pub class: u8,
    /// Number of its chunk.
    pub chunk: u16,
    /// Weight in the transform.
    pub weight: f32,
}

/// The prediction of SH degree 2 or 3 from the degree below, for runs of leaves.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ShPrediction {
    /// Binary logarithm of the leaves of a run, 10 or more.
    pub log_run: u8,
    /// By run, coefficient of the degree and coefficient of the degree below.
    pub factors: Vec<f32>,
}

/// A chunk: consecutive leaves with a transform of their own.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Chunk {
    /// Its first leaf.
    pub first: u32,
    /// Root of the sum of its weights.
    pub root_of_weight: f32,
    /// Factors of depth and class that predict ln(alpha).
    pub opacity: [f32; 2],
    /// Factors of depth and class that predict the first coordinate of the covariance.
    pub size: [f32; 2],
    /// Of SH degrees 2 and 3.
    pub sh: [Option<ShPrediction>; 2],
}

/// A codec. Values of a leaf are ln(alpha), three for each SH coefficient (Y, Co, Cg), and six coordinates
/// of the logarithm of the covariance's root.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Codec {
    /// SH degree.
    pub sh_degree: u8,
    /// Steps of the coefficients by group: see [`GROUPS`].
    pub steps: [f32; GROUPS],
    /// Lagrangian multiplier of the quantiser, in `step^2` per bit.
    pub lambda: f32,
    /// Merges from coarse to fine.
    pub merges: Vec<Merge>,
    /// First merge of each level, then the number of merges. Merges of a level do not depend on each other.
    pub levels: Vec<u32>,
    /// The leaves.
    pub leaves: Vec<Leaf>,
    /// The chunks.
    pub chunks: Vec<Chunk>,
}

impl Codec {
    /// Values per leaf.
    #[must_use]
    pub fn channels(&self) -> usize {
        let coefficients = usize::from(self.sh_degree) + 1;
        7 + 3 * coefficients * coefficients
    }

    pub(crate) fn leaf_words(&self) -> Vec<u32> {
        let word =
            |l: &Leaf| u32::from(l.depth) | u32::from(l.class) << 8 | u32::from(l.chunk) << 16;
        self.leaves.iter().map(word).collect()
    }

    /// The words of all chunks, and the factors of their SH predictions.
    pub(crate) fn chunk_words(&self) -> (Vec<u32>, Vec<f32>) {
        let (mut words, mut factors) = (Vec::new(), Vec::new());
        for chunk in &self.chunks {
            words.extend([chunk.first, chunk.root_of_weight.to_bits()]);
            words.extend([chunk.opacity, chunk.size].as_flattened().iter().map(|f| f.to_bits()));
            for prediction in &chunk.sh {
                let log_run = prediction.as_ref().map_or(0, |p| p.log_run.into());
                words.extend([log_run, factors.len() as u32]);
                factors.extend(prediction.iter().flat_map(|p| &p.factors));
            }
        }
        debug_assert_eq!(words.len(), CHUNK_WORDS as usize * self.chunks.len());
        (words, factors)
    }
}

/// What a step of [`LatentExecutor`] does.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LatentStep {
    /// View to render, modulo the number of views.
    pub view: usize,
    /// Number of the step, from 1, for Adam.
    pub number: u64,
    /// Rates of ln(alpha), DC, the other SH coefficients, and the covariance.
    pub rates: [f32; 4],
    /// Whether the codec runs first. Otherwise the scene is the one before.
    pub coded: bool,
    /// Price of a bit in units of the loss. It counts in steps in which the codec runs.
    pub bit_price: f32,
}

/// The state of a run on latents.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LatentState {
    /// The values, leaf after leaf.
    pub values: Vec<f32>,
    /// Adam's first and second moments, in the same order.
    pub moments: [Vec<f32>; 2],
}

//! What the tests of this crate share.
#![allow(dead_code, unused_imports, reason = "each test binary uses a part")]

pub(crate) mod forge;
pub(crate) mod golden;

pub(crate) use testing::{Rng, with_floaters, with_related_degrees};

use gs_model::Scene;
use gsvx::{CodeOptions, DEFAULT_QUALITY, EncodeOptions, EncodedStream, Octree, Steps};
use voxel::{Merge, Strategy, Voxelization, cube_of, merge, voxelize};

/// A small scene that looks like a trained one.
pub(crate) fn scene(n: usize, sh_degree: u8, seed: u64) -> Scene {
    testing::trained_like(n, sh_degree, &mut Rng::seeded(seed))
}

pub(crate) fn voxelized(scene: &Scene, strategy: &Strategy) -> (Scene, Voxelization) {
    let cube = cube_of(&scene.means).unwrap();
    let voxels = voxelize(scene, &cube, strategy).unwrap();
    (merge(scene, &voxels, Merge::Moments).unwrap(), voxels)
}

/// The error of a codec on one attribute.
pub(crate) struct Spread {
    pub(crate) rms: f64,
    pub(crate) largest: f64,
}

/// Root mean square and largest magnitude of `errors`.
pub(crate) fn spread(errors: impl IntoIterator<Item = f64>) -> Spread {
    let (mut square, mut largest, mut n) = (0.0, 0f64, 0usize);
    for e in errors {
        square += e * e;
        largest = largest.max(e.abs());
        n += 1;
    }
    Spread { rms: (square / n.max(1) as f64).sqrt(), largest }
}

/// Every bit of Gaussian `i`.
pub(crate) fn bits(s: &Scene, i: usize) -> Vec<u32> {
    let floats = [
        &s.means[i][..],
        &s.rotations[i],
        &s.log_scales[i],
        &[s.opacity_logits[i]],
        s.sh_of(i).as_flattened(),
    ];
    floats.concat().iter().map(|v| v.to_bits()).collect()
}

/// Runs `f` on a pool of so many threads.
pub(crate) fn on_threads<T: Send>(threads: usize, f: impl FnOnce() -> T + Send) -> T {
    rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(f)
}

/// A trained scene of the shared data, or `None` with a loud line.
pub(crate) fn trained_scene(shared: &str) -> Option<Scene> {
    let path = testing::shared(shared)?;
    Some(gs_model::model::read(&path, &Default::default()).unwrap().0)
}

/// The fixture room.
pub(crate) fn room() -> Scene {
    gs_model::ply::read(testing::fixture("room/point_cloud.ply")).unwrap().0
}

/// The steps of a quality.
pub(crate) fn steps(quality: f32) -> Steps {
    Steps::of_quality(quality).unwrap()
}

/// Default options with changes to how leaves are coded.
pub(crate) fn encoding(change: impl FnOnce(&mut CodeOptions)) -> EncodeOptions {
    let mut options = EncodeOptions::default();
    change(&mut options.code);
    options
}

/// A stream of the default quality, with guessed importances.
pub(crate) fn encode(scene: &Scene, options: &EncodeOptions) -> gsvx::Result<EncodedStream> {
    gsvx::encode(scene, None, DEFAULT_QUALITY, options)
}

/// A stream of voxels of the default quality, with guessed importances.
pub(crate) fn encode_voxels(
    scene: &Scene,
    octree: &Octree,
    outliers: Option<&Scene>,
    options: &EncodeOptions,
) -> gsvx::Result<EncodedStream> {
    gsvx::encode_voxels(scene, octree, outliers, None, &steps(DEFAULT_QUALITY), &options.code)
}

/// Default options with changes.
pub(crate) fn decoding(change: impl FnOnce(&mut gsvx::DecodeOptions)) -> gsvx::DecodeOptions {
    let mut options = gsvx::DecodeOptions::default();
    change(&mut options);
    options
}

/// A positive number of leaves.
pub(crate) fn leaves(n: usize) -> std::num::NonZeroUsize {
    std::num::NonZeroUsize::new(n).unwrap()
}

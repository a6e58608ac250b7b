//! The values of one slice, and the Gaussians they stand for, block by block.

use super::Slice;
use crate::attributes::group::{Transform, UNITS, coding, limits};
use crate::attributes::prediction::Predictor;
use crate::attributes::{colour, opacity};
use crate::covariance::{self, Shapes, log_euclidean};
use crate::error::{Error, Result};
use crate::importance;
use crate::options::OpacityDomain;
use crate::ordered;
use crate::stream::{Header, SectionKind};
use gpcc_lite::Leaf;
use gpcc_lite::attribute::Rows;
use gs_model::Scene;
use rayon::prelude::*;
use std::ops::Range;

/// Gaussians turned into floats at a time: what they take stays in a core's cache.
pub(super) const BLOCK: usize = 512;
/// Leaves whose values are gathered at a time, and most channels of a group.
const RUN: usize = 32;
const CHANNELS: usize = 21;

/// What the payloads of a slice hold, still in units of the transform. Its memory serves one slice
/// after another.
#[derive(Debug, Default)]
pub(super) struct Values {
    pub(super) leaves: Vec<Leaf>,
    /// Number of the first leaf in the stream.
    first: u64,
    domain: OpacityDomain,
    opacity: Rows,
    shapes: Shapes,
    /// Of [`Shapes::Coordinates`].
    coordinates: Rows,
    /// By SH degree, without what is predicted of it.
    sh: [Rows; 4],
    predictors: [Option<Predictor>; 4],
}

/// One attribute of the slice and where its values go.
struct Task<'a> {
    kind: SectionKind,
    payload: &'a [u8],
    rows: &'a mut Rows,
}

/// What a task says besides its values.
enum Said {
    Nothing,
    Domain(OpacityDomain),
    Shapes(Shapes),
    Predicted(usize, Predictor),
}

impl Values {
    /// Decodes a slice with these attributes, on this thread only if `alone`.
    pub(super) fn decode(
        &mut self,
        slice: &Slice<'_>,
        kinds: &[SectionKind],
        header: &Header,
        alone: bool,
    ) -> Result<()> {
        // What the slice before left is of no use while this one grows.
        self.leaves = Vec::new();
        self.first = slice.first;
        let geometry = gpcc_lite::geometry::decode(slice.geometry, &limits(slice.len))
            .map_err(coding("geometry"))?;
        let mut leaves = geometry.leaves;
        if leaves.len() as u64 != slice.len {
            return Err(Error::Corrupt { what: "leaf count", value: leaves.len() as u64 });
        }
        leaves.shrink_to_fit();
        if geometry.j_high != header.j_high {
            return Err(Error::Corrupt { what: "geometry depth", value: geometry.j_high.into() });
        }
        let mut transform = Transform::of(leaves, header.j_high)?;
        if let Some(payload) = slice.importance {
            let classes = importance::decode_by(&transform, payload, &mut self.opacity)?;
            transform = transform.weighted(&classes)?;
        }
        self.shapes = Shapes::default();
        self.predictors = Default::default();
        let [dc, sh1, sh2, sh3] = &mut self.sh;
        let mut free = [
            (SectionKind::Opacity, Some(&mut self.opacity)),
            (SectionKind::Covariance, Some(&mut self.coordinates)),
            (SectionKind::Dc, Some(dc)),
            (SectionKind::Sh1, Some(sh1)),
            (SectionKind::Sh2, Some(sh2)),
            (SectionKind::Sh3, Some(sh3)),
        ];
        let mut rows_of = |kind| free.iter_mut().find(|f| f.0 == kind).and_then(|f| f.1.take());
        let tasks = kinds
            .iter()
            .zip(&slice.attributes)
            .filter_map(|(&kind, payload)| rows_of(kind).map(|rows| Task { kind, payload, rows }));
        let said = run(tasks.collect(), alone, |task| task.run(&transform, header.j_high));
        for said in said {
            match said? {
                Said::Nothing => {}
                Said::Domain(domain) => self.domain = domain,
                Said::Shapes(shapes) => self.shapes = shapes,
                Said::Predicted(degree, predictor) => self.predictors[degree] = Some(predictor),
            }
        }
        self.leaves = transform.into_leaves();
        Ok(())
    }

    /// The first leaf and the last.
    pub(super) fn ends(&self) -> Option<(Leaf, Leaf)> {
        self.leaves.first().copied().zip(self.leaves.last().copied())
    }

    /// Puts the Gaussians of the leaves from `first` on into `out`.
    fn fill(&self, header: &Header, first: usize, out: Gaussians<'_>) -> Result<()> {
        let leaves = &self.leaves[first..first + out.means.len()];
        super::centres_into(leaves, header, self.first + first as u64, out.means)?;
        let mut values = [0.0; RUN * CHANNELS];
        for (at, logits) in (first..).step_by(RUN).zip(out.opacity_logits.chunks_mut(RUN)) {
            let values = &mut values[..logits.len()];
            self.opacity.copy(at, values);
            for (logit, &v) in logits.iter_mut().zip(&*values) {
                *logit = opacity::inverse(self.domain, natural(v));
            }
        }
        match &self.shapes {
            Shapes::Missing => {
                out.rotations.fill([1.0, 0.0, 0.0, 0.0]);
                for (scale, leaf) in out.log_scales.iter_mut().zip(leaves) {
                    *scale = super::ball(*leaf, header);
                }
            }
            Shapes::Whole((rotations, log_scales)) => {
                let range = first..first + leaves.len();
                out.rotations.copy_from_slice(&rotations[range.clone()]);
                out.log_scales.copy_from_slice(&log_scales[range]);
            }
            Shapes::Coordinates => {
                let out = out.rotations.chunks_mut(RUN).zip(out.log_scales.chunks_mut(RUN));
                for (at, (rotations, log_scales)) in (first..).step_by(RUN).zip(out) {
                    let values = &mut values[..6 * rotations.len()];
                    self.coordinates.copy(at, values);
                    values.iter_mut().for_each(|v| *v = natural(*v) as f32);
                    let (coordinates, _) = values.as_chunks::<6>();
                    log_euclidean::decompose_into(coordinates, rotations, log_scales);
                }
            }
        }
        let stride = out.sh.len() / leaves.len().max(1);
        let (mut values, mut below) = (&mut values, &mut [0.0; RUN * CHANNELS]);
        for (at, sh) in (first..).step_by(RUN).zip(out.sh.chunks_mut((RUN * stride).max(1))) {
            let mut start = 0;
            for (degree, (rows, predictor)) in self.sh.iter().zip(&self.predictors).enumerate() {
                let coefficients = 2 * degree + 1;
                if start + coefficients > stride {
                    break;
                }
                let len = 3 * coefficients * (sh.len() / stride);
                rows.copy(at, &mut values[..len]);
                if let Some(predictor) = predictor {
                    predictor.add(at, below, &mut values[..len]);
                }
                let by_leaf = values[..len].as_chunks::<3>().0.chunks_exact(coefficients);
                for (sh, values) in sh.chunks_exact_mut(stride).zip(by_leaf) {
                    for (rgb, ycc) in sh[start..start + coefficients].iter_mut().zip(values) {
                        *rgb = colour::inverse(ycc.map(natural));
                    }
                }
                std::mem::swap(&mut values, &mut below);
                start += coefficients;
            }
        }
        Ok(())
    }

    /// Makes `scene` the Gaussians of these leaves.
    pub(super) fn block(
        &self,
        header: &Header,
        leaves: Range<usize>,
        scene: &mut Scene,
    ) -> Result<()> {
        resize(scene, leaves.len());
        self.fill(header, leaves.start, Gaussians::of(scene))
    }

    /// The Gaussians of all leaves, on this thread only if `alone`.
    pub(super) fn scene(&self, header: &Header, sh_degree: u8, alone: bool) -> Result<Scene> {
        let n = self.leaves.len();
        let mut scene = Scene { sh_degree, ..Scene::default() };
        resize(&mut scene, n);
        let blocks = Gaussians::of(&mut scene).split(if alone { n.max(1) } else { 8 * BLOCK });
        let fill = |(first, out)| self.fill(header, first, out);
        if alone {
            blocks.into_iter().try_for_each(fill)?;
        } else {
            blocks.into_par_iter().map(fill).collect::<Result<()>>()?;
        }
        Ok(scene)
    }
}

/// A value of the transform in natural units.
#[inline]
fn natural(value: f32) -> f64 {
    f64::from(value) * (1.0 / UNITS)
}

impl Task<'_> {
    fn run(self, transform: &Transform, j_high: u8) -> Result<Said> {
        let Self { kind, payload, rows } = self;
        match kind {
            SectionKind::Opacity => {
                let Some((&code, rest)) = payload.split_first() else {
                    return Err(Error::Truncated { what: "opacity", offset: 0, need: 1, have: 0 });
                };
                let domain = opacity::domain(code)?;
                transform.decode_rows(rest, 1, rows)?;
                Ok(Said::Domain(domain))
            }
            SectionKind::Covariance => {
                covariance::decode(payload, transform, j_high, rows).map(Said::Shapes)
            }
            _ => {
                let degree = kind.sh_degree();
                let (predictor, payload) = if degree >= 2 {
                    Predictor::split(degree, transform.len(), payload)?
                } else {
                    (None, payload)
                };
                transform.decode_rows(payload, 3 * kind.sh_coefficients().len(), rows)?;
                Ok(match predictor {
                    Some(predictor) => Said::Predicted(degree.into(), predictor),
                    None => Said::Nothing,
                })
            }
        }
    }
}

/// Runs the tasks, on all cores unless `alone`. What the long ones need is free again when all
/// values are there: covariances, of which few are zero, go first, then those of most channels.
/// Results are in the order of the tasks.
fn run<'a>(
    tasks: Vec<Task<'a>>,
    alone: bool,
    work: impl Fn(Task<'a>) -> Result<Said> + Sync,
) -> Vec<Result<Said>> {
    if alone {
        return tasks.into_iter().map(work).collect();
    }
    let length = |task: &Task<'_>| (task.kind == SectionKind::Covariance, task.kind.channels());
    ordered::longest_first(tasks, length, work)
}

/// Gives a scene `n` Gaussians, of which nothing is promised.
fn resize(scene: &mut Scene, n: usize) {
    let sh = n * scene.sh_len();
    if scene.is_empty() {
        // Zeros of the system, untouched until they are written.
        scene.means = vec![[0.0; 3]; n];
        scene.rotations = vec![[0.0; 4]; n];
        scene.log_scales = vec![[0.0; 3]; n];
        scene.opacity_logits = vec![0.0; n];
        scene.sh = vec![[0.0; 3]; sh];
    } else {
        scene.means.resize(n, [0.0; 3]);
        scene.rotations.resize(n, [0.0; 4]);
        scene.log_scales.resize(n, [0.0; 3]);
        scene.opacity_logits.resize(n, 0.0);
        scene.sh.resize(sh, [0.0; 3]);
    }
}

/// Consecutive Gaussians of a scene, to be filled in.
struct Gaussians<'a> {
    means: &'a mut [[f32; 3]],
    rotations: &'a mut [[f32; 4]],
    log_scales: &'a mut [[f32; 3]],
    opacity_logits: &'a mut [f32],
    sh: &'a mut [[f32; 3]],
}

impl<'a> Gaussians<'a> {
    fn of(scene: &'a mut Scene) -> Self {
        let Scene { means, rotations, log_scales, opacity_logits, sh_degree: _, sh } = scene;
        Self { means, rotations, log_scales, opacity_logits, sh }
    }

    /// Runs of `size` and the number of the first of each.
    fn split(self, size: usize) -> Vec<(usize, Self)> {
        let stride = self.sh.len() / self.means.len().max(1);
        let parts = self
            .means
            .chunks_mut(size)
            .zip(self.rotations.chunks_mut(size))
            .zip(self.log_scales.chunks_mut(size))
            .zip(self.opacity_logits.chunks_mut(size))
            .zip(self.sh.chunks_mut((size * stride).max(1)));
        let whole = |((((means, rotations), log_scales), opacity_logits), sh)| Gaussians {
            means,
            rotations,
            log_scales,
            opacity_logits,
            sh,
        };
        (0..).step_by(size).zip(parts.map(whole)).collect()
    }
}
